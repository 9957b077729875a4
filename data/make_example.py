"""Make data/example_bulge.npz: a bulge test that bulgefit's own solver made, not a measured one.

    python data/make_example.py [--output FILE] [--force]

The same versions of NumPy and bulgefit give the same bytes. What was put in stands in `TRUTH`,
in the key `made` of the file and in data/README.md.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np

from bulgefit import InputError, disc, simulate
from bulgefit.files import atomic_write_bytes
from bulgefit.model.observation import observe

FILE = Path(__file__).parent / "example_bulge.npz"

#: MPa and 1. Stable up to the highest pressure, without wrinkles.
TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
RADIUS, THICKNESS = 100.0, 0.81  # mm
PRESSURE = np.linspace(0.01, 0.25, 15)  # MPa

#: The mesh is finer than the one that a fit uses by default, so that a fit meets a mesh error.
REFINE = 6

SEED = 7318
SPACING, REACH = 5.3, 95.0  # mm, of the measured points
HOLE_X, HOLE_Y, HOLE_RADIUS = 38.0, -24.0, 9.0  # mm, glare in which no point was found
NOISE = np.array([0.005, 0.005, 0.012])  # mm, standard deviation of dx, dy, dz
IMAGES_AT_REST = 4
LOST = 0.003  # part of the values' points that are NaN


def make() -> dict[str, np.ndarray]:
    """The arrays of the test in mm and MPa, float32 where the cameras measured."""
    rng = np.random.default_rng(SEED)
    points = _points(rng)
    made = simulate(TRUTH, PRESSURE, mesh=disc(RADIUS, REFINE), thickness=THICKNESS)
    if not made.stable or made.wrinkled.any():
        raise InputError("the example leaves the range in which its fabric is stable and taut")
    seen = observe(made.mesh, points)(made.displacement)
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
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=FILE, help=f"default: {FILE.name}")
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    args = parser.parse_args()
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **make())
    atomic_write_bytes(args.output, buffer.getvalue(), args.force)
    print(f"{args.output}: {len(buffer.getvalue()):,} bytes")


if __name__ == "__main__":
    main()
