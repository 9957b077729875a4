"""The published objectives: how far a virtual test is from the measured one, in mm.

For a test with N measured values of a component over all points and pressures,

    r_dx = 1/N Σ |dx_model - dx_test|,    likewise r_dy, r_dz
    e    = r_dx + r_dy + r_dz
    e_w  = r_dx + r_dy + w r_dz,          w = ½ (max|dx| + max|dy|) / max|dz| of the tests
    e_z  = 1/F Σ |dz_model - dz_test|     at the point nearest the centre, F frames

and for several tests the mean over tests. The study's paper averages over all points of a test
(`average="points"`, the default here); its code averages over each frame first
(`average="frames"`), which weighs sparse frames up.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting.l1 import Rows, absolute_sums, count_and_peaks, linearised_rows
from bulgefit.model.observation import Observation
from bulgefit.model.parameters import Material
from bulgefit.model.virtual_test import Fields, Setup, VirtualTests, apex_blocks

__all__ = ["OBJECTIVES", "Objective", "TestParts", "displacement_weight"]

Floats = NDArray[np.floating]

OBJECTIVES = ("e", "e_w", "e_z")
AVERAGES = ("points", "frames")

#: Measured values that stand for all data where a descent needs curvature alone.
SAMPLE = 100_000


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


class Objective:
    """One of the published objectives on given tests.

    Parameters
    ----------
    tests : sequence of BulgeTest
    name : {"e", "e_w", "e_z"}
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
        if name not in OBJECTIVES:
            raise InputError(f"objective: {name!r} is unknown; choose from {', '.join(OBJECTIVES)}")
        if average not in AVERAGES:
            raise InputError(f"average: {average!r} is unknown; choose from {', '.join(AVERAGES)}")
        self.name = name
        self.average = average
        self.virtual = VirtualTests(tests, setup)
        self.tests = self.virtual.tests
        self.weights = _component_weights(self.tests, weight)
        factors = {"e": np.ones(3), "e_w": self.weights, "e_z": np.array([0.0, 0.0, 1.0])}[name]
        shared = factors / len(self.tests)
        self._whole = [_Part(test, test.blocks, average, shared) for test in self.tests]
        self._apex = [_Part(test, apex_blocks(test), average, shared) for test in self.tests]
        self._parts = self._apex if name == "e_z" else self._whole
        for part in self._parts:
            if part.empty:
                raise InputError(
                    f"{part.test.name}: nothing was measured that {name} compares"
                    + (" (no dz near the centre)" if name == "e_z" else "")
                )
        values = sum(int(part.counts[:, factors > 0].sum()) for part in self._parts)
        self._kept = min(1.0, SAMPLE / values)
        self._samples: dict[int, list[_Sample]] = {}

    def __getstate__(self) -> dict[str, object]:
        # copies of the data, made again wherever they are needed
        return {**self.__dict__, "_samples": {}}

    @property
    def weight(self) -> float:
        """Weight of dz in e_w."""
        return float(self.weights[2])

    def value(self, material: Material) -> float:
        """The objective, mm; raises SolveError or InputError (inadmissible parameters)."""
        return self.from_fields(self.virtual.fields(material))

    def gradient(self, material: Material) -> tuple[float, Floats]:
        """The objective, mm, and its derivative by every parameter of the material."""
        return self.slope(self.virtual.fields(material, derivatives=True))

    def from_fields(self, fields: Sequence[Fields]) -> float:
        """The objective of given nodal displacements, mm."""
        total = 0.0
        for part, field in zip(self._parts, fields, strict=True):
            for sums, scale in zip(self._sums(part, field), part.scales, strict=True):
                total += float((scale * sums).sum())
        return total

    def slope(self, fields: Sequence[Fields]) -> tuple[float, Floats]:
        """The objective of given fields, mm, and its derivative by the fields' parameters.

        One pass over the data, whatever the number of parameters: the derivative by the nodal
        displacements is gathered first.
        """
        total, slope = 0.0, np.zeros(0)
        for part, field in zip(self._parts, fields, strict=True):
            assert field.derivative is not None
            for block, scale in zip(part.blocks, part.scales, strict=True):
                nodal = _of_frames(field.displacement, block)
                pull = np.empty_like(nodal)
                sums = absolute_sums(
                    self.virtual.observation(part.test, block),
                    nodal,
                    block.displacement,
                    scale,
                    pull,
                )
                total += float((scale * sums).sum())
                columns = _of_frames(field.derivative, block)
                share = columns.reshape(len(columns), -1) @ pull.ravel()
                slope = share if not len(slope) else slope + share
        return total, slope

    def rows(self, fields: Sequence[Fields], columns: Floats) -> Rows:
        """Residuals and their derivatives: all, or a sample that stands for them.

        Parameters
        ----------
        fields : sequence of Fields
            With derivatives.
        columns : (parameters, free) array
            Derivative of the fields' parameters by the free coordinates.
        """
        found = []
        for i, (part, field) in enumerate(zip(self._parts, fields, strict=True)):
            assert field.derivative is not None
            found += [
                linearised_rows(
                    sample.operator,
                    _of_frames(field.displacement, sample.block),
                    _of_frames(field.derivative, sample.block),
                    sample.block.displacement,
                    sample.scale,
                )
                for sample in self._sampled(i, part)
            ]
        jacobian, residual, scale = (np.concatenate(items) for items in zip(*found, strict=True))
        return Rows(jacobian @ columns, residual, scale, whole=self._kept == 1.0)

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
        other._samples = {}
        return None if any(part.empty for part in other._parts) else other

    def parts(self, fields: Sequence[Fields]) -> list[TestParts]:
        """Every objective of every test for given nodal displacements."""
        return [
            self._test_parts(whole, apex, field)
            for whole, apex, field in zip(self._whole, self._apex, fields, strict=True)
        ]

    def resting(self) -> list[Fields]:
        """Fields of a model that does not deform (the study's Table 5)."""
        return [
            Fields(np.zeros((test.n_frames, len(self.virtual.membrane(test).mesh.nodes), 3)), None)
            for test in self.tests
        ]

    def combined(self, parts: Sequence[TestParts]) -> dict[str, float | None]:
        """Means over tests of e, e_w and e_z, mm."""
        return {
            key: None
            if any(getattr(p, key) is None for p in parts)
            else float(np.mean([getattr(p, key) for p in parts]))
            for key in OBJECTIVES
        }

    def _sums(self, part: _Part, field: Fields) -> list[Floats]:
        return [
            absolute_sums(
                self.virtual.observation(part.test, block),
                _of_frames(field.displacement, block),
                block.displacement,
                np.zeros((len(block.frames), 3)),
            )
            for block in part.blocks
        ]

    def _sampled(self, index: int, part: _Part) -> list[_Sample]:
        if index not in self._samples:
            self._samples[index] = [
                _sample(block, self.virtual.observation(part.test, block), scale, self._kept)
                for block, scale in zip(part.blocks, part.scales, strict=True)
            ]
        return self._samples[index]

    def _test_parts(self, whole: _Part, apex: _Part, field: Fields) -> TestParts:
        r = whole.means(self._sums(whole, field))
        near = apex.means(self._sums(apex, field))[2] if apex.blocks else None
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


