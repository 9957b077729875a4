"""How sure is a fit? Standard errors from the residuals that it leaves.

At the optimum of Σ ρ(r) the estimate is off by A⁻¹ Σ ψ J, with ψ = ρ' and A = Σ E[ρ''] J Jᵀ, so
its covariance is A⁻¹ B A⁻¹ with B that of the sum (Huber, 1967, the sandwich). B is taken from
(`bulgefit.fitting.scores`)

* pairs of neighbours in a frame, as far as the noise's correlation reaches: noise alone,
* blocks of frames times sectors of the disc: also what the model misses, which changes slowly with
  pressure and place. It is the expectation of the bootstrap over them.

A prior is one more datum: a mean m that was drawn about the truth with a deviation s. It adds
w ½ ((x - m)/s)² to the objective, w = 1 in a likelihood and F v/n in a sum of absolute deviations
(`Problem.pull`), so that A gains H = w/s², and B the variance of the score w (x - m)/s², which is
w²/s² = w H. Of normal data and a prior, where w = 1 and B = A, A⁻¹ B A⁻¹ = 1/(1/σ² + 1/s²) is the
posterior's variance; where the prior outweighs the data it tends to w H/H² = s², where they
outweigh it to what they say alone.

To this come what is left of the mesh's error, and stated uncertainties of thickness, radius,
pressure and nu12, by what they move the optimum. The wider one of the two is told; both where they
differ by more than a fifth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf
from scipy.stats import t as student

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.noise import Noise
from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import parameter_named
from bulgefit.errors import BulgefitError, InputError
from bulgefit.fem.mesh import Mesh
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.scores import Changed, Scores
from bulgefit.model.description import CONSTANTS
from bulgefit.model.inflation import Shapes
from bulgefit.model.mesh_error import mesh_remainder
from bulgefit.model.parameters import HELD_BY_DEFAULT, Material, parameters_of
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["UNCERTAIN", "Uncertainty", "check_stated", "uncertainty_of"]

Floats = NDArray[np.floating]

#: What may be stated to be uncertain.
UNCERTAIN = ("thickness", "radius", "pressure", "nu12")
#: Share by which both estimates may differ without a word.
_ALIKE = 0.2
_LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Errors of the free parameters.

    Attributes
    ----------
    covariance : (free, free) array
        Of the coordinates in which the problem steps; rows of zeros for what sits at a bound.
    stderr : dict of name to float or None
        In the parameter's unit; None at a bound, or where nothing tells it.
    interval95 : dict of name to (low, high) or None
    noise_stderr, block_stderr : dict of name to float or None
        By neighbours in a frame, and by blocks of frames and sectors; each with the priors'.
    parts : dict of name to dict
        Standard deviation by source: "data", "prior", "mesh", and what was stated.
    correlation : dict of (name, name) to float
    data_correlation : dict of (name, name) to float
        Of what the data and the priors leave open: a thickness that is stated to be uncertain
        makes all moduli alike, and says nothing of whether they can be told apart.
    mesh_error_mm : list of three floats, or None
        What is left of the mesh's error in dx, dy, dz, the largest of the tests.
    unknown : tuple of str
        What was stated to be uncertain and could not be taken in: with it there is no equilibrium.
    """

    covariance: Floats
    stderr: dict[str, float | None]
    interval95: dict[str, tuple[float, float] | None]
    noise_stderr: dict[str, float | None]
    block_stderr: dict[str, float | None]
    parts: dict[str, dict[str, float]]
    correlation: dict[tuple[str, str], float]
    data_correlation: dict[tuple[str, str], float]
    mesh_error_mm: list[float] | None
    unknown: tuple[str, ...] = ()

    def differing(self) -> list[str]:
        """Parameters whose errors by the two estimates differ by more than a fifth."""
        out = []
        for name, noise in self.noise_stderr.items():
            block = self.block_stderr[name]
            if noise and block and abs(block - noise) > _ALIKE * max(noise, block):
                out.append(name)
        return out


