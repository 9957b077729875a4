"""What a fit found: one complete object, as JSON and as a report to read."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import Rows, Tabled
from bulgefit.effects.parameter import Key, Parameter, by_key, of_specimen
from bulgefit.effects.registry import parameter_named
from bulgefit.fitting.beliefs import Belief
from bulgefit.fitting.free import at_end
from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.objective import LIKELIHOOD, TestParts
from bulgefit.fitting.options import FitOptions
from bulgefit.fitting.quality import Quality
from bulgefit.fitting.uncertainty import Uncertainty
from bulgefit.model.parameters import Material
from bulgefit.model.setup import Setup
from bulgefit.shown import Drawn, after_value, number_of

__all__ = ["FORMAT", "FitResult", "Stability", "describe_tests", "unit_of", "versions"]

#: Version of the layout of the JSON.
FORMAT = 2


@dataclass(frozen=True)
class Stability:
    """Up to which pressure the fitted model is stable, and the frames measured beyond it.

    Attributes
    ----------
    stable_up_to_bar : float or None
        Highest pressure of a frame, as its test shows it, below all frames whose tangent is not
        positive definite, of the specimen that loses it first; None where none does.
    frames_beyond : int
        Frames whose tangent is not. There a soft shear modulus lets the law
        localise in bands as wide as a cell: the fields of the model and of the fabric need not
        agree.
    wrinkled : bool
        True where tension-field relaxation was active.
    """

    stable_up_to_bar: float | None
    frames_beyond: int
    wrinkled: bool


@dataclass(frozen=True, eq=False)
class FitResult(Drawn, Tabled):
    """The best of several descents, and all of them.

    As a table: a row a parameter, with value, unit, standard error, 95 % interval and bounds.

    Attributes
    ----------
    material : Material
        With the best parameters.
    effects : dict of str to float
        Values of effects' parameters (`effect.parameter`), fitted or held off their null.
    free : tuple of Parameter
        What was varied, with units and bounds; `effect.parameter@i` is test i's own.
    objective, value : str, float
        Name of the objective and its value (mm, or 1 of the likelihood).
    weights : (3,) list
        Of dx, dy, dz in e_w.
    tests : list of TestParts
    descents : list of Descent
        In the order of the starts.
    stability : Stability
    uncertainty : Uncertainty
    beliefs : list of Belief
        Each prior, and what is found without it.
    quality : Quality
    options : FitOptions
        Everything needed to run the fit again.
    settings : dict
        The same for JSON.
    seconds : float
        Wall time.
    sources : list of dict
        Names and checksums of the tests.
    """

    material: Material
    effects: dict[str, float]
    free: tuple[Parameter, ...]
    objective: str
    value: float
    weights: list[float]
    tests: list[TestParts]
    descents: list[Descent]
    stability: Stability
    uncertainty: Uncertainty
    beliefs: list[Belief]
    quality: Quality
    options: FitOptions
    settings: dict[str, Any]
    seconds: float
    sources: list[dict[str, Any]] = field(default_factory=list)

    @property
    def setup(self) -> Setup | None:
        """How the virtual tests were computed; None: the default."""
        return self.options.setup

    def effects_of(self, test: int) -> dict[str, float]:
        """Effects' parameters of a test by `effect.parameter`, for `bulgefit.predict`."""
        return of_specimen(by_key(self.effects), test)

    @property
    def evaluations(self) -> int:
        """Forward paths of all starts."""
        return sum(len(d.history) for d in self.descents)

    @property
    def failures(self) -> int:
        """Evaluations whose solve failed."""
        return sum(d.failures for d in self.descents)

    def at_bound(self, parameter: Parameter) -> bool:
        """Whether a free parameter ended at one of its bounds."""
        values = {**self.material.values, **self.effects}
        return at_end(parameter, values[parameter.name])

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON types."""
        free = {p.name: p for p in self.free}
        parameters = {}
        for name, value in {**self.material.values, **self.effects}.items():
            entry: dict[str, Any] = {"value": value, "unit": unit_of(name, free)}
            if name in free:
                low_high = self.uncertainty.interval95[name]
                entry |= {
                    "at_bound": self.at_bound(free[name]),
                    "lower": free[name].lower,
                    "upper": free[name].upper,
                    "free": True,
                    "stderr": self.uncertainty.stderr[name],
                    "interval95": None if low_high is None else list(low_high),
                    "stderr_noise": self.uncertainty.noise_stderr[name],
                    "stderr_blocks": self.uncertainty.block_stderr[name],
                    "stderr_parts": self.uncertainty.parts.get(name, {}),
                }
            else:
                entry |= {"at_bound": False, "free": False}
            parameters[name] = entry
        return {
            "parameters": parameters,
            "format": FORMAT,
            "objective": {"name": self.objective, "value": self.value, "unit": self._unit},
            "quality": self.quality.to_dict(),
            "correlations": [
                {"parameters": list(pair), "correlation": value}
                for pair, value in self.uncertainty.correlation.items()
            ],
            "priors": [belief.to_dict() for belief in self.beliefs],
            "material": self.material.kind,
            "weight": self.weights[2],
            "weights": self.weights,
            "tests": [asdict(parts) for parts in self.tests],
            "evaluations": self.evaluations,
            "failures": self.failures,
            "starts": [_start_dict(d) for d in self.descents],
            "stability": asdict(self.stability),
            "settings": self.settings,
            "seconds": self.seconds,
            "sources": self.sources,
            "versions": versions(),
        }

    def _rows(self) -> Rows:
        rows = self.to_dict()["parameters"]
        columns = ("value", "unit", "free", "stderr", "interval95", "lower", "upper", "at_bound")
        table = {name: [row.get(name) for row in rows.values()] for name in columns}
        return Rows("parameter", table, list(rows))

    @property
    def _unit(self) -> str:
        return "1" if self.objective == LIKELIHOOD else "mm"

    def _sure_of(self, parameter: Parameter) -> str:
        """Error and interval of a free parameter, or why there is none."""
        if self.at_bound(parameter):
            low, high = parameter.lower, parameter.upper
            return f"AT BOUND {low:g}..{high:g}: no result; widen --bounds {parameter.name}=..."
        error = self.uncertainty.stderr[parameter.name]
        ends = self.uncertainty.interval95[parameter.name]
        if error is None or ends is None:
            return "not determined"
        return f"± {error:.3g}  (95 %: {ends[0]:.6g} to {ends[1]:.6g})"

    def _hardly_found(self) -> list[str]:
        """Parameters that are not found well, in words."""
        words = self.quality.identifiability
        return [text for text in words.values() if "hardly" in text or "cannot" in text]

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """The result to read."""
        lines = self.quality.lines()
        reached = f"{self.value:.6g}{after_value(self._unit)}"
        lines.append(f"{self.objective} = {reached}  ({self.material.kind})")
        free = {p.name: p for p in self.free}
        known = {**self.material.values, **self.effects}
        width = max(5, *(len(name) for name in known)) + 1
        for name, value in known.items():
            unit = unit_of(name, free)
            shown = f"  {name:<{width}}{value:>12.6g} {'' if unit == '1' else unit:<4} "
            lines.append(shown + (self._sure_of(free[name]) if name in free else "held"))
        lines += [belief.line(unit_of(belief.name, free)) for belief in self.beliefs]
        for name in self.uncertainty.differing():
            noise, block = (
                errors[name]
                for errors in (self.uncertainty.noise_stderr, self.uncertainty.block_stderr)
            )
            lines.append(
                f"  {name}: standard error {noise:.3g} by the noise alone, {block:.3g} by blocks "
                "of frames and sectors; the larger one is told"
            )
        lines += [f"  {text}" for text in self._hardly_found()]
        names = max(28, *(len(p.name) + 1 for p in self.tests))
        lines.append(
            f"{'test (mm)':<{names}}"
            f"{'r_dx':>10}{'r_dy':>10}{'r_dz':>10}{'e':>10}{'e_w':>10}{'e_z':>10}"
        )
        lines += [
            f"{p.name:<{names}}"
            + "".join(
                f" {'-':>9}" if v is None else f" {v:>9.4f}"
                for v in (p.dx, p.dy, p.dz, p.e, p.e_w, p.e_z)
            )
            for p in self.tests
        ]
        lines.append(
            f"{number_of(len(self.descents), 'start')}, "
            f"{sum(d.converged for d in self.descents)} converged, "
            f"{self.quality.agreeing} at this optimum; {self.evaluations} forward paths, "
            f"{self.failures} failed; {self.seconds:.1f} s"
        )
        if self.stability.frames_beyond:
            lines.append(
                f"warning: the model is stable up to {self.stability.stable_up_to_bar:.3g} bar "
                f"(soft shear localises), not in {self.stability.frames_beyond} frames: "
                "judge the fit without them (--max-pressure)"
            )
        return "\n".join(lines)


def unit_of(name: str, free: Mapping[str, Parameter] | None = None) -> str:
    """The unit of a parameter, told by its name where it is none of those that are free."""
    if free and name in free:
        return free[name].unit
    key = Key.read(name)
    if key.effect:
        return parameter_named(key.name).unit
    return "1" if name.startswith("nu") else "MPa"


def _start_dict(descent: Descent) -> dict[str, Any]:
    return {
        "start": descent.start,
        "parameters": descent.best.values,
        "objective": descent.best.value if np.isfinite(descent.best.value) else None,
        "converged": descent.converged,
        "reason": descent.reason,
        "evaluations": len(descent.history),
        "failures": descent.failures,
        "history": [
            {
                "parameters": e.values,
                "objective": e.value if np.isfinite(e.value) else None,
                **({"error": e.error} if e.error else {}),
            }
            for e in descent.history
        ],
    }


def describe_tests(tests: Sequence[BulgeTest]) -> list[dict[str, Any]]:
    """Names, sources and checksums of the tests that went in, and how they were mounted."""
    return [
        {
            "name": t.name,
            "source": t.source,
            "sha256": t.checksum,
            "frames": t.n_frames,
            "points": t.n_points,
            "values": t.n_measured,
            "semi_axes_mm": t.semi_axes.tolist(),
            "thickness_mm": t.thickness,
            **({} if t.warp_angle is None else {"warp_angle_degree": t.warp_angle}),
        }
        for t in tests
    ]


def versions() -> dict[str, str]:
    """Versions of what a number depends on."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in ("bulgefit", "numpy", "scipy", "numba")},
    }
