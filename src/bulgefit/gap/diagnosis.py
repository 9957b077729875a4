"""What does a diagnosis hold?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import dataframe, labelled
from bulgefit.dic.suspicions import alarms
from bulgefit.errors import InputError
from bulgefit.fitting.result import versions
from bulgefit.gap.as_json import (
    cells_dict,
    field_dict,
    gaps_dict,
    moduli_dict,
    noise_dict,
    scatter_dict,
    specimens_dict,
    step_dict,
)
from bulgefit.gap.causes import Cause, Verdict
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.follow_up.advise import Advice
from bulgefit.gap.follow_up.holdout import HeldOutTest
from bulgefit.gap.follow_up.separate import Pair
from bulgefit.gap.implied_reference import ImpliedReference
from bulgefit.gap.law_table import LawTable
from bulgefit.gap.prepare import Prepared
from bulgefit.gap.residual.locate import Growth, Mode
from bulgefit.gap.residual.measure import Gap
from bulgefit.gap.scatter import Scatter
from bulgefit.shown import Drawn

__all__ = ["Diagnosis"]

#: Version of the JSON.
FORMAT = 2


@dataclass(eq=False)
class Diagnosis(Drawn):
    """What a diagnosis found; `to_dict` is its JSON.

    Attributes
    ----------
    verdict : Verdict
    causes : list of Cause
    prepared : list of Prepared
    explanation : Explanation
    gaps : dict
        "baseline", "explained", "heldout_baseline", "heldout_explained", "noise_floor".
    modes : list of Mode
        Of the baseline's residual.
    pairs : list of Pair
    advice : list of Advice
    law : LawTable
        Of the cloth.
    scatter : dict of modulus to Scatter
        Of E1 and E2 over specimens; empty for one.
    implied : list of ImpliedReference
        Heights before inflation, test by test.
    skipped : dict of effect to why
    held : dict of name to float
        What was known of every test.
    holdout : HeldOutTest or None
        How a specimen that was kept out is met.
    kept_out : BulgeTest or None
        That specimen, also where it could not be met.
    """

    verdict: Verdict
    causes: list[Cause]
    prepared: list[Prepared]
    explanation: Explanation
    gaps: dict[str, Gap]
    modes: list[Mode]
    pairs: list[Pair]
    advice: list[Advice]
    law: LawTable
    scatter: dict[str, Scatter]
    implied: list[ImpliedReference]
    skipped: dict[str, str]
    tests: list[BulgeTest]
    seed: int
    seconds: float
    held: dict[str, float] = field(default_factory=dict)
    holdout: HeldOutTest | None = None
    kept_out: BulgeTest | None = None
    warnings: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        names = ", ".join(test.name for test in self.tests)
        causes = "; ".join(f"{c.effect} {c.probability:.3g}" for c in self.causes) or "no causes"
        return f"Diagnosis of {names}: {self.verdict} ({causes})"

    @property
    def went_in(self) -> list[BulgeTest]:
        """The tests, and the one that was kept out."""
        return self.tests if self.kept_out is None else [*self.tests, self.kept_out]

    def to_dataframe(self) -> Any:
        """A row a parameter: the moduli with the causes, and each cause's own.

        Names are as a fit has them, `effect.parameter@i` of test i; `probability` is that of the
        cause. Needs `bulgefit[pandas]`.
        """
        rows = {name: {**found, "probability": None} for name, found in
                moduli_dict(self.explanation.final, self.explanation.level).items()}  # fmt: skip
        for cause in self.causes:
            for name, found in cause.parameters.items():
                rows[f"{cause.effect}.{name}"] = {**found, "probability": cause.probability}
        columns = ("value", "stderr", "unit", "probability")
        return dataframe({c: [row[c] for row in rows.values()] for c in columns}, index=list(rows))

    def to_xarray(self, test: int = 0) -> Any:
        """Measured minus modelled (mm) of a test by model, frame, point and component.

        Models are the moduli alone and the one with the causes; NaN where a point was not used.
        Needs `bulgefit[xarray]`.
        """
        if test not in range(len(self.prepared)):
            raise InputError(f"no test {test!r}; give 0 to {len(self.prepared) - 1}")
        data = self.prepared[test].data
        found, seen = self.explanation, data.specimen
        left = [seen.measured - fit.predictions[test].displacement
                for fit in (found.baseline, found.final)]  # fmt: skip
        return labelled(
            np.where(data.used, np.stack(left), np.nan),
            ("model", "frame", "point", "component"),
            {
                "model": ["moduli alone", "with causes"],
                "component": ["dx", "dy", "dz"],
                "pressure_bar": ("frame", 10.0 * seen.recorded),
                **{f"{a}_mm": ("point", seen.reference[:, i]) for i, a in enumerate("xyz")},
            },
            name="residual",
            unit="mm",
        )

    def to_dict(self) -> dict[str, Any]:
        """The diagnosis as JSON types."""
        start, rest = self.explanation.start, self.explanation.remainder
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "causes": [c.to_dict() for c in self.causes],
            "fields": [field_dict(self.explanation, f) for f in self.explanation.fields],
            "gap": gaps_dict(self.gaps, self.prepared),
            "where": cells_dict(start.cells, 40),
            "modes": [m.to_dict() for m in self.modes if m.growth is not Growth.NONE],
            "parameters": {
                "baseline": moduli_dict(self.explanation.baseline),
                "corrected": {
                    **moduli_dict(self.explanation.final, self.explanation.level),
                    **({"secant": self.law.secants()} if self.law.bent else {}),
                },
            },
            "law": self.law.to_dict(),
            "scatter": scatter_dict(self.scatter),
            "specimens": specimens_dict(self.prepared, self.scatter, self.causes),
            "implied_reference": [i.to_dict() for i in self.implied],
            "indistinguishable": [
                {"effects": list(p.effects), "cosine": p.cosine} for p in self.pairs
            ],
            "advice": [
                {
                    "measurement": a.measurement,
                    "separation": a.separation,
                    "between": list(a.between),
                    "specimen": a.specimen,
                    "why": a.why,
                }
                for a in self.advice
            ],
            "remainder": {
                "significant": rest.significant,
                "where": cells_dict(rest.cells, 20) if rest.significant else [],
            },
            "tried": [step_dict(s) for s in self.explanation.steps],
            "others": {str(group): p for group, p in self.explanation.others.items()},
            **({} if self.holdout is None else {"holdout": self.holdout.to_dict()}),
            "skipped": self.skipped,
            "held": self.held,
            "warnings": self.warnings,
            "alarms": [
                f"{test.name}: {alarm.text}; {alarm.remedy}"
                for test in self.tests
                for alarm in alarms(test)
            ],
            "noise": [noise_dict(p) for p in self.prepared],
            "meta": {
                "versions": versions(),
                "seed": self.seed,
                "checksums": {test.name: test.checksum for test in self.went_in},
                "seconds": self.seconds,
            },
        }