#: Eigenvalues below this part of the largest are rounding.
_NOTHING = 1e-12
#: Steps of `_moved` end where they change by this part, of which a standard error shows no digit.
_STEP_TO, _MOST_STEPS = 1e-3, 100


def uncertainty_of(
    problem: Problem,
    z: Floats,
    shapes: list[Shapes],
    at_bound: NDArray[np.bool_],
    stated: Mapping[str, float],
    noises: Sequence[Noise | None],
) -> Uncertainty:
    """Errors of a fit's optimum.

    Parameters
    ----------
    problem : Problem
    z : (free,) array
        Coordinates of the optimum.
    shapes : list of Shapes
        There, with derivatives by all that is free.
    at_bound : (free,) bool array
        Parameters at a bound: they are held there for the errors of the others.
    stated : mapping
        See `FitOptions.uncertainty`; what `check_stated` lets pass.
    noises : sequence of Noise or None
        Of each test, at the optimum (`noise_left`).
    """
    scores = Scores(problem.objective, problem.columns(z), noises)
    names = problem.names_of_tests()
    for look in problem.objective.looks(shapes, names, sampled=True):
        scores.weigh(look)
    for look in problem.objective.looks(shapes, names, group=scores.group):
        scores.add(look)
    value = problem.objective.value(shapes)
    pull = problem.pull(value, z)[0]
    inverse, told = _inverse(scores.bread() + pull, ~at_bound)
    if problem.objective.count <= (~at_bound).sum() and not problem.priors:
        told[:] = False  # they are met whatever their errors, and tell none
    noise, freedom = scores.of_noise(inverse)
    blocks, of_blocks = scores.of_blocks(inverse)
    shifts, mesh = _shifts(problem, z, shapes, at_bound, scores, pull, stated)
    believed = inverse @ problem.scores_of_priors(value, z) @ inverse
    unknown = tuple(name for name in stated if name not in shifts)
    wider = np.sqrt(np.maximum(np.diag(noise), np.diag(blocks)))
    sources = {"data": wider}
    if problem.priors:
        sources["prior"] = np.sqrt(np.diag(believed))
    inner = _with_deviations(noise, wider) + believed
    covariance = inner + sum(np.outer(shift, shift) for shift in shifts.values())
    freedom = np.where(np.diag(blocks) > np.diag(noise), of_blocks, freedom)
    quantiles = student.ppf(0.5 + 0.5 * _LEVEL, _with_priors(freedom, wider, inner))
    return _described(
        problem,
        z,
        told,
        covariance,
        inner,
        noise + believed,
        blocks + believed,
        sources | shifts,
        quantiles,
        mesh,
        unknown,
    )


def check_stated(problem: Problem, stated: Mapping[str, float]) -> None:
    """Refuse what cannot be stated to be uncertain of a fit, before its work.

    Parameters
    ----------
    problem : Problem
    stated : mapping
        See `FitOptions.uncertainty`.

    Raises
    ------
    InputError
        Unknown or impossible statements, or one of what is fitted itself.
    """
    for name, size in stated.items():
        if name not in UNCERTAIN:
            raise InputError(
                f"uncertainty of {name!r} is not known; choose from {', '.join(UNCERTAIN)}"
            )
        if not 0.0 < size < 1.0:
            raise InputError(f"uncertainty of {name}: give a part between 0 and 1, got {size:g}")
    if "nu12" in stated:
        _check_ratio(problem)


def _check_ratio(problem: Problem) -> None:
    """Refuse where nu12 is no number that the fit was given; InputError."""
    if problem.kind == "isotropic-EG":
        raise InputError(
            "uncertainty of nu12: E and G are fitted, and Poisson's ratio follows from them; "
            "leave it out"
        )
    for key in (*problem.keys, *problem.held_effects):
        if not _is_ratio(key):
            continue
        if key in problem.keys:
            raise InputError(
                f"uncertainty of nu12: {key} is fitted; say what is believed of it "
                f"(--prior {key}=MEAN+-DEVIATION)"
            )
        raise InputError(f"uncertainty of nu12: {key} is held in its place; hold nu12 (--nu12)")


