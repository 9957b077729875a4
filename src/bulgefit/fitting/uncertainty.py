"""How sure is a fit? Standard errors from the residuals that it leaves.

At the optimum of Σ ρ(r) the estimate is off by A⁻¹ Σ ψ J, with ψ = ρ' and A = Σ E[ρ''] J Jᵀ, so
its covariance is A⁻¹ B A⁻¹ with B that of the sum (Huber, 1967, the sandwich). B is taken from sums
over clusters, within which residuals may be alike in any way (Liang and Zeger, 1986):

* cells of a frame, wider than the noise's correlation: noise alone,
* blocks of frames times sectors of the disc: also what the model misses, which changes slowly with
  pressure and place.

Each is the expectation of the bootstrap over its clusters. To this come what is left of the mesh's
error, and stated uncertainties of thickness, radius, pressure and nu12, by what they move the
optimum. Of two clusterings the wider one is told; both where they differ by more than a fifth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import BulgefitError, InputError
from bulgefit.fitting.objective import Look
from bulgefit.fitting.problem import Problem
from bulgefit.model.inflation import Shapes
from bulgefit.model.mesh_error import mesh_remainder
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["UNCERTAIN", "Uncertainty", "uncertainty_of"]

Floats = NDArray[np.floating]

#: What may be stated to be uncertain.
UNCERTAIN = ("thickness", "radius", "pressure", "nu12")
#: Cells are this many correlation lengths wide, and at least this share of the radius.
_LENGTHS, _LEAST_CELL = 4.0, 0.25
#: Blocks of neighbouring frames, and sectors.
_FRAMES, _SECTORS = 4, 6
#: Share by which both clusterings may differ without a word.
_ALIKE = 0.2
_LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Errors of the free parameters.

    Attributes
    ----------
    covariance : (free, free) array
        Of the coordinates in which the problem steps; NaN rows for what sits at a bound.
    stderr : dict of name to float or None
        In the parameter's unit; None at a bound, or where nothing tells it.
    interval95 : dict of name to (low, high) or None
    noise_stderr, block_stderr : dict of name to float or None
        By cells of frames, and by blocks of frames and sectors.
    parts : dict of name to dict
        Standard deviation by source: "data", "mesh", and what was stated.
    correlation : dict of (name, name) to float
    mesh_error_mm : list of three floats, or None
        What is left of the mesh's error in dx, dy, dz, the largest of the tests.
    """

    covariance: Floats
    stderr: dict[str, float | None]
    interval95: dict[str, tuple[float, float] | None]
    noise_stderr: dict[str, float | None]
    block_stderr: dict[str, float | None]
    parts: dict[str, dict[str, float]]
    correlation: dict[tuple[str, str], float]
    mesh_error_mm: list[float] | None

    def differing(self) -> list[str]:
        """Parameters whose errors by the two clusterings differ by more than a fifth."""
        out = []
        for name, noise in self.noise_stderr.items():
            block = self.block_stderr[name]
            if noise and block and abs(block - noise) > _ALIKE * max(noise, block):
                out.append(name)
        return out


#: Eigenvalues below this part of the largest are rounding.
_NOTHING = 1e-12


