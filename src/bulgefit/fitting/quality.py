"""How good is a fit? Misfit over noise, what it explains, what is structure, what to be told."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.noise import Noise
from bulgefit.dic.suspicions import alarms
from bulgefit.dic.suspicions.bins import about_bins
from bulgefit.dic.suspicions.points import about_apex_hole
from bulgefit.effects.parameter import Parameter
from bulgefit.fitting.beliefs import Belief
from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.optima import elsewhere, of_equal_worth
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.uncertainty import Uncertainty
from bulgefit.model.inflation import Shapes
from bulgefit.model.mesh_error import is_taken_off
from bulgefit.shown import after_value, number_of, plain

__all__ = ["Doubt", "Quality", "Warned", "quality_of"]

Floats = NDArray[np.floating]

#: Standard errors up to which a parameter is found well, roughly, hardly: over its value, and of an
#: effect over its distance from the null, or what it was thought to be off by where that is more.
_WELL, _ROUGHLY, _HARDLY = 0.05, 0.25, 1.0
#: A fit that explains less of the measured displacement leaves more than it explains.
_LEAST_EXPLAINED = 0.5
#: Share of the square misfit that is no noise, beyond which the model lacks more than the test is
#: unsure of.
_MOSTLY = 0.5
#: Correlations above which two parameters cannot be told apart by a fit.
_ALIKE = 0.98


class Doubt(Enum):
    """What makes a fit doubtful, in words; its code is the name in small letters."""

    AT_BOUND = (
        "{name} = {value:.4g} is the bound of the search, and no result: widen "
        "--bounds {name}={lower:.4g}:{upper:.4g}, or hold it"
    )
    WORSE_THAN_UNDEFORMED = (
        "the fit is worse than a model that does not deform: look at the units, axes and "
        "pressures of the test (bulgefit info)"
    )
    EXPLAINS_LITTLE = (
        "the fit explains only {share:.0f} % of the measured displacement, and leaves more than "
        "that: something else than a bulge of this clamp was measured (bulgefit info, "
        "bulgefit show)"
    )
    MODEL_LACKS = (
        "{share} % of the square misfit is no noise: the test has something that the model has "
        "not, and parameters may be off by more than their intervals; bulgefit diagnose looks for "
        "it"
    )
    OTHER_OPTIMUM = (
        "{other} fit as well as {this}, and worse lies between: the data do not tell which; hold "
        "one of them, or give a --prior"
    )
    UNDETERMINED = (
        "{names} cannot be found from this test, other values fit as well: hold what is known, or "
        "fit more of what was measured (--objective e_w)"
    )
    NO_START_CONVERGED = "no start converged: raise --max-evaluations or --starts"
    STARTS_DISAGREE = "only one of {starts} starts ended at this optimum: raise --starts"
    TOO_FEW_POINTS = (
        "{points} for {parameters} parameters: they cannot all be found; fit the fields "
        "(--objective e_w), or fewer parameters"
    )
    INSEPARABLE = "{first} and {second} cannot be told apart (correlation {by:.3f}): hold one"
    PRIOR_CONFLICT = (
        "{name}: the prior, {mean:.6g} ± {deviation:.3g}, and what is found without it, "
        "{alone:.6g} ± {stderr:.3g}, are {apart:.3g} combined standard errors apart: one of them "
        "is wrong; look at the prior and its unit, and at the test, and leave out what is wrong"
    )
    NOISE_UNKNOWN = (
        "the noise of {names} is not known: too few points show all of dx, dy and dz at once; "
        "whether the model lacks something there is not judged: give more points or images at "
        "rest (--at-rest), or fit them beside a test that has them"
    )
    MESH_ERROR_UNKNOWN = "the mesh's error could not be found and is in the fit"
    MESH_REMAINDER_UNKNOWN = (
        "what is left of the mesh's error is not known: no coarser mesh tells it; raise --refine"
    )
    MESH_ERROR_LARGE = (
        "what is left of the mesh's error is more than a third of the noise: raise --refine"
    )
    STATED_UNKNOWN = (
        "the errors are without that of {name}: as it is stated (--uncertainty), there is no "
        "equilibrium; state less"
    )

    def of(self, **words: str | float) -> Warned:
        """The doubt about one fit."""
        return Warned(self.name.lower(), self.value.format(**words))


@dataclass(frozen=True)
class Warned:
    """Something that a user of the result must know.

    Attributes
    ----------
    code : str
        Stable, for scripts.
    text : str
    """

    code: str
    text: str


@dataclass(frozen=True, eq=False)
class Quality:
    """How good a fit is.

    Attributes
    ----------
    misfit_over_noise : float or None
        Root mean square residual over the noise, 1 where noise alone is left, of the tests whose
        noise is known; None where too little was measured to tell that of any.
    explained_share : float
        Of the objective of a model that does not deform, how much the fit takes off.
    structured_share : float or None
        Of the mean square residual, how much is not noise.
    mesh_error_mm : list of three floats, or None
        What is left of the mesh's error in dx, dy, dz; None where it is not known.
    noise_mm : list of three floats or None
        Of dx, dy, dz: the least of all tests whose noise is known.
    agreeing, starts : int
        Starts that ended at the optimum, and all.
    identifiability : dict of name to str
        In words.
    warnings : list of Warned
    """

    misfit_over_noise: float | None
    explained_share: float
    structured_share: float | None
    mesh_error_mm: list[float] | None
    noise_mm: list[float] | None
    agreeing: int
    starts: int
    identifiability: dict[str, str]
    warnings: list[Warned]

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "misfit_over_noise": self.misfit_over_noise,
            "explained_share": self.explained_share,
            "structured_share": self.structured_share,
            "mesh_error_mm": self.mesh_error_mm,
            "noise_mm": self.noise_mm,
            "agreeing_starts": self.agreeing,
            "identifiability": self.identifiability,
            "warnings": [{"code": w.code, "text": w.text} for w in self.warnings],
        }

    def lines(self) -> list[str]:
        """The first lines of a report."""
        parts = []
        if self.misfit_over_noise is not None:
            parts.append(f"misfit {self.misfit_over_noise:.3g} times the noise")
        explained = plain(100 * self.explained_share, 4)
        parts.append(f"{explained} % of the measured displacement explained")
        if self.structured_share is not None:
            structured = plain(100 * self.structured_share, 3)
            parts.append(f"{structured} % of the square misfit is structure")
        parts.append(f"{self.agreeing} of {self.starts} starts agree")
        head = "; ".join(parts)
        if self.mesh_error_mm is not None:
            left = ", ".join(plain(1000 * e, 2) for e in self.mesh_error_mm)
            head += f"\nleft of the mesh's error: {left} µm in dx, dy, dz"
            if self.noise_mm is not None:
                noise = ", ".join(plain(1000 * s, 2) for s in self.noise_mm)
                head += f", beside a noise of {noise} µm"
        return [*(f"WARNING: {w.text}" for w in self.warnings), head]


def quality_of(
    problem: Problem,
    z: Floats,
    value: float,
    shapes: Sequence[Shapes],
    descents: Sequence[Descent],
    errors: Uncertainty,
    bounded: NDArray[np.bool_],
    left: Sequence[Noise | None],
    beliefs: Sequence[Belief],
) -> Quality:
    """Judge a fit at its optimum; `left` is the noise of each test there."""
    objective = problem.objective
    misfit = _misfit(objective, shapes, left)
    structured = None if misfit is None else float(max(0.0, 1.0 - 1.0 / max(misfit, 1e-9) ** 2))
    worst = objective.value(None)
    explained = 1.0 - value / worst if worst > 0.0 else 0.0
    equal = of_equal_worth(descents)
    others = elsewhere(problem, z, equal, errors.stderr)
    agreeing = len(equal) - len(others)
    known = [noise.sigma for noise in left if noise is not None]
    noise = np.min(known, axis=0).tolist() if known else None
    values = problem.values(z)
    words = {p.name: _words(p, values[p.name], errors.stderr[p.name]) for p in problem.free}
    return Quality(
        misfit,
        explained,
        structured,
        errors.mesh_error_mm,
        noise,
        agreeing,
        len(descents),
        words,
        [
            *(
                Warned(alarm.code, f"{test.name}: {alarm.text}; {alarm.remedy}")
                for test in objective.tests
                for alarm in alarms(test)
            ),
            *(
                Warned(said.code, f"{test.name}: {said.text}; {said.remedy}")
                for test in objective.tests
                for said in (*about_apex_hole(test), *about_bins(test))
            ),
            *_about_result(problem, z, bounded, explained, descents),
            *_about_structure(structured, explained),
            *_about_errors(problem, z, bounded, errors, words),
            *(_of_conflict(belief) for belief in beliefs if belief.conflicts),
            *_about_search(problem, z, descents, others, agreeing),
            *_about_noise(objective, left),
            *_about_mesh(problem, shapes, errors, noise),
        ],
    )


def _misfit(
    objective: Objective, shapes: Sequence[Shapes], noises: Sequence[Noise | None]
) -> float | None:
    """Root mean square residual over the noise, of the tests whose noise is known."""
    total, count = 0.0, 0
    for look in objective.looks(shapes, sampled=True):
        if (noise := noises[look.test]) is None:
            continue
        units = look.residual / noise.sigma
        total += float(np.nansum(units**2))
        count += int(np.isfinite(units).sum())
    return float(np.sqrt(total / count)) if count else None


def _words(parameter: Parameter, value: float, error: float | None) -> str:
    """How well a parameter is found."""
    name, width = parameter.name, parameter.prior
    of_effect, size = _size(parameter, value)
    if error is None or error > _HARDLY * size:
        return f"{name} cannot be found from this test"
    share = f"{plain(100 * error / size, 2)} %"
    if error > _ROUGHLY * size:
        of = "what was thought possible" if of_effect and size == width else "it"
        return f"{name} is hardly found: its standard error is {share} of {of}"
    within = f"{error:.2g}{after_value(parameter.unit)}" if of_effect else share
    roughly = "" if error <= _WELL * size else " roughly,"
    return f"{name} is found{roughly} within {within}"


def _size(parameter: Parameter, value: float) -> tuple[bool, float]:
    """Whether a parameter is an effect's, and what its error is measured by.

    Of an effect that is absent the value is all but nothing, however well that is known. So it is
    what was thought possible, where its distance from the null is less.
    """
    null, width = parameter.null, parameter.prior
    if null is None or math.isinf(width):
        return False, abs(value)
    return True, max(abs(value - null), width)


def _is_well_found(parameter: Parameter, value: float, error: float | None) -> bool:
    return error is not None and error <= _WELL * _size(parameter, value)[1]


def _about_result(
    problem: Problem,
    z: Floats,
    bounded: NDArray[np.bool_],
    explained: float,
    descents: Sequence[Descent],
) -> Iterator[Warned]:
    """Whether there is a result at all."""
    values = problem.values(z)
    for p, at in zip(problem.free, bounded, strict=True):
        if at:
            yield Doubt.AT_BOUND.of(name=p.name, value=values[p.name], lower=p.lower, upper=p.upper)
    if explained < 0.0:
        yield Doubt.WORSE_THAN_UNDEFORMED.of()
    elif explained < _LEAST_EXPLAINED:
        yield Doubt.EXPLAINS_LITTLE.of(share=100 * explained)
    if not any(d.converged for d in descents):
        yield Doubt.NO_START_CONVERGED.of()


def _about_structure(structured: float | None, explained: float) -> Iterator[Warned]:
    """Whether more of what is left is structure than noise; where the fit is one at all."""
    if structured is not None and structured > _MOSTLY and explained >= _LEAST_EXPLAINED:
        yield Doubt.MODEL_LACKS.of(share=plain(100 * structured, 3))


def _about_noise(objective: Objective, left: Sequence[Noise | None]) -> Iterator[Warned]:
    """Which tests cannot be judged by their noise."""
    unknown = [test.name for test, n in zip(objective.tests, left, strict=True) if n is None]
    if unknown:
        yield Doubt.NOISE_UNKNOWN.of(names=" and ".join(unknown))


def _about_errors(
    problem: Problem,
    z: Floats,
    bounded: NDArray[np.bool_],
    errors: Uncertainty,
    words: Mapping[str, str],
) -> Iterator[Warned]:
    """What cannot be said of the parameters."""
    points = _points(problem.objective)
    if problem.size > 1 and points < problem.size:
        count = number_of(points, "point")
        yield Doubt.TOO_FEW_POINTS.of(points=count, parameters=problem.size)
    values = problem.values(z)
    well = {p.name: _is_well_found(p, values[p.name], errors.stderr[p.name]) for p in problem.free}
    for (a, b), correlation in errors.data_correlation.items():
        # where both are known, be it by a prior, they are told apart however alike they act
        if abs(correlation) > _ALIKE and not (well[a] and well[b]):
            yield Doubt.INSEPARABLE.of(first=a, second=b, by=correlation)
    # an effect that is not seen may be absent
    lost = [
        str(key)
        for key, at in zip(problem.keys, bounded, strict=True)
        if not at and not key.effect and "cannot" in words[str(key)]
    ]
    if lost:
        yield Doubt.UNDETERMINED.of(names=" and ".join(lost))
    for name in errors.unknown:
        yield Doubt.STATED_UNKNOWN.of(name=name)


def _of_conflict(belief: Belief) -> Warned:
    told = belief.to_dict()
    return Doubt.PRIOR_CONFLICT.of(
        name=belief.name,
        mean=told["mean"],
        deviation=told["deviation"],
        alone=told["without"],
        stderr=told["stderr_without"],
        apart=told["apart"],
    )


def _about_search(
    problem: Problem,
    z: Floats,
    descents: Sequence[Descent],
    others: Sequence[Descent],
    agreeing: int,
) -> Iterator[Warned]:
    """Whether there may be a better optimum, or is another one."""
    if not any(d.converged for d in descents):
        return
    if others:
        values = problem.values(z)
        this, other = (
            ", ".join(f"{name} = {found[name]:.4g}" for name in values)
            for found in (values, others[0].best.values)
        )
        yield Doubt.OTHER_OPTIMUM.of(this=this, other=other)
    elif agreeing == 1 and len(descents) > 1:
        yield Doubt.STARTS_DISAGREE.of(starts=len(descents))


def _about_mesh(
    problem: Problem, shapes: Sequence[Shapes], errors: Uncertainty, noise: list[float] | None
) -> Iterator[Warned]:
    """Whether the mesh's error is in the result."""
    left = errors.mesh_error_mm
    if left is None and problem.objective.setup.corrects_mesh:
        every = zip(problem.objective.virtual, shapes, strict=True)
        done = all(is_taken_off(virtual, there) for virtual, there in every)
        yield (Doubt.MESH_REMAINDER_UNKNOWN if done else Doubt.MESH_ERROR_UNKNOWN).of()
    elif left is not None and noise is not None and (np.array(left) > np.array(noise) / 3).any():
        yield Doubt.MESH_ERROR_LARGE.of()


def _points(objective: Objective) -> int:
    """Different points that the objective looks at."""
    return len({(i, v.block, int(k)) for i, v, chunk in objective.places() for k in chunk[:1000]})
