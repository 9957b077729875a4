"""What a fit found: one complete object, as JSON and as a report to read."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.objective import TestParts
from bulgefit.model.parameters import Material, Parameter
from bulgefit.model.virtual_test import Setup

__all__ = ["FitResult", "Stability", "describe_tests", "versions"]

#: Part of the range between the bounds within which a parameter counts as at its bound.
AT_BOUND = 1e-3


@dataclass(frozen=True)
class Stability:
    """Up to which pressure the fitted model is stable, and the frames measured beyond it.

    Attributes
    ----------
    stable_up_to_bar : float or None
        Highest solved pressure below which no tangent lost its positive definiteness, of the
        specimen that loses it first; None where none does.
    frames_beyond : int
        Frames at higher pressures than their specimen's. There a soft shear modulus lets the law
        localise in bands as wide as a cell: the fields of the model and of the fabric need not
        agree.
    wrinkled : bool
        True where tension-field relaxation was active.
    """

    stable_up_to_bar: float | None
    frames_beyond: int
    wrinkled: bool


@dataclass(frozen=True, eq=False)
class FitResult:
    """The best of several descents, and all of them.

    Attributes
    ----------
    material : Material
        With the best parameters.
    free : tuple of Parameter
        What was varied, with units and bounds.
    objective, value : str, float
        Name of the objective and its value in mm.
    weights : (3,) list
        Of dx, dy, dz in e_w.
    tests : list of TestParts
    descents : list of Descent
        In the order of the starts.
    stability : Stability
    settings : dict
        Everything needed to run the fit again.
    seconds : float
        Wall time.
    sources : list of dict
        Names and checksums of the tests.
    setup : Setup or None
        How the virtual tests were computed; None: the default.
    """

    material: Material
    free: tuple[Parameter, ...]
    objective: str
    value: float
    weights: list[float]
    tests: list[TestParts]
    descents: list[Descent]
    stability: Stability
    settings: dict[str, Any]
    seconds: float
    sources: list[dict[str, Any]] = field(default_factory=list)
    setup: Setup | None = None

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
        value = self.material.values[parameter.name]
        span = parameter.upper - parameter.lower
        return bool(min(value - parameter.lower, parameter.upper - value) <= AT_BOUND * span)

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON types."""
        free = {p.name: p for p in self.free}
        parameters = {}
        for name, value in self.material.values.items():
            entry: dict[str, Any] = {"value": value, "unit": _unit(name)}
            if name in free:
                entry |= {
                    "at_bound": self.at_bound(free[name]),
                    "lower": free[name].lower,
                    "upper": free[name].upper,
                    "free": True,
                }
            else:
                entry |= {"at_bound": False, "free": False}
            parameters[name] = entry
        return {
            "parameters": parameters,
            "objective": {"name": self.objective, "value": self.value, "unit": "mm"},
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

    def report(self) -> str:
        """The result to read."""
        lines = [f"{self.objective} = {self.value:.6g} mm  ({self.material.kind})"]
        free = {p.name: p for p in self.free}
        for name, value in self.material.values.items():
            if name not in free:
                note = "held"
            elif self.at_bound(free[name]):
                low, high = free[name].lower, free[name].upper
                note = f"AT BOUND {low:g}..{high:g}: widen --bounds {name}=..."
            else:
                note = f"in {free[name].lower:g}..{free[name].upper:g}"
            lines.append(
                f"  {name:<5}{value:>12.6g} {_unit(name) if name in free else '':<4} {note}"
            )
        lines.append(
            f"{'test':<28}{'r_dx':>10}{'r_dy':>10}{'r_dz':>10}{'e':>10}{'e_w':>10}{'e_z':>10}"
        )
        lines += [
            f"{p.name[:27]:<28}"
            + "".join(
                f"{'-':>10}" if v is None else f"{v:>10.4f}"
                for v in (p.dx, p.dy, p.dz, p.e, p.e_w, p.e_z)
            )
            for p in self.tests
        ]
        found = [d.best.value for d in self.descents]
        near = sum(v <= self.value * 1.001 for v in found)
        lines.append(
            f"{len(found)} starts, {sum(d.converged for d in self.descents)} converged, {near} at "
            f"this optimum; {self.evaluations} forward paths, {self.failures} failed; "
            f"{self.seconds:.1f} s"
        )
        if self.stability.frames_beyond:
            lines.append(
                f"warning: the model loses stability above {self.stability.stable_up_to_bar:.3g} "
                f"bar (soft shear localises); {self.stability.frames_beyond} frames lie beyond: "
                "judge the fit without them (--max-pressure)"
            )
        return "\n".join(lines)


def _unit(name: str) -> str:
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
    """Names, sources and checksums of the tests that went in."""
    return [
        {
            "name": t.name,
            "source": t.source,
            "sha256": t.checksum,
            "frames": t.n_frames,
            "points": t.n_points,
            "values": t.n_measured,
        }
        for t in tests
    ]


def versions() -> dict[str, str]:
    """Versions of what a number depends on."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in ("bulgefit", "numpy", "scipy", "numba")},
    }