def _is_ratio(key: Key) -> bool:
    """Whether a parameter is Poisson's ratio: of the material, or an effect's that tests state."""
    return parameter_named(key.name).null is None if key.effect else key.name in HELD_BY_DEFAULT


def _inverse(bread: Floats, free: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.bool_]]:
    """A⁻¹ among free parameters, and which of them the data tell at all.

    Directions that change nothing are left out of the inverse: it would say that they are known.
    """
    inverse, told = np.zeros_like(bread), free.copy()
    scale = np.sqrt(np.maximum(np.diag(bread), 1e-300))
    among = np.ix_(free, free)
    values, vectors = np.linalg.eigh((bread / np.outer(scale, scale))[among])
    seen = values > _NOTHING * values.max(initial=0.0)
    inverse[among] = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    # of a direction that is not seen, this much is the parameter's own
    told[free] = (vectors[:, ~seen] ** 2).sum(axis=1) < np.sqrt(_NOTHING)
    return inverse / np.outer(scale, scale), told


def _with_deviations(covariance: Floats, deviation: Floats) -> Floats:
    """A covariance with its correlations kept and its deviations replaced."""
    own = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return np.asarray(covariance * np.outer(deviation / own, deviation / own))


def _with_priors(freedom: Floats, by_data: Floats, covariance: Floats) -> Floats:
    """Degrees of freedom of the data's and the priors' variances together (Satterthwaite, 1946).

    The priors' are known, and have infinitely many.
    """
    with np.errstate(over="ignore"):  # of what the data do not tell at all
        share = by_data**2 / np.maximum(np.diag(covariance), 1e-300)
    return np.asarray(freedom / np.maximum(share, 1e-6) ** 2)


def _shifts(
    problem: Problem,
    z: Floats,
    shapes: list[Shapes],
    at_bound: NDArray[np.bool_],
    scores: Scores,
    pull: Floats,
    stated: Mapping[str, float],
) -> tuple[dict[str, Floats], list[float] | None]:
    """How far each uncertain thing moves the optimum, and what is left of the mesh's error, mm.

    `pull` is the priors' Hessian.
    """
    objective = problem.objective
    left = [mesh_remainder(v, s) for v, s in zip(objective.virtual, shapes, strict=True)]
    out: dict[str, Floats] = {}
    mesh: list[float] | None = None
    if all(field is not None for field in left):
        nowhere: Floats = np.zeros(problem.size)
        by_mesh = _changed_by(problem, shapes, scores, _with_corrections(left))
        out["mesh"] = _moved(by_mesh, ~at_bound, pull, nowhere, squared=objective.squared)
        rms = [np.sqrt((field**2).mean(axis=(0, 1))) for field in left if field is not None]
        mesh = np.max(rms, axis=0).tolist()
    for name, size in stated.items():
        led: Floats = np.zeros(problem.size)
        softer = 1.0
        if name == "thickness" and _frees_all_moduli(problem, at_bound):
            # only E t is felt: softer by as much, all is seen where it was, and there is no more to
            # move but what priors, or a law with a stiffness of its own, make of it
            softer = 1.0 / (1.0 + size)
            led = _of_moduli(problem, z, softer)
        try:
            other = _with_test(problem, z, name, size, softer)
            changed = _changed_by(problem, shapes, scores, other)
        except BulgefitError:
            continue  # the fit says so
        out[name] = led + _moved(changed, ~at_bound, pull, led, squared=objective.squared)
    return out, mesh


#: The virtual test of each test that something uncertain makes, with its shapes.
_Other = Callable[[int, VirtualTest, Shapes], tuple[VirtualTest, Shapes]]


def _changed_by(
    problem: Problem, shapes: list[Shapes], scores: Scores, other: _Other
) -> list[Changed]:
    """What another model changes at the values that the objective looks at."""
    objective = problem.objective
    others = [
        other(i, v, s) for i, (v, s) in enumerate(zip(objective.virtual, shapes, strict=True))
    ]
    found = []
    for (part, view, chunk), look in zip(
        objective.places(),
        objective.looks(shapes, problem.names_of_tests(), sampled=True),
        strict=True,
    ):
        here = objective.virtual[part].observe(shapes[part], (), view.block, chunk)
        twin, there = others[part]
        moved = twin.observe(there, (), view.block, chunk)
        change = (moved.displacement - here.displacement)[view.rows]
        found.append(scores.rows_of(look, change))
    return found


