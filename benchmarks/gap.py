"""Diagnose the measured tests and write what was found to docs/gap.md.

    python benchmarks/gap.py [--data ../shared/data/dic] [--write docs/gap.md] [--report FOLDER]
                             [--thorough]

Each binned field is diagnosed by itself. The profiles
(the same tests on two lines, at full resolution and every recorded frame) take no part in it: they
judge the model before and after. Then each test is met with what the other two, diagnosed together,
say of the material.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, griddata

import bulgefit
from bulgefit.effects.places import KNEE
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.measure import gap_of, weight_of
from bulgefit.gap.specimen import Specimen

TESTS = (1, 2, 4)
MODULI = ("E1", "E2", "G12")
#: Strain of the secant stiffness: half of what the tests reach.
SECANT = 0.03


def diagnosed(path: Path, profile: Path, report: str | None, thorough: bool) -> dict[str, Any]:
    """The diagnosis of one field, and the gap on its profiles before and after."""
    found = bulgefit.diagnose(bulgefit.read_test(path), thorough=thorough, say=_say(path.stem))
    if report is not None:
        from bulgefit.report.diagnosis import write_report

        write_report(found, report, force=True)
    weight = weight_of([p.data for p in found.prepared])
    (field,) = (p.data.specimen for p in found.prepared)
    explanation = found.explanation
    remainder = explanation.remainder
    return {
        **found.to_dict(),
        "profiles": {
            "before": on_profile(profile, explanation.baseline, field, weight),
            "after": on_profile(profile, explanation.final, field, weight),
        },
        "persistent": remainder.persistent,
    }


def met(paths: Mapping[int, Path], left_out: int) -> dict[str, Any]:
    """The other tests diagnosed together, and the one left out met with their material."""
    tests = {n: bulgefit.read_test(path) for n, path in paths.items()}
    others = [test for n, test in tests.items() if n != left_out]
    return bulgefit.diagnose(
        others, holdout=tests[left_out], say=_say(f"test {left_out} left out")
    ).to_dict()


def on_profile(path: Path, fit: Regression, field: Specimen, weight: float) -> dict[str, float]:
    """Gap of a model on the profiles, over the pressures that were diagnosed.

    The shapes are those that the diagnosis balanced, between its frames by a spline in p^(1/3).
    Offsets of the field's points are taken linearly between them, and from the nearest outside.
    """
    test = bulgefit.read_test(path)
    low, high = field.recorded.min(), field.recorded.max()
    test = test.select(frames=np.flatnonzero((test.pressure >= low) & (test.pressure <= high)))
    specimen = Specimen(test, refine=field.refine)
    (prediction,) = fit.predictions
    order = np.argsort(field.recorded)
    spline = CubicSpline(
        np.cbrt(field.recorded[order]), prediction.shapes.displacement[order], axis=0
    )
    between_frames = replace(
        prediction.shapes, displacement=spline(np.cbrt(specimen.recorded)), derivative={}
    )
    residual = specimen.measured - specimen.observe(between_frames).displacement
    (offset,) = fit.offsets
    if offset is not None:
        at, known = specimen.reference[:, :2], field.reference[:, :2]
        between = griddata(known, offset, at)
        outside = ~np.isfinite(between)
        between[outside] = griddata(known, offset, at, method="nearest")[outside]
        residual = residual - between
    return gap_of([residual], [np.ones(3)], weight)


def _say(name: str) -> Any:
    return lambda what: print(f"{name}: {what}", file=sys.stderr, flush=True)


#: What the pictures of the reports (`--report`) show, in words.
SEEN = """\
The gap has two parts. The larger is the same in every frame: folds and waves of some 20 to 80 mm
and a tilt, which no smooth function of the position follows to the end. They are what the
reference image showed of a fabric that was not flat: bulging takes the creases out, and the
displacement carries them with the opposite sign ever after (`reference_state`, as an offset of
every point; where it pays, with the pressure that flattens them). The rest changes with pressure:
the fabric starts much stiffer than it goes on, along warp above all (`nonlinear_material`, a knee
at 1 to 2 % strain, as coated fabrics have it), the clamp moves and tilts with pressure
(`fixture_motion`), and the values are means over a window as wide as the bins that the fields were
averaged in (`dic_smoothing`, where it was taken). The smaller effects differ from test to test and
are like each other in this data; together they can stand in for something else, so the verdict
stays `unknown`. What is left runs in bands along x that turn their sign between low and high
pressure."""


def page(
    found: Mapping[int, Mapping[str, Any]], left_out: Mapping[int, Mapping[str, Any]], options: str
) -> str:
    """All results as Markdown."""
    parts = [
        "# The gap of the measured tests",
        f"Made by `python benchmarks/gap.py{options}`; Python {platform.python_version()}. Gaps "
        "are mean absolute deviations in mm; e_w weighs dz as the fit's objective does. Held out: "
        "cells of frames and sectors that the fit did not see. Profiles: other data of the same "
        "tests, at full resolution and every recorded frame, over the same pressures.",
        SEEN,
        "## Before and after",
        _table(
            ["test", "verdict", "held-out e_w", "", "less by", "held-out e", "", "profiles e_w", "",
             "less by"],
            [_gap_row(n, d) for n, d in found.items()],
        ),
        "## Moduli",
        _table(
            ["test", *(f"{m} alone" for m in MODULI), *(f"{m} with causes" for m in MODULI)],
            [*(_moduli_row(n, d) for n, d in found.items()), _scatter_row(found)],
        ),
        f"With a knee in the material E1 and E2 are its first slopes. Secant stiffness along warp "
        f"and fill at {100 * SECANT:.0f} % strain, MPa, which the moduli alone are as well:",
        _table(
            ["test", "warp alone", "fill alone", "warp with causes", "fill with causes"],
            _secant_rows(found),
        ),
        "## Two tests together, and the third met with their material",
        "The two share moduli and material effects; up to four effects. Of the third, the clamp, "
        "load, shape and camera alone are fitted, on every second frame, and the gap is that of "
        "the frames between. Before: the two's moduli alone.",
        _table(
            ["left out", "found on the others", "E1", "E2", "G12", "held-out e_w of the others", "",
             "less by", "e_w of the one left out", "", "less by"],
            [_left_out_row(n, d) for n, d in left_out.items()],
        ),
    ]  # fmt: skip
    for n, d in found.items():
        parts += [f"## Test {n}", *_test_parts(d)]
    return "\n\n".join(parts) + "\n"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _lowered(before: float, after: float) -> list[str]:
    return [f"{before:.3f}", f"{after:.3f}", f"{100 * (1 - after / before):.0f} %"]


def _gap_row(n: int, d: Mapping[str, Any]) -> list[str]:
    held, profiles = d["gap"]["heldout"], d["profiles"]
    return [
        f"{n}", d["verdict"],
        *_lowered(held["baseline"]["e_w"], held["explained"]["e_w"]),
        *_lowered(held["baseline"]["e"], held["explained"]["e"])[:2],
        *_lowered(profiles["before"]["e_w"], profiles["after"]["e_w"]),
    ]  # fmt: skip


def _left_out_row(n: int, d: Mapping[str, Any]) -> list[str]:
    held, holdout = d["gap"]["heldout"], d["holdout"]
    return [
        f"{n}", " + ".join(c["effect"] for c in d["causes"]),
        *(f"{d['parameters']['corrected'][m]['value']:.1f}" for m in MODULI),
        *_lowered(held["baseline"]["e_w"], held["explained"]["e_w"]),
        *_lowered(holdout["baseline"]["e_w"], holdout["explained"]["e_w"]),
    ]  # fmt: skip


def _moduli_row(n: int, d: Mapping[str, Any]) -> list[str]:
    both = (d["parameters"]["baseline"], d["parameters"]["corrected"])
    return [f"{n}", *(f"{part[m]['value']:.1f}" for part in both for m in MODULI)]


def _scatter_row(found: Mapping[int, Mapping[str, Any]]) -> list[str]:
    """Standard deviation over mean."""
    out = ["scatter"]
    for part in ("baseline", "corrected"):
        for m in MODULI:
            values = [d["parameters"][part][m]["value"] for d in found.values()]
            out.append(f"{100 * np.std(values, ddof=1) / np.mean(values):.0f} %")
    return out


def _secant_rows(found: Mapping[int, Mapping[str, Any]]) -> list[list[str]]:
    """Stress over strain at `SECANT`, for each test, and the scatter."""
    sides = (("E1", "x"), ("E2", "y"))
    values = [
        [d["parameters"]["baseline"][m]["value"] for m, _ in sides]
        + [_secant(d, m, axis) for m, axis in sides]
        for d in found.values()
    ]
    rows = [[f"{n}", *(f"{v:.1f}" for v in row)] for n, row in zip(found, values, strict=True)]
    scatter = np.std(values, axis=0, ddof=1) / np.mean(values, axis=0)
    return [*rows, ["scatter", *(f"{100 * s:.0f} %" for s in scatter)]]


def _secant(d: Mapping[str, Any], modulus: str, axis: str) -> float:
    """E (1 + k e + s (1 - κ/e atan(e/κ))), as `nonlinear_material` is defined."""
    named = {c["effect"]: c["parameters"] for c in d["causes"]}.get("nonlinear_material", {})
    k, s, knee = (
        named.get(f"{name}_{axis}", {"value": null})["value"]
        for name, null in (("k", 0.0), ("s", 0.0), ("knee", KNEE))
    )
    turned = knee / SECANT * np.arctan(SECANT / knee)
    found = d["parameters"]["corrected"][modulus]["value"]
    return float(found * (1.0 + k * SECANT + s * (1.0 - turned)))


def _test_parts(d: Mapping[str, Any]) -> list[str]:
    noise = d["noise"][0]
    sigma = ", ".join(f"{1e3 * s:.1f}" for s in noise["sigma_mm"])
    parts = [
        f"{d['verdict']}; {d['meta']['seconds']:.0f} s. Noise (dx, dy, dz) {sigma} µm from "
        f"{noise['source']}; chi {d['gap']['heldout']['baseline']['chi']:.1f} before, "
        f"{d['gap']['heldout']['explained']['chi']:.1f} after, on held-out data. Of the noise's "
        f"variance {d['persistent']:.1f} times persists from frame to frame in what is left.",
        "Where the baseline misses most:",
        _table(
            ["component", "region", "bar", "mean, mm", "share"],
            [
                [c["component"], c["region"], "{:.2f} to {:.2f}".format(*c["pressure_band_bar"]),
                 f"{c['mean_mm']:.3f}", f"{100 * c['share']:.1f} %"]
                for c in sorted(d["where"], key=lambda c: -c["share"])[:6]
            ],
        ),
        "What was taken, each judged on held-out data:",
        _table(
            ["step", "effect", "sum of squares before", "after"],
            [
                [f"{k + 1}", r["taken"] or "nothing pays", f"{r['heldout_before']:.3g}",
                 _after(r)]
                for k, r in enumerate(d["tried"])
            ],
        ),
    ]  # fmt: skip
    for c in d["causes"]:
        first = list(c["parameters"].items())[:9]
        values = ", ".join(
            f"{k} {v['value']:.4g} ± {v['stderr']:.1g} {v['unit']}".removesuffix(" 1")
            for k, v in first
        )
        more = f" and {len(c['parameters']) - 9} more" if len(c["parameters"]) > 9 else ""
        bound = "; at the edge of what is plausible" if c["at_bound"] else ""
        parts.append(
            f"- **{c['effect']}**{' (in part)' if c['partial'] else ''}: {values}{more}{bound}. "
            f"{_worth(c['heldout_reduction'])}"
        )
    return parts


def _worth(reduction: float | None) -> str:
    if reduction is None:
        return "Without it the others leave no equilibrium to start a fit from."
    return (
        f"Takes {100 * max(reduction, 0.0):.0f} % of the held-out sum of squares that the others, "
        "refitted, leave."
    )


def _after(found: Mapping[str, Any]) -> str:
    for c in found["candidates"]:
        if c["effect"] == found["taken"]:
            return f"{c['heldout']:.3g}"
    return "-"


def main() -> None:
    """Run, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data/dic"))
    parser.add_argument("--write", type=Path, help="Markdown file")
    parser.add_argument("--json", type=Path, help="keep the diagnoses here")
    parser.add_argument("--report", type=Path, help="draw each diagnosis into a folder of it")
    parser.add_argument("--thorough", action="store_true", help="up to eight effects a test")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers) as pool:
        jobs = {
            n: pool.submit(
                diagnosed,
                args.data / f"valmex_test{n}_binned.npz",
                args.data / f"valmex_test{n}_profiles.npz",
                None if args.report is None else str(args.report / f"test{n}"),
                args.thorough,
            )
            for n in TESTS
        }
        fields = {n: args.data / f"valmex_test{n}_binned.npz" for n in TESTS}
        meetings = {n: pool.submit(met, fields, n) for n in TESTS}
        found = {n: job.result() for n, job in jobs.items()}
        left_out = {n: job.result() for n, job in meetings.items()}
    if args.json:
        kept = {"alone": found, "left out": left_out}
        args.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    text = page(found, left_out, " --thorough" if args.thorough else "")
    if args.write:
        args.write.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
