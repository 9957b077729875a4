"""The objectives: how far a virtual test is from the measured one.

For a test with N measured values of a component over all points and pressures,

    r_dx = 1/N Σ |dx_test - dx_model|,    likewise r_dy, r_dz
    e    = r_dx + r_dy + r_dz
    e_w  = r_dx + r_dy + w r_dz,          w = ½ (max|dx| + max|dy|) / max|dz| of the tests
    e_z  = 1/F Σ |dz_test - dz_model|     at the point nearest the centre, F frames

in mm, as published, and for several tests the mean over tests. The study's paper averages over all
points of a test (`average="points"`, the default here); its code averages over each frame first
(`average="frames"`), which weighs sparse frames up. Beside them

    likelihood = ½ Σ ((u_test - u_model)/σ)² / v

is minus the logarithm of a Gaussian likelihood with the noise's own size σ of each component; v is
what correlation in space does to the variance of a mean, so points that are alike count less.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.noise import Noise, noise_of
from bulgefit.errors import InputError, one_of
from bulgefit.fitting.l1 import Rows, count_and_peaks
from bulgefit.model.inflation import Shapes
from bulgefit.model.mesh_error import correct_mesh
from bulgefit.model.setup import Setup
from bulgefit.model.sight import Sight
from bulgefit.model.virtual_test import virtual_tests

__all__ = [
    "LIKELIHOOD",
    "OBJECTIVES",
    "Look",
    "Objective",
    "TestParts",
    "check_comparison",
    "displacement_weight",
]

Floats = NDArray[np.floating]

#: The published ones.
OBJECTIVES = ("e", "e_w", "e_z")
LIKELIHOOD = "likelihood"
AVERAGES = ("points", "frames")

#: Measured values that stand for all data while a descent is on its way.
SAMPLE = 100_000
#: Points that are looked at together.
_CHUNK = 4096


def displacement_weight(tests: Sequence[BulgeTest]) -> float:
    """Weight of dz in e_w that balances the components: maxima of the data of all tests, 1."""
    largest = np.zeros(3)
    for test in tests:
        for block in test.blocks:
            largest = np.maximum(largest, count_and_peaks(block.displacement)[1])
    if largest[2] <= 0.0 or not largest[:2].any():
        return 1.0
    return float(0.5 * (largest[0] + largest[1]) / largest[2])


@dataclass(frozen=True)
class TestParts:
    """The objectives of one test and their parts, mm; None where nothing was measured."""

    name: str
    dx: float | None
    dy: float | None
    dz: float | None
    e: float
    e_w: float
    e_z: float | None

    __test__ = False  # not a pytest class


@dataclass(frozen=True, eq=False)
class Look:
    """Residuals at some points in some frames of one test, and what the model does there.

    Attributes
    ----------
    test : int
    frames : (k,) int array
        Of the test.
    position : (m, 2) array, mm
    residual : (k, m, 3) array, mm
        Measured minus modelled; NaN where nothing was measured.
    scale : (k, 3) array
        Weights of the values in the objective.
    rows : (k,) int array
        The frames among the block's.
    sight : Sight or None
        The model's; None where it does not deform.
    """

    test: int
    frames: NDArray[np.intp]
    position: Floats
    residual: Floats
    scale: Floats
    rows: NDArray[np.intp]
    sight: Sight | None

    def jacobian(self) -> Floats:
        """Derivatives of the model, (names, k, m, 3)."""
        if self.sight is None:
            return np.zeros((0, *self.residual.shape))
        return self.sight.derivative()[:, self.rows]

    def pull(self, *, squared: bool) -> NDArray[np.float64]:
        """∂(the objective)/∂(residual), (k, m, 3); 0 where nothing was measured."""
        seen = np.isfinite(self.residual)
        left = np.where(seen, self.residual, 0.0)
        return np.asarray(self.scale[:, None] * (left if squared else np.sign(left)))

    def gathered(self, pull: NDArray[np.float64], group: NDArray[np.intp] | None = None) -> Floats:
        """Σ pull · jacobian over the points of each group, (names, groups, k)."""
        assert self.sight is not None
        whole = pull
        if len(self.rows) != len(self.sight.displacement):
            whole = np.zeros(self.sight.displacement.shape)
            whole[self.rows] = pull
        return self.sight.gathered(whole, group)[..., self.rows]


@dataclass(frozen=True, eq=False)
class _View:
    """Points of a block in some of its frames.

    Attributes
    ----------
    block : int
    rows : (k,) int array
        Among the block's frames.
    frames : (k,) int array
        The same among the test's.
    points : (m,) int array
    only_dz : bool
    """

    block: int
    rows: NDArray[np.intp]
    frames: NDArray[np.intp]
    points: NDArray[np.intp]
    only_dz: bool = False

    def measured(self, test: BulgeTest, points: NDArray[np.intp]) -> Floats:
        """Displacements (k, m, 3) mm at some of the points."""
        whole = test.blocks[self.block].displacement
        some = whole[np.ix_(self.rows, points)]
        if self.only_dz:
            some[..., :2] = np.nan
        return some


def check_comparison(objective: str, average: str) -> None:
    """Refuse an objective, or a way to average, that is unknown; InputError."""
    one_of(objective, (*OBJECTIVES, LIKELIHOOD), "objective")
    one_of(average, AVERAGES, "average")


class Objective:
    """One of the objectives on given tests.

    Parameters
    ----------
    tests : sequence of BulgeTest
    name : {"e", "e_w", "e_z", "likelihood"}
    setup : Setup, optional
    weight : float or (3,) sequence, optional
        Of dz, or of dx, dy, dz, in e_w; default `displacement_weight(tests)`.
    average : {"points", "frames"}
        See the module.

    Raises
    ------
    InputError
        Unknown names, or no value that the objective could compare.
    """

    def __init__(
        self,
        tests: Sequence[BulgeTest],
        name: str = "e_w",
        setup: Setup | None = None,
        *,
        weight: float | Sequence[float] | None = None,
        average: str = "points",
    ) -> None:
        check_comparison(name, average)
        self.name, self.average = name, average
        self.virtual = virtual_tests(tests, setup)
        self.tests = tuple(v.test for v in self.virtual)
        self.setup = self.virtual[0].setup
        self.weights = _component_weights(self.tests, weight)
        self.noises: tuple[Noise | None, ...] | None = None
        factors = {"e_w": self.weights, "e_z": np.array([0.0, 0.0, 1.0])}.get(name, np.ones(3))
        shared = factors / len(self.tests)
        self._whole = [_Part(test, _whole(test), average, shared) for test in self.tests]
        self._apex = [_Part(test, _apex(test), average, shared) for test in self.tests]
        self._parts = self._apex if name == "e_z" else self._whole
        if name == LIKELIHOOD:
            for part, noise in zip(self._parts, self.noise(), strict=True):
                if noise is None:
                    raise InputError(
                        f"{part.test.name}: too little was measured to tell its noise, which the "
                        "likelihood needs; use another objective"
                    )
            self.weigh_by(self.noise())
        for part in self._parts:
            if part.empty:
                raise InputError(
                    f"{part.test.name}: nothing was measured that {name} compares"
                    + (" (no dz near the centre)" if name == "e_z" else "")
                )
        self.count = sum(int(part.counts[:, factors > 0].sum()) for part in self._parts)
        self._kept = min(1.0, SAMPLE / self.count)

    @property
    def squared(self) -> bool:
        """Whether residuals count squared."""
        return self.name == LIKELIHOOD

    @property
    def unit(self) -> str:
        """Of its value."""
        return "1" if self.squared else "mm"

    @property
    def weight(self) -> float:
        """Weight of dz in e_w."""
        return float(self.weights[2])

    @property
    def is_sampled(self) -> bool:
        """Whether descents look at a sample of the data."""
        return self._kept < 1.0

    def noise(self) -> tuple[Noise | None, ...]:
        """Of each test, from what it shows of itself; None where it shows too little."""
        if self.noises is None:
            self.noises = tuple(noise_of(test) for test in self.tests)
        return self.noises

    def weigh_by(self, noises: Sequence[Noise | None]) -> None:
        """Take the noise of each test for this: what shows none keeps what it has."""
        self.noises = tuple(new or old for new, old in zip(noises, self.noise(), strict=True))
        if self.squared:
            for part, noise in zip(self._parts, self.noises, strict=True):
                if noise is not None:
                    part.weigh_by(noise)

    def shapes(
        self,
        values: Sequence[Mapping[str, float]],
        names: Sequence[Sequence[str]] | None = None,
        near: Sequence[Shapes] | None = None,
    ) -> list[Shapes]:
        """Balanced shapes of every test by its own values and derivatives; raises SolveError."""
        wanted = names or [()] * len(self.virtual)
        starts: Sequence[Shapes | None] = near or [None] * len(self.virtual)
        return [
            v.shapes(own, which, start)
            for v, own, which, start in zip(self.virtual, values, wanted, starts, strict=True)
        ]

    def correct_mesh(self, shapes: Sequence[Shapes]) -> None:
        """Take the mesh's error off, as it is at these shapes."""
        for virtual, one in zip(self.virtual, shapes, strict=True):
            correct_mesh(virtual, one)

    def value(self, shapes: Sequence[Shapes] | None) -> float:
        """The objective over all data; of a model that does not deform where there are none."""
        total = 0.0
        for i, part in enumerate(self._parts):
            for view, sums in zip(part.views, self._sums(i, part, shapes), strict=True):
                total += float((part.scale(view) * sums).sum())
        return total

    def slope(
        self, shapes: Sequence[Shapes], names: Sequence[Sequence[str]], columns: Sequence[Floats]
    ) -> tuple[float, Floats]:
        """The objective over all data, and its derivative by the coordinates.

        Parameters
        ----------
        names : per test, the parameters of its shapes
        columns : per test, their derivatives by the coordinates, (names, free)
        """
        total, slope = 0.0, np.zeros(columns[0].shape[1])
        for look in self.looks(shapes, names):
            total += float((look.scale * self.summed(look.residual)).sum())
            by_name = look.gathered(look.pull(squared=self.squared)).sum(axis=(1, 2))
            slope -= by_name @ columns[look.test]
        return total, slope

    def rows(
        self, shapes: Sequence[Shapes], names: Sequence[Sequence[str]], columns: Sequence[Floats]
    ) -> Rows:
        """The objective linearised in the coordinates: all data, or a sample that stands for them.

        Parameters as of `slope`.
        """
        jacobians, residuals, scales = [], [], []
        for look in self.looks(shapes, names, sampled=True):
            seen = np.isfinite(look.residual) & (look.scale != 0.0)[:, None]
            by_name = np.stack([j[seen] for j in look.jacobian()], axis=1)
            jacobians.append(by_name @ columns[look.test])
            residuals.append(look.residual[seen])
            scales.append(np.broadcast_to(look.scale[:, None], seen.shape)[seen])
        return Rows(
            np.concatenate(jacobians),
            np.concatenate(residuals).astype(np.float64),
            np.concatenate(scales),
            whole=not self.is_sampled,
            squared=self.squared,
        )

    def places(self) -> Iterator[tuple[int, _View, NDArray[np.intp]]]:
        """Test, view and points of each of `looks`, of the sample where there is one."""
        for i, part in enumerate(self._parts):
            for view in part.views:
                for chunk in _chunks(self._sampled(view)):
                    yield i, view, chunk

    def _sampled(self, view: _View) -> NDArray[np.intp]:
        return _some(view.points, self._kept) if self.is_sampled else view.points

    def looks(
        self,
        shapes: Sequence[Shapes] | None,
        names: Sequence[Sequence[str]] | None = None,
        *,
        sampled: bool = False,
        group: Callable[[int, Floats], NDArray[np.intp]] | None = None,
    ) -> Iterator[Look]:
        """Residuals of what the objective compares, some points at a time.

        Parameters
        ----------
        group : callable, optional
            Numbers of the groups of points of a test at positions (m, 2) mm: points of a group
            come one after another, so that each look has few groups.
        """
        for i, part in enumerate(self._parts):
            for view in part.views:
                points = self._sampled(view) if sampled else view.points
                if group is not None:
                    position = self.tests[i].blocks[view.block].reference[points, :2]
                    points = points[np.argsort(group(i, position), kind="stable")]
                scale = part.scale(view) * (len(view.points) / len(points))
                for chunk in _chunks(points):
                    yield self._look(
                        i, view, chunk, scale, shapes, () if names is None else names[i]
                    )

    def repeated(self, times: Sequence[Floats]) -> Objective | None:
        """The objective with each frame of each test counted so many times, for the bootstrap.

        Parameters
        ----------
        times : sequence of (frames,) arrays
            0 leaves a frame out.

        Returns
        -------
        Objective or None
            It shares everything else with this one; None where nothing is left to compare.
        """
        other = copy(self)
        other._parts = [p.repeated(t) for p, t in zip(self._parts, times, strict=True)]
        return None if any(part.empty for part in other._parts) else other

    def parts(self, shapes: Sequence[Shapes] | None) -> list[TestParts]:
        """Every published objective of every test; of a resting model where there are no shapes."""
        return [
            self._test_parts(i, whole, apex, shapes)
            for i, (whole, apex) in enumerate(zip(self._whole, self._apex, strict=True))
        ]

    def combined(self, parts: Sequence[TestParts]) -> dict[str, float | None]:
        """Means over tests of e, e_w and e_z, mm."""
        return {
            key: None
            if any(getattr(p, key) is None for p in parts)
            else float(np.mean([getattr(p, key) for p in parts]))
            for key in OBJECTIVES
        }

    def _look(
        self,
        test: int,
        view: _View,
        points: NDArray[np.intp],
        scale: Floats,
        shapes: Sequence[Shapes] | None,
        names: Sequence[str],
    ) -> Look:
        virtual = self.virtual[test]
        measured = view.measured(virtual.test, points)
        position = virtual.test.blocks[view.block].reference[points, :2]
        sight = None
        if shapes is not None:
            sight = virtual.sight(shapes[test], names, view.block, points)
            measured = measured - sight.displacement[view.rows]
        return Look(test, view.frames, position, measured, scale, view.rows, sight)

    def _sums(self, test: int, part: _Part, shapes: Sequence[Shapes] | None) -> list[Floats]:
        """Of |r|, or of r²/2, over the points of each view's frames: (k, 3) each."""
        found: list[Floats] = []
        for view in part.views:
            total = np.zeros((len(view.rows), 3))
            for chunk in _chunks(view.points):
                left = self._look(test, view, chunk, total, shapes, ()).residual
                total = total + self.summed(left)
            found.append(total)
        return found

    def summed(self, residual: Floats) -> Floats:
        """Of |r|, or of r²/2, over the points of each frame, (k, 3)."""
        size = 0.5 * residual**2 if self.squared else np.abs(residual)
        return np.asarray(np.nansum(size, axis=1))

    def _test_parts(
        self, test: int, whole: _Part, apex: _Part, shapes: Sequence[Shapes] | None
    ) -> TestParts:
        published = copy(self)
        published.name = "e"
        r = whole.means(published._sums(test, whole, shapes))
        near = apex.means(published._sums(test, apex, shapes))[2] if apex.views else None
        measured = [0.0 if value is None else value for value in r]
        return TestParts(
            whole.test.name,
            dx=r[0],
            dy=r[1],
            dz=r[2],
            e=sum(measured),
            e_w=float(np.dot(self.weights, measured)),
            e_z=near,
        )