def _moved(
    rows: Sequence[Changed], free: NDArray[np.bool_], pull: Floats, led: Floats, *, squared: bool
) -> Floats:
    """Step d of the optimum where the model changes: the least Σ w E[ρ(r + change + J d)].

    Beside priors whose Hessian is `pull`, which draw back what was `led` away before. Squares
    have ρ'' = 1, and one step is all. Of an absolute deviation E|r + m| has, with r normal and c
    its curvature at m = 0, the slope erf(√π c m/2): what changes by far more than the noise pulls
    as its sign alone does, however large it is. Its quadratic of the same slope at m, of curvature
    slope/m, lies above it, since that falls with m: minimised again and again it descends (Hunter
    and Lange, 2004).
    """
    step: Floats = np.zeros(len(led))
    for _ in range(_MOST_STEPS):
        hessian, slope = np.array(pull), pull @ led
        for part in rows:
            weight = part.scale
            if not squared:
                weight = weight * _steepness(part.change + part.jacobian @ step, part.curvature)
            weighed = part.jacobian * weight[:, None]
            hessian += part.jacobian.T @ weighed
            slope += part.change @ weighed
        before, step = step, -_inverse(hessian, free)[0] @ slope
        if squared or (np.abs(step - before) <= _STEP_TO * np.abs(step)).all():
            break
    return step


def _steepness(change: Floats, curvature: Floats) -> Floats:
    """Slope of E|r + m| at m = change (mm) over m, in which E|r + m| begins with a curvature."""
    x = 0.5 * np.sqrt(np.pi) * curvature * np.abs(change)
    ratio = np.divide(erf(x), x, out=np.full_like(x, 2.0 / np.sqrt(np.pi)), where=x > 0.0)
    return np.asarray(0.5 * np.sqrt(np.pi) * curvature * ratio)


def _with_corrections(left: Sequence[Floats | None]) -> _Other:
    def other(i: int, virtual: VirtualTest, shapes: Shapes) -> tuple[VirtualTest, Shapes]:
        field = left[i]
        assert field is not None
        return virtual, replace(shapes, displacement=shapes.displacement + field)

    return other


def _with_test(problem: Problem, z: Floats, name: str, size: float, softer: float) -> _Other:
    """The model of a test of which one thing is larger by its error, with moduli times a factor."""
    material = _with_factor(problem.material(z), softer)
    constants = _with_ratio(material, size) if name == "nu12" else material.constants()
    values = [{**own, **constants} for own in problem.of_tests(z)]
    # with sensitivities a path differs by the solver's tolerance: this one is traced as that was
    traced = [[n for n in names if n in CONSTANTS] for names in problem.names_of_tests()]

    def other(i: int, virtual: VirtualTest, _: Shapes) -> tuple[VirtualTest, Shapes]:
        if name == "nu12":
            twin = VirtualTest(virtual.test, virtual.setup, virtual.threads, virtual.inflation)
        else:
            twin = VirtualTest(
                *_changed(virtual.test, virtual.setup, name, 1.0 + size), virtual.threads
            )
        twin.correction = virtual.correction
        return twin, twin.shapes(values[i], traced[i])

    return other


def _with_factor(material: Material, factor: float) -> Material:
    """The same with every modulus times a factor."""
    moduli = {name: factor * material.values[name] for name in _moduli(material.kind)}
    return Material(material.kind, {**material.values, **moduli})


def _with_ratio(material: Material, size: float) -> dict[str, float]:
    """E1, E2, G12 and nu12 where Poisson's ratio is larger: that of a sheet takes its G along."""
    ratio = "nu" if material.kind == "isotropic" else "nu12"
    values = {**material.values, ratio: material.values[ratio] + size}
    return Material(material.kind, values).constants()


