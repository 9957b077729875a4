"""Which law do the measured tests prefer? Everything at once under each, in the same units.

    python benchmarks/laws.py [--data ../shared/data/dic] [--laws hencky,svk,yarn] [--json FILE]

All effects and the free curve of the law, but no other field, beside offsets of the points. Noise,
offsets' sizes and points in use are those of the first law's fit; the mesh's error is each law's
own. A law that loses ellipticity may end a descent on the edge of stability, which is told.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import bulgefit
from bulgefit.effects.parameter import Owned
from bulgefit.gap.diagnose import _baseline, _lacking
from bulgefit.gap.effects import chosen_effects
from bulgefit.gap.evidence.coordinates import Coordinates, is_field, with_fields
from bulgefit.gap.evidence.creases import Creases, likeliest_offsets, on_points
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.outcome import seen_by
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.explain import START
from bulgefit.gap.prepare import Prepared, correct_discretisation, fix_units, prepare
from bulgefit.gap.residual.measure import gap_of, weight_of
from bulgefit.parallel.threads import one_blas_thread
from gap import FIELDS

#: Of the free fields, those that are the law's.
OF_LAW = (Owned("law_curve"),)


def units_of(p: Prepared) -> tuple[Any, ...]:
    """Noise, its correlation, and what is in use."""
    d = p.data
    return d.sigma, d.inflation, d.persistent, d.used, d.trust


def fitted(
    tests: Sequence[bulgefit.BulgeTest],
    law: str,
    units: Sequence[tuple[Any, ...]] | None,
    offsets: Sequence[Creases] | None,
) -> tuple[dict[str, Any], list[tuple[Any, ...]], Sequence[Creases] | None]:
    """What everything at once comes to under a law, with the units and offsets it was judged by."""
    began = time.monotonic()
    prepared = [prepare(test, law) for test in tests]
    _baseline(prepared)
    wanted = chosen_effects(None)
    effects = with_fields(
        [e for e in wanted if e.id not in _lacking(wanted, tests)], tests, several=True
    )
    data = [p.data for p in prepared]
    coordinates = Coordinates.of(effects, [d.specimen.nulls() for d in data], None)
    layout = Layout.of(coordinates.groups)
    names = [name for name in layout.free if not is_field(name) or name in OF_LAW]
    model = layout.whole(names)
    x = np.concatenate([g.null for g in coordinates.groups])
    x[: len(START)] = np.log([*START.values()])
    for d in data:
        d.specimen.correction = None
    rough = descend(Weighing(data, coordinates), layout, model, x, roughly=True)
    for index, p in enumerate(prepared):
        if units is None:
            fix_units(p, rough.here.near[index])
        else:
            correct_discretisation(p, rough.here.near[index])
            d = p.data
            d.sigma, d.inflation, d.persistent, d.used, d.trust = units[index]
    plain = Weighing(data, coordinates)
    fit = descend(plain, layout, model, rough.x, rough.here.near, roughly=True)
    if offsets is None:
        predictions = seen_by(plain, fit).predictions
        offsets = likeliest_offsets(data, [p.displacement for p in predictions])
    beside = Weighing(data, coordinates, None if offsets is None else on_points(data, offsets))
    fit = descend(beside, layout, model, fit.x, fit.here.near)
    told = told_of(beside, layout, fit)
    told["minutes"] = (time.monotonic() - began) / 60.0
    return {"law": law, **told}, [units_of(p) for p in prepared], offsets


def told_of(weighing: Weighing, layout: Layout, fit: Fit) -> dict[str, Any]:
    """Scores, gaps and values of a fit."""
    seen, data = seen_by(weighing, fit), weighing.data
    weight = weight_of(list(data))
    gaps = []
    for d, prediction in zip(data, seen.predictions, strict=True):
        left = np.where(d.used, d.specimen.measured - prediction.displacement, np.nan)
        gaps.append(gap_of([left], [d.sigma], weight)["e_w"])
    every = weighing.coordinates.every
    columns = layout.columns(fit.model)
    spread = np.sqrt(np.diag(fit.covariance))
    values = {
        str(every[c].key): [
            float(every[c].value(fit.x[c])),
            float((fit.x[c] - layout.null[c]) / layout.width[c]),
            float(spread[k] / layout.width[c]),
        ]
        for k, c in enumerate(columns)
    }
    return {
        "score": fit.score + weighing.cost,
        "chi2_per_value": fit.here.square / (weighing.count * weighing.inflation),
        "converged": fit.converged,
        "steps": fit.steps,
        "e_w": gaps,
        "values": values,
    }


def row(found: dict[str, Any], first: dict[str, Any]) -> str:
    """Of the table."""
    values = found["values"]
    factors = [f"{v[0]:.2f}" for name, v in values.items() if "specimen_factor" in name]
    pulls = sorted(
        ((abs(v[1]), name) for name, v in values.items() if "curve" not in name), reverse=True
    )
    cells = [
        found["law"],
        f"{found['score'] - first['score']:+.0f}",
        "yes" if found["converged"] else "no",
        ", ".join(f"{gap:.3f}" for gap in found["e_w"]),
        ", ".join(f"{values[name][0]:.3g}" for name in ("E1", "E2", "G12")),
        f"{values['poisson_ratio.nu12'][0]:.2f}",
        ", ".join(factors),
        ", ".join(f"{name} {pull:.1f}" for pull, name in pulls[:4] if pull > 2.0),
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Run, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data/dic"))
    parser.add_argument("--laws", default="hencky,svk,yarn", help="apart by commas")
    parser.add_argument("--json", type=Path, help="keep all values here")
    args = parser.parse_args()
    tests = [bulgefit.read_test(args.data / f"{name}.npz") for name in FIELDS.values()]
    found, units, offsets = [], None, None
    with one_blas_thread():
        for law in args.laws.split(","):
            one, units, offsets = fitted(tests, law, units, offsets)
            found.append(one)
            print(f"{law}: {one['minutes']:.1f} minutes", file=sys.stderr, flush=True)
            if args.json:
                args.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    head = [
        "law", "-2 ln Z", "converged", "e_w of each, mm", "E1, E2, G12 at rest, MPa", "nu12",
        "factors", "beyond two prior widths",
    ]  # fmt: skip
    print("| " + " | ".join(head) + " |\n|" + " --- |" * len(head))
    for one in found:
        print(row(one, found[0]))


if __name__ == "__main__":
    main()
