"""A diagnosis as a problem of evidence: specimens under effects and fields, by their noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from bulgefit.errors import SolveError
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
    """

    def __init__(self, data: Sequence[Data], coordinates: Coordinates) -> None:
        self.data, self.coordinates = data, coordinates

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
            rows = self._rows(d, found, x, own)
            upper = dsyrk(1.0, rows.T, trans=1)
            place = np.append(np.searchsorted(columns, own), size - 1)
            gram[np.ix_(place, place)] += self._beside_mesh(d, rows, upper + np.triu(upper, 1).T)
        return Linearised(
            np.array(x), columns, float(gram[-1, -1]), gram[:-1, -1], gram[:-1, :-1], shapes
        )

    def predicted(
        self, x: Floats, columns: Sequence[int], index: int, near: Any = None
    ) -> Prediction:
        """One specimen's displacements with derivatives by some of its coordinates."""
        names = [self.coordinates.every[c].key.name for c in columns]
        return self.data[index].specimen.predict(self.coordinates.values(x, index), names, near)

    def _beside_mesh(self, d: Data, rows: Floats, gram: Floats) -> Floats:
        """Gram matrix where what is left of the mesh's error is noise of one more direction.

        It is known in its pattern m, and in its size to about itself. With noise of covariance
        v 1 + m mᵀ, v C⁻¹ = 1 - m mᵀ/(v + mᵀm) (Sherman and Morrison, 1950).
        """
        if d.mesh is None:
            return gram
        pattern = np.where(d.used, d.mesh / d.sigma, 0.0).ravel()
        along = rows @ pattern
        return gram - np.outer(along, along) / (d.inflation + pattern @ pattern)

    def _rows(self, d: Data, found: Prediction, x: Floats, columns: Sequence[int]) -> Floats:
        """Derivatives by coordinates and the residual, (columns + 1, values), in noise units."""
        weight = d.used / d.sigma
        rows = np.empty((len(columns) + 1, *weight.shape))
        for row, c, derivative in zip(rows[:-1], columns, found.derivative, strict=True):
            coordinate = self.coordinates.every[c]
            slope = coordinate.parameter.slope(coordinate.value(x[c]))
            np.multiply(derivative, slope * weight, out=row)
        rows[-1] = d.residual(found)
        return rows.reshape(len(rows), -1)


def _loses_stability(before: Shapes, after: Shapes) -> bool:
    """Whether a step did that; a point looked at again is none."""
    return bool((before.stable & ~after.stable).any()) and before.values != after.values


def _lost_stability(d: Data, found: Prediction) -> SolveError:
    """Beyond it fields are as wild as the mesh allows: no step leads there."""
    first = float(d.specimen.recorded[~found.shapes.stable].min())
    return SolveError(
        "the fabric loses its stability",
        pressure=first,
        reached=first,
        iteration=0,
        residual_norm=0.0,
        parameters=found.shapes.values,
    )