def uncertainty_of(
    problem: Problem,
    z: Floats,
    shapes: list[Shapes],
    at_bound: NDArray[np.bool_],
    stated: Mapping[str, float],
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
        See `FitOptions.uncertainty`.

    Raises
    ------
    InputError
        Unknown or impossible statements.
    """
    _check(stated)
    columns = problem.columns(z)
    sums = _Sums(problem, columns)
    names = problem.names_of_tests()
    for look in problem.objective.looks(shapes, names, sampled=True):
        sums.weigh(look)
    for look in problem.objective.looks(shapes, names, group=sums.group):
        sums.cluster(look)
    bread = sums.bread()
    if problem.priors:
        bread = bread + problem.pull(problem.objective.value(shapes), z)[0]
    inverse, told = _inverse(bread, ~at_bound)
    if problem.objective.count <= (~at_bound).sum() and not problem.priors:
        told[:] = False  # they are met whatever their errors, and tell none
    noise, blocks = (inverse @ meat @ inverse for meat in (sums.cells(), sums.blocks()))
    shifts, mesh = _shifts(problem, z, shapes, sums, inverse, stated)
    wider = np.sqrt(np.maximum(np.diag(noise), np.diag(blocks)))
    covariance = _with_deviations(noise, wider)
    for shift in shifts.values():
        covariance = covariance + np.outer(shift, shift)
    quantiles = np.where(
        np.diag(blocks) > np.diag(noise),
        student.ppf(0.5 + 0.5 * _LEVEL, max(sums.count_of_blocks - 1, 1)),
        student.ppf(0.5 + 0.5 * _LEVEL, max(sums.count_of_cells - 1, 1)),
    )
    return _described(problem, z, told, covariance, noise, blocks, wider, shifts, quantiles, mesh)


def _check(stated: Mapping[str, float]) -> None:
    for name, size in stated.items():
        if name not in UNCERTAIN:
            raise InputError(
                f"uncertainty of {name!r} is not known; choose from {', '.join(UNCERTAIN)}"
            )
        if not 0.0 < size < 1.0:
            raise InputError(f"uncertainty of {name}: give a part between 0 and 1, got {size:g}")


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


class _Sums:
    """A, and the sums of ψ J over clusters.

    A and the medians are means over points, which a sample tells; the sums over clusters are not.
    """

    def __init__(self, problem: Problem, columns: list[Floats]) -> None:
        self.columns, self.squared = columns, problem.objective.squared
        self.tests = problem.objective.tests
        self.lengths = [
            max(_LENGTHS * noise.correlation_length if noise else 0.0, _LEAST_CELL * test.radius)
            for noise, test in zip(problem.objective.noise(), self.tests, strict=True)
        ]
        self._size = columns[0].shape[1]
        self._grams: dict[tuple[int, int], Floats] = {}
        self._residuals: dict[tuple[int, int], list[Floats]] = {}
        self._of_cells: dict[tuple[int, ...], Floats] = {}
        self._of_blocks: dict[tuple[int, ...], Floats] = {}
        self._curvatures: dict[tuple[int, int], float] = {}
        self._ranks = [np.argsort(np.argsort(test.pressure)) for test in self.tests]

    def jacobian(self, look: Look) -> Floats:
        """By the coordinates, (k, m, 3, free)."""
        return np.tensordot(look.jacobian(), self.columns[look.test], (0, 0))

    def weigh(self, look: Look) -> None:
        """Take some points into A."""
        seen = np.isfinite(look.residual)
        weight = np.where(seen, look.scale[:, None], 0.0)
        jacobian = self.jacobian(look)
        for c in range(3):
            part = jacobian[:, :, c].reshape(-1, self._size)
            gram = part.T @ (part * weight[:, :, c].reshape(-1, 1))
            key = (look.test, c)
            self._grams[key] = self._grams.get(key, 0.0) + gram
            self._residuals.setdefault(key, []).append(look.residual[:, :, c][seen[:, :, c]])

    def places(self, test: int, position: Floats) -> NDArray[np.intp]:
        """Cell by x and y, and sector, of points (m, 2) mm of a test: (m, 3)."""
        cell = np.floor(position / self.lengths[test]).astype(np.intp)
        angle = np.arctan2(position[:, 1], position[:, 0]) + np.pi
        sector = np.minimum((angle * _SECTORS / (2 * np.pi)).astype(np.intp), _SECTORS - 1)
        return np.column_stack([cell, sector])

    def group(self, test: int, position: Floats) -> NDArray[np.intp]:
        """A number (m,) for each of the `places` of points."""
        places = self.places(test, position)
        return np.unique(places, axis=0, return_inverse=True)[1].ravel()

    def cluster(self, look: Look) -> None:
        """Take some points into the sums over clusters."""
        test = self.tests[look.test]
        block = self._ranks[look.test][look.frames] * _FRAMES // max(test.n_frames, 1)
        of_points = self.places(look.test, look.position)
        places, which = np.unique(of_points, axis=0, return_inverse=True)
        by_name = look.gathered(look.pull(squared=self.squared), which.ravel())
        summed = np.tensordot(by_name, self.columns[look.test], (0, 0))  # (groups, frames, free)
        for (x, y, around), rows in zip(places.tolist(), summed, strict=True):
            for frame, early, row in zip(look.frames.tolist(), block.tolist(), rows, strict=True):
                _add(self._of_cells, (look.test, frame, x, y), row)
                _add(self._of_blocks, (look.test, early, around), row)

    @property
    def count_of_cells(self) -> int:
        """Cells with anything in them."""
        return len(self._of_cells)

    @property
    def count_of_blocks(self) -> int:
        """Blocks with anything in them."""
        return len(self._of_blocks)

    def bread(self) -> Floats:
        """A: for absolute residuals twice their density at zero, as of a normal distribution."""
        out = np.zeros((self._size, self._size))
        for key, gram in self._grams.items():
            out += self.curvature(key) * gram
        return out

    def curvature(self, key: tuple[int, int]) -> float:
        """E[ρ''] of a test's component, once all points are in."""
        if self.squared:
            return 1.0
        if key not in self._curvatures:
            left = np.concatenate(self._residuals[key])
            deviation = max(1.4826 * float(np.median(np.abs(left))), 1e-9) if len(left) else np.inf
            self._curvatures[key] = float(np.sqrt(2.0 / np.pi) / deviation)
        return self._curvatures[key]

    def cells(self) -> Floats:
        """B by cells of frames."""
        return _outer(self._of_cells)

    def blocks(self) -> Floats:
        """B by blocks of frames and sectors."""
        return _outer(self._of_blocks)

    def pull_of(self, look: Look, change: Floats) -> Floats:
        """What a change (k, m, 3) mm of what is modelled adds to the slope, (free,)."""
        seen = np.isfinite(look.residual)
        curvature = np.array([self.curvature((look.test, c)) for c in range(3)])
        weight = np.where(seen, look.scale[:, None] * curvature, 0.0)
        return np.einsum("kmc,kmcp->p", weight * change, self.jacobian(look))


def _add(sums: dict[tuple[int, ...], Floats], key: tuple[int, ...], row: Floats) -> None:
    sums[key] = sums.get(key, 0.0) + row


def _outer(sums: Mapping[tuple[int, ...], Floats]) -> Floats:
    """Σ s sᵀ, scaled up for the clusters' number as in a variance."""
    rows = np.array(list(sums.values()))
    count = len(rows)
    return rows.T @ rows * (count / max(count - 1, 1))


def _shifts(
    problem: Problem,
    z: Floats,
    shapes: list[Shapes],
    sums: _Sums,
    inverse: Floats,
    stated: Mapping[str, float],
) -> tuple[dict[str, Floats], list[float] | None]:
    """How far each uncertain thing moves the optimum, and what is left of the mesh's error, mm."""
    objective = problem.objective
    left = [mesh_remainder(v, s) for v, s in zip(objective.virtual, shapes, strict=True)]
    out: dict[str, Floats] = {}
    mesh: list[float] | None = None
    if all(field is not None for field in left):
        out["mesh"] = _moved(problem, shapes, sums, inverse, _with_corrections(left))
        rms = [np.sqrt((field**2).mean(axis=(0, 1))) for field in left if field is not None]
        mesh = np.max(rms, axis=0).tolist()
    for name, size in stated.items():
        if name == "thickness":
            # only E t is felt: moduli move by as much, the other way; displacements not at all
            out[name] = _of_moduli(problem, z, size)
            continue
        try:
            out[name] = _moved(problem, shapes, sums, inverse, _with_test(problem, z, name, size))
        except BulgefitError:
            continue
    return out, mesh


#: The virtual test of each test that something uncertain makes, with its shapes.
_Other = Callable[[int, VirtualTest, Shapes], tuple[VirtualTest, Shapes]]


def _moved(
    problem: Problem, shapes: list[Shapes], sums: _Sums, inverse: Floats, other: _Other
) -> Floats:
    """Change of the optimum where the model is another: A⁻¹ Σ E[ρ''] J (change of the model)."""
    objective = problem.objective
    others = [
        other(i, v, s) for i, (v, s) in enumerate(zip(objective.virtual, shapes, strict=True))
    ]
    pull = np.zeros(problem.size)
    for (part, view, chunk), look in zip(
        objective.places(),
        objective.looks(shapes, problem.names_of_tests(), sampled=True),
        strict=True,
    ):
        here = objective.virtual[part].observe(shapes[part], (), view.block, chunk)
        twin, there = others[part]
        moved = twin.observe(there, (), view.block, chunk)
        change = (moved.displacement - here.displacement)[view.rows]
        pull += sums.pull_of(look, change)
    return -inverse @ pull


def _with_corrections(left: Sequence[Floats | None]) -> _Other:
    def other(i: int, virtual: VirtualTest, shapes: Shapes) -> tuple[VirtualTest, Shapes]:
        field = left[i]
        assert field is not None
        return virtual, replace(shapes, displacement=shapes.displacement + field)

    return other


def _with_test(problem: Problem, z: Floats, name: str, size: float) -> _Other:
    """The model of a test whose radius, pressures or Poisson's ratio are larger by its error."""
    values = problem.of_tests(z)

    def other(i: int, virtual: VirtualTest, _: Shapes) -> tuple[VirtualTest, Shapes]:
        given, test = dict(values[i]), virtual.test
        if name == "nu12":
            given["nu12"] = given["nu12"] + size
            twin = VirtualTest(test, virtual.setup, virtual.threads, virtual.inflation)
        else:
            twin = VirtualTest(_changed(test, name, 1.0 + size), virtual.setup, virtual.threads)
        twin.correction = virtual.correction
        return twin, twin.shapes(given)

    return other


def _changed(test: BulgeTest, name: str, factor: float) -> BulgeTest:
    if name == "pressure":
        return replace(test, pressure=test.pressure * factor)
    return replace(test, radius=test.radius * factor)


def _of_moduli(problem: Problem, z: Floats, size: float) -> Floats:
    """Change of the coordinates where every modulus is larger by a share."""
    values = problem.values(z)
    grown = {
        p.name: values[p.name] * (1.0 + size) if p.coordinate == "log" else values[p.name]
        for p in problem.free
    }
    return problem.coordinates(grown) - z


def _described(
    problem: Problem,
    z: Floats,
    told: NDArray[np.bool_],
    covariance: Floats,
    noise: Floats,
    blocks: Floats,
    wider: Floats,
    shifts: Mapping[str, Floats],
    quantiles: Floats,
    mesh: list[float] | None,
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
        unit = abs(problem.value_slope(j, z))
        stderr[p.name] = error * unit
        ends = [problem.value_at(j, z[j] + sign * quantiles[j] * error) for sign in (-1, 1)]
        intervals[p.name] = (min(ends), max(ends))
        by_noise[p.name] = float(np.sqrt(noise[j, j])) * unit
        by_block[p.name] = float(np.sqrt(blocks[j, j])) * unit
        parts[p.name] = {"data": float(wider[j]) * unit}
        parts[p.name] |= {name: abs(float(shift[j])) * unit for name, shift in shifts.items()}
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = {
        (names[i], names[j]): float(covariance[i, j] / (deviation[i] * deviation[j]))
        for i in range(len(names))
        for j in range(i)
        if stderr[names[i]] is not None and stderr[names[j]] is not None
    }
    return Uncertainty(covariance, stderr, intervals, by_noise, by_block, parts, correlation, mesh)
