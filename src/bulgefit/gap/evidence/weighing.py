"""A diagnosis as a problem of evidence: specimens under effects and fields, by their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from bulgefit.errors import SolveError
from bulgefit.fem.linear import NotPositiveDefiniteError
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.problem import Columns, Group, Linearised
from bulgefit.model.inflation import Shapes
from bulgefit.model.virtual_test import Prediction

__all__ = ["Weighing"]

Floats = NDArray[np.float64]


class Weighing:
    """The misfit of specimens by coordinates (`problem.Problem`).

    Parameters
    ----------
    data : sequence of Data
    coordinates : Coordinates
    offsets : sequence of (3,) array, mm, optional
        By specimen: standard deviations of the prior of an offset of every measured point, which
        all its frames share. Such offsets are no coordinates: they are integrated out.
    """

    def __init__(
        self,
        data: Sequence[Data],
        coordinates: Coordinates,
        offsets: Sequence[Floats] | None = None,
    ) -> None:
        self.data, self.coordinates, self.offsets = data, coordinates, offsets

    @property
    def groups(self) -> Sequence[Group]:
        """As the coordinates have them."""
        return self.coordinates.groups

    @property
    def inflation(self) -> float:
        """Of the noise, over all specimens."""
        return float(np.mean([d.inflation for d in self.data]))

    @property
    def count(self) -> int:
        """Values that are compared."""
        return sum(int(d.used.sum()) for d in self.data)

    def afresh(self) -> Weighing:
        """The same, by specimens that remember nothing of earlier solves."""
        return Weighing([d.afresh() for d in self.data], self.coordinates, self.offsets)

    @property
    def cost(self) -> float:
        """Of the offsets, to be added to a score: what ln det A + 2 Σ ln s is of coordinates.

        With a prior of t noise units, n frames of a point: ln(1 + n t²), for one in v points, since
        so many count as one.
        """
        if self.offsets is None:
            return 0.0
        return sum(
            float(np.log1p(_frames_that_count(d) * (t / d.sigma) ** 2).sum()) / d.inflation
            for d, t in zip(self.data, self.offsets, strict=True)
        )

    def linearise(self, x: Floats, columns: Columns, near: Any = None) -> Linearised:
        """See `Problem`; `near` are the shapes of a neighbouring point."""
        size = len(columns) + 1
        gram, shapes = np.zeros((size, size)), []
        for index, d in enumerate(self.data):
            own = self.coordinates.of_specimen(columns, index)
            found = self.predicted(x, own, index, None if near is None else near[index])
            if near is not None and _loses_stability(near[index], found.shapes):
                raise _lost_stability(d, found)
            shapes.append(found.shapes)
            place = np.append(np.searchsorted(columns, own), size - 1)
            gram[np.ix_(place, place)] += self._gram(index, self._rows(d, found, x, own))
        return Linearised(
            np.array(x), columns, float(gram[-1, -1]), gram[:-1, -1], gram[:-1, :-1], shapes
        )

    def predicted(
        self, x: Floats, columns: Sequence[int], index: int, near: Any = None
    ) -> Prediction:
        """One specimen's displacements with derivatives by some of its coordinates."""
        names = [self.coordinates.every[c].key.name for c in columns]
        specimen, values = self.data[index].specimen, self.coordinates.values(x, index)
        try:
            return specimen.predict(values, names, near)
        except NotPositiveDefiniteError as error:
            # moduli so far off that a tangent is nothing to the last digit
            raise _no_shape(f"the tangent cannot be solved ({error})", values) from error

    def _gram(self, index: int, rows: Floats) -> Floats:
        """Products of rows (k, frames, points, 3), the offsets and the mesh's error taken off."""
        d = self.data[index]
        if d.mesh is not None:
            rows = np.concatenate([rows, np.where(d.used, d.mesh, 0.0)[None] * d.weight])
        flat = rows.reshape(len(rows), -1)
        upper = dsyrk(1.0, flat.T, trans=1)
        gram = upper + np.triu(upper, 1).T
        if self.offsets is not None:
            gram -= _of_offsets(d, self.offsets[index], rows)
        return gram if d.mesh is None else _beside_mesh(gram, d.inflation)

    def _rows(self, d: Data, found: Prediction, x: Floats, columns: Sequence[int]) -> Floats:
        """Derivatives by coordinates and the residual, in noise units.

        (columns + 1, frames, points, 3).
        """
        weight = d.weight
        rows = np.empty((len(columns) + 1, *weight.shape))
        for row, c, derivative in zip(rows[:-1], columns, found.derivative, strict=True):
            coordinate = self.coordinates.every[c]
            slope = coordinate.parameter.slope(coordinate.value(x[c]))
            np.multiply(derivative, slope * weight, out=row)
        rows[-1] = d.residual(found)
        return rows


def _frames_that_count(d: Data) -> Floats:
    """Of each point's components (points, 3)."""
    return np.tensordot(d.share**2, d.used, 1)


def _of_offsets(d: Data, prior: Floats, rows: Floats) -> Floats:
    """What offsets of the points take off products of rows.

    With the sum S of a point's rows over its n frames and a prior of t noise units, the best offset
    takes SSᵀ/(n + 1/t²) off; frames count by their trust.
    """
    number, square = _frames_that_count(d), (prior / d.sigma) ** 2
    share = np.sqrt(square / (1.0 + number * square))
    sums = (np.tensordot(rows, d.share, (1, 0)) * share).reshape(len(rows), -1)
    return np.asarray(sums @ sums.T)


def _beside_mesh(gram: Floats, inflation: float) -> Floats:
    """Products of rows where what is left of the mesh's error is noise of one more direction.

    It is known in its pattern m, the last row, and in its size to about itself. With noise of
    covariance v 1 + m mᵀ, v C⁻¹ = 1 - m mᵀ/(v + mᵀm) (Sherman and Morrison, 1950).
    """
    along = gram[:-1, -1]
    return np.asarray(gram[:-1, :-1] - np.outer(along, along) / (inflation + gram[-1, -1]))


def _loses_stability(before: Shapes, after: Shapes) -> bool:
    """Whether a step did that; a point looked at again is none."""
    return bool((before.stable & ~after.stable).any()) and before.values != after.values


def _lost_stability(d: Data, found: Prediction) -> SolveError:
    """Beyond it fields are as wild as the mesh allows: no step leads there."""
    first = float(d.specimen.recorded[~found.shapes.stable].min())
    return _no_shape("the fabric loses its stability", found.shapes.values, first)


def _no_shape(reason: str, values: Mapping[str, float], pressure: float = 0.0) -> SolveError:
    return SolveError(
        reason,
        pressure=pressure,
        reached=pressure,
        iteration=0,
        residual_norm=0.0,
        parameters=values,
    )
