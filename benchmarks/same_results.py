"""Do other versions of Python and of the libraries give the same results, to 1e-8?

    python benchmarks/same_results.py here.json
    python benchmarks/same_results.py there.json --beside here.json

Writes results of every kind with all digits: apex heights of each law, shapes with effects, a fit
with its errors, what the measurement says alone, a diagnosis. With --beside it compares them with
another file and leaves with status 1 where any differs by more.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
from pathlib import Path

import numba
import numpy as np
import scipy

import bulgefit

#: Largest relative difference of a result between versions.
SAME = 1e-8

EXAMPLE = Path(__file__).resolve().parents[1] / "data" / "example_bulge.npz"
MATERIAL = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
EFFECTS = {
    "initial_shape.h0": 1.5,
    "clamp_slip.compliance": 0.02,
    "prestrain.slack_x": 0.001,
    "nonlinear_material.k_x": 1.0,
}


def shapes() -> dict[str, float]:
    """Apex heights (mm) along paths of each law, and of a specimen that has effects."""
    bar = np.linspace(0.05, 3.0, 30)  # more than are balanced one by one
    found: dict[str, float] = {}
    for law in ("hencky", "svk", "yarn"):
        apex = bulgefit.simulate(MATERIAL, 0.1 * bar, law=law).apex
        found |= {f"apex of {law} at {p:.3g} bar": w for p, w in zip(bar, apex, strict=True)}
    few = bar[::7]
    apex = bulgefit.simulate(MATERIAL, 0.1 * few, effects=EFFECTS).apex
    return found | {f"apex with effects at {p:.3g} bar": w for p, w in zip(few, apex, strict=True)}


def fits(test: bulgefit.BulgeTest) -> dict[str, float]:
    """Moduli (MPa), their standard errors and the objective, by two objectives."""
    found: dict[str, float] = {}
    for objective in ("e_w", "likelihood"):
        fit = bulgefit.fit(test, objective=objective, bounds=BOUNDS, starts=1)
        found[f"{objective} of its fit"] = fit.value
        for name in BOUNDS:
            found[f"{name} by {objective}"] = fit.material.values[name]
            error = fit.uncertainty.stderr[name]
            if error is None:
                raise SystemExit(f"{name} by {objective}: the fit does not tell its error")
            found[f"standard error of {name} by {objective}"] = error
    return found


def measured(test: bulgefit.BulgeTest) -> dict[str, float]:
    """What geometry and equilibrium say at the apex under the highest pressure."""
    table = bulgefit.measure(test).tables()["apex"]
    return {
        f"{name} of the apex": float(column[-1])
        for name, column in table.items()
        if np.isfinite(column[-1]) and column[-1]
    }


def diagnosed(test: bulgefit.BulgeTest) -> dict[str, float]:
    """Gaps (mm) and moduli (MPa) of a diagnosis."""
    answer = bulgefit.diagnose(test, effects=["initial_shape", "rigid_motion"]).to_dict()
    moduli = answer["parameters"]["corrected"]
    return {
        **{f"{name} by diagnosis": moduli[name]["value"] for name in BOUNDS},
        **{f"e_w of the {name} gap": gap["e_w"] for name, gap in answer["gap"].items()
           if isinstance(gap, dict) and gap.get("e_w")},
    }  # fmt: skip


def versions() -> str:
    """What computed."""
    used = {module.__name__: module.__version__ for module in (np, scipy, numba)}
    told = ", ".join(f"{name} {version}" for name, version in used.items())
    return f"Python {platform.python_version()}, {told}"


def differences(here: dict[str, float], there: dict[str, float]) -> dict[str, float]:
    """Relative difference of each result; ValueError where they are not of the same things."""
    if here.keys() != there.keys():
        raise ValueError(f"not the same results: {sorted(here.keys() ^ there.keys())}")
    return {name: abs(here[name] - there[name]) / abs(there[name]) for name in here}


def main() -> None:
    """Compute, write, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--beside", type=Path, help="a file of another version")
    args = parser.parse_args()
    test = bulgefit.read_test(EXAMPLE)
    few = test.select(frames=slice(None, None, 3), points=None)
    found = {**shapes(), **fits(test), **measured(test), **diagnosed(few)}
    found = {name: float(value) for name, value in found.items()}
    text = json.dumps({"versions": versions(), "results": found}, indent=1)
    args.output.write_text(text + "\n", encoding="utf-8")
    if args.beside is None:
        print(f"{len(found)} results")
        return
    other = json.loads(args.beside.read_text(encoding="utf-8"))
    apart = differences(found, other["results"])
    worst = sorted(apart, key=lambda name: -apart[name])[:5]
    print(f"{len(found)} results beside those of {other['versions']}")
    for name in worst:
        print(f"  {name}: {found[name]!r} and {other['results'][name]!r}, {apart[name]:.1e} apart")
    if not apart[worst[0]] <= SAME:
        sys.exit(f"results differ by more than {SAME:g}")


if __name__ == "__main__":
    main()