def _changed(test: BulgeTest, setup: Setup, name: str, factor: float) -> tuple[BulgeTest, Setup]:
    """A test of other pressures or thickness, or of another clamp with the mesh given, as wide."""
    if name == "pressure":
        return replace(test, pressure=test.pressure * factor), setup
    if name == "thickness":
        return replace(test, thickness=test.thickness * factor), setup
    if setup.mesh is not None:
        setup = replace(setup, mesh=Mesh(setup.mesh.nodes * factor, setup.mesh.cells))
    return replace(test, radius=test.radius * factor), setup


def _moduli(kind: str) -> list[str]:
    return [p.name for p in parameters_of(kind) if p.unit == "MPa"]


def _frees_all_moduli(problem: Problem, at_bound: NDArray[np.bool_]) -> bool:
    """Whether no modulus is held, by a value or by a bound: others do not make up for it."""
    free = {p.name for p, at in zip(problem.free, at_bound, strict=True) if not at}
    return free.issuperset(_moduli(problem.kind))


def _of_moduli(problem: Problem, z: Floats, factor: float) -> Floats:
    """Change of the coordinates where every modulus is another by a factor."""
    values = problem.values(z)
    others = {name: factor * values[name] for name in _moduli(problem.kind)}
    return problem.coordinates({**values, **others}) - z


def _described(
    problem: Problem,
    z: Floats,
    told: NDArray[np.bool_],
    covariance: Floats,
    inner: Floats,
    noise: Floats,
    blocks: Floats,
    sources: Mapping[str, Floats],
    quantiles: Floats,
    mesh: list[float] | None,
    unknown: tuple[str, ...],
) -> Uncertainty:
    """Errors by name, in the parameters' units."""
    names = [p.name for p in problem.free]
    stderr: dict[str, float | None] = {}
    intervals: dict[str, tuple[float, float] | None] = {}
    by_noise: dict[str, float | None] = {}
    by_block: dict[str, float | None] = {}
    parts: dict[str, dict[str, float]] = {}
    for j, p in enumerate(problem.free):
        error = float(np.sqrt(max(covariance[j, j], 0.0)))
        if not told[j] or not np.isfinite(error) or error == 0.0:
            stderr[p.name] = intervals[p.name] = by_noise[p.name] = by_block[p.name] = None
            continue
        unit = _of_value(problem, z, j, error)
        stderr[p.name] = error * unit
        ends = [problem.value_at(j, z[j] + sign * quantiles[j] * error) for sign in (-1, 1)]
        intervals[p.name] = (max(min(ends), _least(problem.keys[j])), max(ends))
        by_noise[p.name] = float(np.sqrt(noise[j, j])) * unit
        by_block[p.name] = float(np.sqrt(blocks[j, j])) * unit
        parts[p.name] = {name: abs(float(by[j])) * unit for name, by in sources.items()}
    known = [name for name in names if stderr[name] is not None]
    correlation, own = (_correlations(c, names, known) for c in (covariance, inner))
    return Uncertainty(
        covariance,
        stderr,
        intervals,
        by_noise,
        by_block,
        parts,
        correlation,
        own,
        mesh,
        unknown,
    )


def _of_value(problem: Problem, z: Floats, j: int, error: float) -> float:
    """How much of its value a parameter's error is, over how much of its coordinate it is.

    At none at all the slope of a length by its square is infinite: what one standard error upwards
    leads to is its error, there and elsewhere.
    """
    if problem.free[j].coordinate == "square":
        return (problem.value_at(j, z[j] + error) - problem.value_at(j, z[j])) / error
    return abs(problem.value_slope(j, z))


def _least(key: Key) -> float:
    """The lowest value that means anything."""
    parameter = parameter_named(key.name) if key.effect else None
    return parameter.lower if parameter is not None and parameter.begins_at_null else -np.inf


def _correlations(
    covariance: Floats, names: Sequence[str], known: Sequence[str]
) -> dict[tuple[str, str], float]:
    """Of each two that have an error."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return {
        (names[i], names[j]): float(covariance[i, j] / (deviation[i] * deviation[j]))
        for i in range(len(names))
        for j in range(i)
        if names[i] in known and names[j] in known
    }
