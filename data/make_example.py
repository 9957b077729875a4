"""Make the example tests of data/: by bulgefit's own solver, not measured.

    python data/make_example.py [--output FOLDER] [--force]

`example_bulge.npz` has a perfect clamp, `example_slip.npz` one that lets the fabric slip. The same
versions of NumPy and bulgefit give the same bytes. What was put in stands in the key `made` of the
files and in data/README.md.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import io
from pathlib import Path

import numpy as np

from bulgefit import InputError, disc, simulate
from bulgefit.files import atomic_write_bytes
from bulgefit.model.observation import operators
from bulgefit.trial.make import Recipe, make_test

#: MPa and 1. Stable up to the highest pressure, without wrinkles.
TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
RADIUS, THICKNESS = 100.0, 0.81  # mm
PRESSURE = np.linspace(0.01, 0.25, 15)  # MPa

#: Meshes from which the shapes are extrapolated to cells of no size (Richardson), so that what a
#: fit or a diagnosis meets is its own mesh's error alone.
COARSE, FINE = 8, 12

SEED = 7318
SPACING, REACH = 5.3, 95.0  # mm, of the measured points
HOLE_X, HOLE_Y, HOLE_RADIUS = 38.0, -24.0, 9.0  # mm, glare in which no point was found
NOISE = np.array([0.005, 0.005, 0.012])  # mm, standard deviation of dx, dy, dz
IMAGES_AT_REST = 4
LOST = 0.003  # part of the values' points that are NaN


#: Of the test whose clamp slips: the draw, and about as many frames and points.
SLIP_SEED, SLIP_RECIPE = 5, Recipe(frames=15, spacing=SPACING)


def make_bulge() -> dict[str, np.ndarray]:
    """The arrays of the perfect test in mm and MPa, float32 where the cameras measured."""
    rng = np.random.default_rng(SEED)
    points = _points(rng)
    coarse, fine = _seen(points, COARSE), _seen(points, FINE)
    seen = fine + (fine - coarse) / ((FINE / COARSE) ** 2 - 1.0)
    displacement = seen + rng.normal(0.0, NOISE, seen.shape)
    displacement[rng.random(seen.shape[:2]) < LOST] = np.nan
    at_rest = rng.normal(0.0, NOISE, (IMAGES_AT_REST, *points.shape))
    given = ", ".join(f"{name} = {value:g}" for name, value in TRUTH.items())
    return {
        "reference": points.astype(np.float32),
        "displacement": displacement.astype(np.float32),
        "pressure": PRESSURE,
        "radius": np.float64(RADIUS),
        "thickness": np.float64(THICKNESS),
        "poisson_ratio": np.float64(TRUTH["nu12"]),
        "static_displacement": at_rest.astype(np.float32),
        "made": np.array(
            "MADE, not measured: bulgefit's own solver (data/make_example.py) with "
            f"{given} (MPa, 1), noise of dx, dy, dz {NOISE.tolist()} mm, seed {SEED}"
        ),
    }


def make_slip() -> dict[str, np.ndarray]:
    """The arrays of the test whose clamp slips, as the blind trial makes its tests."""
    made = make_test("clamp_slip", SLIP_SEED, SLIP_RECIPE)
    test, (block,) = made.test, made.test.blocks
    moduli = ", ".join(f"{name} = {value:.1f}" for name, value in made.truth["moduli"].items())
    compliance = made.truth["parameters"]["clamp_slip"]["compliance"]
    return {
        "reference": block.reference.astype(np.float32),
        "displacement": block.displacement.astype(np.float32),
        "pressure": test.pressure,
        "radius": np.float64(test.radius),
        "thickness": np.float64(test.thickness),
        "poisson_ratio": np.float64(test.poisson_ratio),
        "time": test.time,
        "made": np.array(
            f"MADE, not measured: bulgefit.trial.make (data/make_example.py) with {moduli} "
            f"(MPa), a clamp that slips by {compliance:.4f} mm per N/mm, seed {SLIP_SEED}"
        ),
    }


#: What makes each file.
FILES = {"example_bulge.npz": make_bulge, "example_slip.npz": make_slip}


def _seen(points: np.ndarray, refine: int) -> np.ndarray:
    """Displacement (frames, n, 3) in mm of the points, on a mesh of this fineness."""
    made = simulate(TRUTH, PRESSURE, mesh=disc(RADIUS, refine), thickness=THICKNESS)
    if not made.stable or made.wrinkled.any():
        raise InputError("the example leaves the range in which its fabric is stable and taut")
    return operators(made.mesh, points)(made.displacement)


def _points(rng: np.random.Generator) -> np.ndarray:
    """Positions (n, 3) in mm: a shaken grid on the disc, without a hole; z as cameras see flat."""
    reach = int(REACH / SPACING) + 1
    axis = SPACING * np.arange(-reach, reach + 1)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    grid += rng.uniform(-0.25 * SPACING, 0.25 * SPACING, grid.shape)
    seen = np.hypot(*grid.T) < REACH
    seen &= np.hypot(*(grid - (HOLE_X, HOLE_Y)).T) > HOLE_RADIUS
    plane = grid[seen]
    return np.column_stack([plane, rng.normal(0.0, NOISE[2], len(plane))])


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parent, help="folder (default: data)"
    )
    parser.add_argument("--force", action="store_true", help="replace files that exist")
    args = parser.parse_args()
    for name, make in FILES.items():
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **make())
        atomic_write_bytes(args.output / name, buffer.getvalue(), args.force)
        print(f"{args.output / name}: {len(buffer.getvalue()):,} bytes")


if __name__ == "__main__":
    main()