@dataclass(frozen=True, eq=False)
class _Sample:
    """Some points of a block in all its frames; `scale` makes their sums stand for all."""

    operator: Observation
    block: Block
    scale: Floats


def _sample(block: Block, operator: Observation, scale: Floats, share: float) -> _Sample:
    count = len(block.reference)
    kept = max(1, round(share * count))
    if kept == count:
        return _Sample(operator, block, scale)
    # drawn, since every so many points of a grid may lie on a line
    points = np.sort(np.random.default_rng(0).permutation(count)[:kept])
    some = Block(block.reference[points], block.frames, block.displacement[:, points])
    return _Sample(Observation(operator.matrix[points]), some, scale * (count / kept))


def _of_frames(field: Floats, block: Block) -> Floats:
    """The frames of a block from (..., frames, n, 3), without a copy where it has them all."""
    if len(block.frames) == field.shape[-3]:
        return np.ascontiguousarray(field)
    return np.ascontiguousarray(field[..., block.frames, :, :])


class _Part:
    """Blocks of one test that an objective looks at, and the factor of each frame's sums."""

    def __init__(
        self,
        test: BulgeTest,
        blocks: tuple[Block, ...],
        average: str,
        factors: Floats,
    ) -> None:
        self.test, self.blocks = test, blocks
        self._average, self._factors = average, factors
        self._counted = [count_and_peaks(block.displacement)[0] for block in blocks]
        self.counts = np.concatenate(self._counted) if blocks else np.zeros((0, 3), dtype=int)
        self._weigh(np.ones(test.n_frames))

    def repeated(self, times: Floats) -> _Part:
        """The same, with each frame of the test counted so many times (frames,)."""
        other = copy(self)
        other._weigh(times)
        return other

    @property
    def empty(self) -> bool:
        """Whether no value counts in the objective."""
        return not any(scale.any() for scale in self.scales)

    def _weigh(self, times: Floats) -> None:
        often = [times[block.frames, None] for block in self.blocks]
        pairs = list(zip(self._counted, often, strict=True))
        if self._average == "points":
            values = sum(((c * t).sum(axis=0) for c, t in pairs), start=np.zeros(3))
            self._share = [t / np.maximum(values, 1) * np.ones(3) for _, t in pairs]
        else:
            frames = sum((((c > 0) * t).sum(axis=0) for c, t in pairs), start=np.zeros(3))
            self._share = [t / (np.maximum(c, 1) * np.maximum(frames, 1)) for c, t in pairs]
        self.scales = [
            share * (c > 0) * self._factors
            for share, c in zip(self._share, self._counted, strict=True)
        ]

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
        raise InputError(f"weight: one of dz, or three of dx, dy, dz, none negative; got {weight}")
    return given