def _whole(test: BulgeTest) -> tuple[_View, ...]:
    """All that was measured."""
    return tuple(
        _View(i, np.arange(len(b.frames)), b.frames, np.arange(len(b.reference)))
        for i, b in enumerate(test.blocks)
    )


def _apex(test: BulgeTest) -> tuple[_View, ...]:
    """The measured point nearest the centre of each frame, its dz alone."""
    views = []
    for i, block in enumerate(test.blocks):
        apex = test.apex[block.frames]
        for point in np.unique(apex[apex >= 0]):
            rows = np.flatnonzero(apex == point)
            views.append(_View(i, rows, block.frames[rows], np.array([point]), only_dz=True))
    return tuple(views)


def _some(points: NDArray[np.intp], share: float) -> NDArray[np.intp]:
    """A share of the points, drawn, since every so many points of a grid may lie on a line."""
    kept = max(1, round(share * len(points)))
    return np.sort(points[np.random.default_rng(0).permutation(len(points))[:kept]])


def _chunks(points: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    for first in range(0, len(points), _CHUNK):
        yield points[first : first + _CHUNK]


class _Part:
    """Views of one test that an objective looks at, and the factor of each frame's sums."""

    def __init__(
        self, test: BulgeTest, views: tuple[_View, ...], average: str, factors: Floats
    ) -> None:
        self.test, self.views = test, views
        self._average, self._factors = average, factors
        self._counted = [
            count_and_peaks(
                test.blocks[v.block].displacement if not v.only_dz else v.measured(test, v.points)
            )[0]
            for v in views
        ]
        self.counts = np.concatenate(self._counted) if views else np.zeros((0, 3), dtype=int)
        self._by_noise: Floats | None = None
        self._weigh(np.ones(test.n_frames))

    def repeated(self, times: Floats) -> _Part:
        """The same, with each frame of the test counted so many times (frames,)."""
        other = copy(self)
        other._weigh(times)
        return other

    def weigh_by(self, noise: Noise) -> None:
        """Count values by one over the variance of the noise."""
        self._by_noise = 1.0 / (noise.inflation * noise.sigma**2)
        self._weigh(np.ones(self.test.n_frames))

    @property
    def empty(self) -> bool:
        """Whether no value counts in the objective."""
        return not any(scale.any() for scale in self._scales)

    def scale(self, view: _View) -> Floats:
        """Factor (k, 3) of each frame's sums in the objective."""
        return self._scales[next(i for i, v in enumerate(self.views) if v is view)]

    def _weigh(self, times: Floats) -> None:
        often = [times[view.frames, None] for view in self.views]
        pairs = list(zip(self._counted, often, strict=True))
        if self._average == "points":
            values = sum(((c * t).sum(axis=0) for c, t in pairs), start=np.zeros(3))
            self._share = [t / np.maximum(values, 1) * np.ones(3) for _, t in pairs]
        else:
            frames = sum((((c > 0) * t).sum(axis=0) for c, t in pairs), start=np.zeros(3))
            self._share = [t / (np.maximum(c, 1) * np.maximum(frames, 1)) for c, t in pairs]
        if self._by_noise is None:
            self._scales = [
                s * (c > 0) * self._factors for s, (c, _) in zip(self._share, pairs, strict=True)
            ]
        else:
            self._scales = [t * (c > 0) * self._by_noise for c, t in pairs]

    def means(self, sums: list[Floats]) -> list[float | None]:
        """Mean absolute deviation per component, mm; None where nothing was measured."""
        total = sum((s * f).sum(axis=0) for s, f in zip(sums, self._share, strict=True))
        return [
            float(v) if n else None
            for v, n in zip(np.atleast_1d(total), self.counts.sum(axis=0), strict=True)
        ]


def _component_weights(
    tests: Sequence[BulgeTest], weight: float | Sequence[float] | None
) -> Floats:
    """Weights of dx, dy, dz in e_w."""
    if weight is None:
        weight = displacement_weight(tests)
    given = np.atleast_1d(np.asarray(weight, dtype=float))
    if given.shape == (1,):
        given = np.array([1.0, 1.0, given[0]])
    if given.shape != (3,) or not np.isfinite(given).all() or (given < 0).any():
        raise InputError(
            f"weight: give one number of dz, or three of dx, dy, dz, none negative, not {weight}"
        )
    return given
