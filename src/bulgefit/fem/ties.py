"""Nodes that copy others, as mirror images do: what a quarter of a membrane is made of.

With u = T v for the displacements v of the nodes that move by themselves, the potential's
derivatives are Tᵀ R and Tᵀ K T: forces on a copy are felt by the node that it copies, and the
entries of a cell's matrix go to the places of the copied nodes, with their signs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ties"]

Floats = NDArray[np.float64]

_ROWS, _COLUMNS = np.tril_indices(12)


@dataclass(frozen=True, eq=False)
class Ties:
    """Nodes that copy others, and how much of each cell counts.

    Attributes
    ----------
    original : (n,) int array
        The node that each node copies; its own number: none.
    sign : (n, 3) array
        A copy's displacement is its original's times this, +1 or -1.
    share : (m,) array
        Of each cell: ½ where a mirror cuts it in two.
    """

    original: NDArray[np.int64]
    sign: Floats
    share: Floats

    @cached_property
    def copies(self) -> NDArray[np.int64]:
        """The nodes that copy others."""
        return np.flatnonzero(self.original != np.arange(len(self.original)))

    @cached_property
    def _rounds(self) -> list[tuple[NDArray[np.int64], NDArray[np.int64], Floats]]:
        """Copies, their originals and signs, in groups that have no original twice."""
        left, rounds = self.copies, []
        while len(left):
            _, first = np.unique(self.original[left], return_index=True)
            now = left[first]
            rounds.append((now, self.original[now], self.sign[now]))
            left = np.delete(left, first)
        return rounds

    def fold(self, force: Floats) -> Floats:
        """Nodal forces (..., n, 3), those on copies added to their originals'."""
        out = force.copy()
        for copies, originals, sign in self._rounds:
            out[..., originals, :] += sign * force[..., copies, :]
        return out

    def follow(self, displacement: Floats) -> Floats:
        """Displacements (..., n, 3), those of copies taken from their originals."""
        out, copies = displacement.copy(), self.copies
        out[..., copies, :] = self.sign[copies] * out[..., self.original[copies], :]
        return out

    def times(self, cells: NDArray[np.int64], dof: NDArray[np.int64]) -> Floats:
        """How often each entry (m, 78) of the cells' lower triangles counts.

        Parameters
        ----------
        cells : (m, 4) int array
        dof : (n, 3) int array
            Number of each unknown, -1 where there is none.
        """
        sign = self.sign[cells].reshape(len(cells), 12)
        number = dof[self.original[cells]].reshape(len(cells), 12)
        # an entry between a node and its copy lands on the diagonal, and so does its transpose
        twice = (_ROWS != _COLUMNS) & (number[:, _ROWS] == number[:, _COLUMNS])
        times = sign[:, _ROWS] * sign[:, _COLUMNS] * np.where(twice, 2.0, 1.0)
        # in the order of `membrane.ONCE`, lest the kernels be compiled for both
        return np.ascontiguousarray(times)
