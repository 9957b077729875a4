"""Diagnose the measured tests together and write what was found to docs/gap.md.

    python benchmarks/gap.py [--data ../shared/data/dic] [--write docs/gap.md] [--json FILE]
                             [--report FOLDER] [--left-out] [--law LAW] [--journal FILE]

The specimens are of one cloth: they share its law. Frames are the recorded ones. The profiles (the
same tests on two lines, at full resolution) take no part; they judge the model before and after.
With `--left-out` each test is also met with what the other two say of the cloth, which takes three
times as long again. It takes hours; with `--journal` it goes on from what was done before.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from math import erfc, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, griddata

import bulgefit
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.cut_bins import of_whole_bins
from bulgefit.gap.data import Data
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.measure import gap_of, weight_of
from bulgefit.gap.specimen import Specimen
from bulgefit.parallel.journal import journaled
from bulgefit.parallel.workers import open_executor
from sections import marked, put

Floats = NDArray[np.float64]

#: Recorded frames of each test.
FIELDS = {1: "valmex_test1_binned", 2: "valmex_test2_recorded", 4: "valmex_test4_recorded"}
LAW = "hencky"
#: Strains (%) at which the law is told in docs/gap.md.
STRAINS = (1.0, 2.0, 3.0, 5.0)
#: Parameters of a cause that are told.
MOST = 6
#: Prior widths beyond which a parameter is told.
WIDTHS = 2.0
#: Rings (of the radius) in which the cloth's motion along the rim is told, and orders of its waves.
RINGS, ORDERS = ((0.6, 0.7), (0.7, 0.8), (0.8, 0.9)), (1, 2, 3, 4)


def gaps_of_each(found: Diagnosis, folder: Path) -> dict[str, dict[str, dict[str, float]]]:
    """e_w and the others of each test before and after, on its field and its profiles."""
    data = [p.data for p in found.prepared]
    weight = weight_of(data)
    told: dict[str, dict[str, dict[str, float]]] = {}
    for index, (number, d) in enumerate(zip(FIELDS, data, strict=True)):
        profile = folder / f"valmex_test{number}_profiles.npz"
        for when, fit in (
            ("before", found.explanation.baseline),
            ("after", found.explanation.final),
        ):
            field = d.specimen.measured - fit.predictions[index].displacement
            field = np.where(d.used, field, np.nan)
            told.setdefault(f"{number}", {})[when] = {
                "field": gap_of([field], [d.sigma], weight)["e_w"],
                "profiles": on_profile(profile, fit, index, d, weight),
            }
    return told


def on_profile(path: Path, fit: Regression, index: int, data: Data, weight: float) -> float:
    """e_w of a model on the profiles of a test, over the pressures that were diagnosed.

    The shapes are those that the diagnosis balanced, between its frames by a spline in p^(1/3).
    Offsets of the field's points are taken linearly between them, and from the nearest outside.
    """
    field, prediction, offset = data.specimen, fit.predictions[index], fit.offsets[index]
    test = bulgefit.read_test(path)
    low, high = field.recorded.min(), field.recorded.max()
    test = test.select(frames=np.flatnonzero((test.pressure >= low) & (test.pressure <= high)))
    specimen = Specimen(test, field.setup.refine, field.setup.law)
    order = np.argsort(field.recorded)
    spline = CubicSpline(
        np.cbrt(field.recorded[order]), prediction.shapes.displacement[order], axis=0
    )
    between_frames = replace(
        prediction.shapes, displacement=spline(np.cbrt(specimen.recorded)), derivative={}
    )
    residual = specimen.measured - specimen.observe(between_frames).displacement
    if offset is not None:
        at, known = specimen.reference[:, :2], field.reference[:, :2]
        between = griddata(known, offset, at)
        outside = ~np.isfinite(between)
        between[outside] = griddata(known, offset, at, method="nearest")[outside]
        residual = residual - between
    return gap_of([residual], [np.ones(3)], weight)["e_w"]


def along_the_rim(test: BulgeTest) -> list[list[float]]:
    """Waves sin 2φ and sin 4φ (mm) of the motion about the axis in rings, without a model.

    At the highest pressure, by all frames, in proportion to p^(2/3); φ is counted from warp.
    """
    test, _ = of_whole_bins(test)
    radius, angle, about, load = (
        np.concatenate(parts) for parts in zip(*_about(test), strict=True)
    )
    waves = [np.ones_like(angle)]
    for order in ORDERS:
        waves += [np.sin(order * angle), np.cos(order * angle)]
    told = []
    for inner, outer in RINGS:
        ring = (radius >= inner) & (radius < outer)
        found, *_ = np.linalg.lstsq((load * waves).T[ring], about[ring], rcond=None)
        told.append([float(found[2 * order - 1]) for order in (2, 4)])
    return told


def _about(test: BulgeTest) -> Iterator[tuple[Floats, ...]]:
    """Of each frame: distance over the radius, angle, motion about the axis, (p/p_max)^(2/3)."""
    for pressure, (reference, displacement) in zip(
        test.pressure, map(test.frame, range(test.n_frames)), strict=True
    ):
        known = np.isfinite(displacement).all(axis=1)
        x, y = reference[known, :2].T
        dx, dy = displacement[known, :2].T
        angle = np.arctan2(y, x)
        load = np.full(len(x), (pressure / test.pressure.max()) ** (2.0 / 3.0))
        about = dy * np.cos(angle) - dx * np.sin(angle)
        yield np.hypot(x, y) / test.radius, angle, about, load


def met(paths: Mapping[int, Path], left_out: int, law: str) -> dict[str, Any]:
    """The other tests diagnosed together, and the one left out met with their cloth."""
    tests = {n: bulgefit.read_test(path) for n, path in paths.items()}
    others = [test for n, test in tests.items() if n != left_out]
    return bulgefit.diagnose(
        others, law=law, holdout=tests[left_out], say=_say(f"test {left_out} left out")
    ).to_dict()


def _say(name: str) -> Any:
    return lambda what: print(f"{name}: {what}", file=sys.stderr, flush=True)


def page(record: Mapping[str, Any], left_out: Mapping[str, Mapping[str, Any]], law: str) -> str:
    """All results as Markdown."""
    options = f" --law {law}" * (law != LAW) + " --left-out" * bool(left_out)
    held = record["gap"]["heldout"]
    parts = [
        "# The gap of the measured tests",
        f"Made by `python benchmarks/gap.py{options}`; Python "
        f"{platform.python_version()}. Tests 1, 2 and 4 of one coated fabric, diagnosed together "
        "by their recorded frames; gaps are e_w in mm (mean absolute deviations, dz weighed as "
        "the fit's objective does). Profiles: other data of the same tests, at full resolution.",
        f"**{record['verdict']}**, {record['meta']['seconds'] / 60:.0f} minutes. Held-out e_w "
        f"{held['baseline']['e_w']:.3f} mm by the moduli alone, {held['explained']['e_w']:.3f} mm "
        f"by what was found; noise alone leaves {record['gap']['noise_floor']['e_w']:.3f} mm.",
        _table(["test", "field before", "after", "profiles before", "after"], _gap_rows(record)),
        "## The law",
        *_law(record),
        "## What is sure, and what is a set",
        _table(["cause", "test", "probability", "or", "parameters"], _cause_rows(record)),
        _pulls(record),
        "## What no effect describes",
        _table(["place", "field", "test", "probability", "largest", "where"], _field_rows(record)),
        "## The cloth before inflation",
        "Height over the best plane of the points, at the point nearest the centre, in the "
        "reference image:",
        _table(
            ["test", "mm", "standard error", "root mean square of all points"],
            [
                [r["test"], f"{r['apex_mm']:.2f}", _number(r["stderr"]), f"{r['rms_mm']:.2f}"]
                for r in record["implied_reference"]
            ],
        ),
        "## The cloth at the rim",
        *_rim_rows(record["rim"]),
        "## What to measure next",
        *_advice(record["advice"]),
    ]
    if left_out:
        parts += ["## Each test met with the cloth of the other two", _met(left_out)]
    return "\n\n".join(parts) + "\n"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2g}"


def _gap_rows(record: Mapping[str, Any]) -> list[list[str]]:
    kinds = [(kind, when) for kind in ("field", "profiles") for when in ("before", "after")]
    return [
        [number, *(f"{each[when][kind]:.3f}" for kind, when in kinds)]
        for number, each in record["each"].items()
    ]


def _law(record: Mapping[str, Any]) -> list[str]:
    law, scatter = record["law"], record["scatter"]
    strain = 100.0 * np.array(law["strain"])
    rows = []
    for at in STRAINS:
        if at > strain.max() + 1e-9:
            continue
        place = int(np.argmin(np.abs(strain - at)))
        sides = ("warp_N_per_mm", "fill_N_per_mm")
        cells = [f"{law[side][place]:.3f} ± {law['stderr'][side][place]:.2g}" for side in sides]
        rows.append([f"{at:g} %", *cells])
    spread = ", ".join(
        f"{name} {100 * scatter[name]:.1f} ± {100 * scatter['stderr'][name]:.1f} %"
        for name in ("E1", "E2")
    )
    moduli = ", ".join(
        f"{name} {m['value']:.4g} ± {m['stderr']:.2g} MPa"
        for name, m in record["parameters"]["corrected"].items()
        if name != "secant"
    )
    return [
        "Stress resultant under uniaxial tension (N/mm), with standard errors that hold what shape "
        f"and slack leave open; the tests reach {100 * law['reached']['warp']:.1f} % along warp "
        f"and {100 * law['reached']['fill']:.1f} % along fill:",
        _table(["logarithmic strain", "warp", "fill"], rows),
        f"At rest: {moduli}. Specimens scatter by {spread}.",
    ]


def _cause_rows(record: Mapping[str, Any]) -> list[list[str]]:
    return [
        [
            cause["effect"],
            _test(cause["specimen"]),
            f"{cause['probability']:.3f}",
            ", ".join(cause["alternatives"]),
            _parameters(cause["parameters"]),
        ]
        for cause in record["causes"]
    ]


def _test(specimen: int | None) -> str:
    return "all" if specimen is None else f"{list(FIELDS)[specimen]}"


def _parameters(found: Mapping[str, Mapping[str, Any]]) -> str:
    """The first ones, and how many more there are."""
    told = [
        f"{name} {p['value']:.3g} ± {p['stderr']:.1g} {p['unit']}".removesuffix(" 1")
        for name, p in list(found.items())[:MOST]
    ]
    more = len(found) - len(told)
    return ", ".join([*told, *[f"… and {more} more"] * bool(more)])


def _advice(advice: Sequence[Mapping[str, Any]]) -> list[str]:
    """Measurements, the best first, by what they tell from what; of one pair of effects all."""
    if not advice:
        return ["Nothing: no two effects stand against one another."]
    alone, *further = advice
    first, second = alone["between"]
    return [
        f"By how many standard errors {second}, at a tenth of its plausible range, would show in "
        f"test {_test(alone['specimen'])} beyond what {first} and the moduli can imitate, with one "
        f"further measurement; by the test as it is, {alone['separation']:.3g}:",
        _table(
            ["measurement", "standard errors", "why"],
            [[a["measurement"], f"{a['separation']:.3g}", a["why"]] for a in further],
        ),
    ]


def _pulls(record: Mapping[str, Any]) -> str:
    """How many parameters are beyond two prior widths, and how many would be by chance."""
    pulls = {
        name: abs(parameter["pull"])
        for cause in record["causes"]
        for name, parameter in cause["parameters"].items()
        if parameter["pull"] is not None
    }
    far = sorted((name for name in pulls if pulls[name] > WIDTHS), key=lambda name: -pulls[name])
    told = ", ".join(f"{name} {pulls[name]:.1f}" for name in far)
    chance = len(pulls) * erfc(WIDTHS / sqrt(2.0))
    return (
        f"Of {len(pulls)} parameters of causes {len(far)} are beyond {WIDTHS:g} prior "
        f"widths, where chance puts up to {chance:.1f} if priors hold{': ' * bool(far)}{told}."
    )


def _field_rows(record: Mapping[str, Any]) -> list[list[str]]:
    return [
        [
            field["place"],
            field["field"],
            _test(field["specimen"]),
            f"{field['probability']:.3f}",
            f"{field['largest']:.3g} ± {field['stderr']:.1g} {field['unit']}".removesuffix(" 1"),
            ", ".join(f"{name} {value:.3g}" for name, value in field["where"].items()),
        ]
        for field in record["fields"]
    ]


def _rim_rows(rim: Mapping[str, Sequence[Sequence[float]]]) -> list[str]:
    rows = [[n, *(f"{v:.3f}" for ring in rings for v in ring)] for n, rings in rim.items()]
    rings = [f"{inner:g} to {outer:g} of the radius" for inner, outer in RINGS]
    return [
        "How far points near the rim have moved along it at the highest pressure (mm), as "
        "measured, by waves of the angle from warp:",
        _table(["test", *(f"sin {m}φ, {ring}" for ring in rings for m in (2, 4))], rows),
    ]


def _met(left_out: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for number, d in left_out.items():
        gaps = [f"{d['holdout'][when]['e_w']:.3f}" for when in ("baseline", "explained")]
        rows.append([number, d["verdict"], *gaps])
    return _table(["left out", "verdict of the others", "e_w before", "after"], rows)


def main() -> None:
    """Run, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data/dic"))
    parser.add_argument("--write", type=Path, help="Markdown file")
    parser.add_argument("--json", type=Path, help="keep the diagnoses here")
    parser.add_argument("--report", type=Path, help="draw the joint diagnosis into this folder")
    parser.add_argument("--left-out", action="store_true", help="meet each test with the others")
    parser.add_argument("--law", default=LAW, help="hencky, svk or yarn (default: %(default)s)")
    parser.add_argument("--journal", type=Path, help="keep what is done here, and go on from it")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    paths = {n: args.data / f"{name}.npz" for n, name in FIELDS.items()}
    tests = [bulgefit.read_test(path) for path in paths.values()]
    asked = {
        "version": bulgefit.__version__,
        "law": args.law,
        "tests": [test.checksum for test in tests],
        "left out": args.left_out,
    }
    journal = journaled(args.journal, asked, resume=True) if args.journal else nullcontext()
    with journal, open_executor(args.workers, processes=True) as pool:
        found = bulgefit.diagnose(
            tests, law=args.law, executor=pool, workers=args.workers, say=_say("together")
        )
        left_out = {f"{n}": met(paths, n, args.law) for n in FIELDS} if args.left_out else {}
    rim = {f"{n}": along_the_rim(test) for n, test in zip(FIELDS, tests, strict=True)}
    record = {**found.to_dict(), "each": gaps_of_each(found, args.data), "rim": rim}
    if args.report is not None:
        from bulgefit.report.diagnosis import write_report

        write_report(found, args.report, force=True)
    if args.json:
        kept = {"together": record, "left out": left_out}
        args.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    text = page(record, left_out, args.law)
    if args.write:
        put(marked("gap", text), args.write)
    print(text)


if __name__ == "__main__":
    main()
