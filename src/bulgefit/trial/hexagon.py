"""The mesh of made tests: a hexagon of three rhombi inside six sectors; also of two plies.

Three cells meet at the centre; the mesh that diagnoses is a square in a ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.mesh import Mesh

__all__ = ["FINENESS", "TwoPlies", "hexagon"]

#: Cells along a rhombus: 7.5 FINENESS² cells, 4320.
FINENESS = 24
#: Half diagonal of the hexagon over the radius.
_CORE = 0.55


def hexagon(fineness: int) -> Mesh:
    """The unit disc: a hexagon of three rhombi, and six sectors around it.

    The nodes of `hexagon(n)` are among those of `hexagon(2 n)` where n is a multiple of 4.

    Parameters
    ----------
    fineness : int
        Cells along a rhombus.
    """
    corner = _CORE * np.exp(1j * np.pi / 3 * np.arange(7))
    share = np.linspace(0.0, 1.0, fineness + 1)
    patches = [
        share[:, None] * corner[2 * k] + share[None, :] * corner[(2 * k + 2) % 6] for k in range(3)
    ]
    out = np.linspace(0.0, 1.0, 3 * fineness // 4 + 1)[:, None]
    for k in range(6):
        edge = (1 - share) * corner[k] + share * corner[k + 1]
        rim = np.exp(1j * np.pi / 3 * (k + share))
        patches.append((1 - out) * edge + out * rim)
    return _joined(patches)


def _joined(patches: Sequence[NDArray[np.complex128]]) -> Mesh:
    """One mesh of patches, each a grid of points x + iy, that share their sides."""
    points = np.concatenate([patch.ravel() for patch in patches])
    keys = np.round(np.stack([points.real, points.imag], axis=1), 9) + 0.0
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    cells, start = [], 0
    for patch in patches:
        grid = number.ravel()[start : start + patch.size].reshape(patch.shape)
        start += patch.size
        corners = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        cells.append(np.stack(corners, axis=-1).reshape(-1, 4))
    chosen = points[first]
    return Mesh.from_arrays(np.stack([chosen.real, chosen.imag], axis=1), np.concatenate(cells))


class TwoPlies(Mesh):
    """Two plies on the same nodes: every cell twice, first those of the one, then of the other."""

    @classmethod
    def of(cls, mesh: Mesh) -> TwoPlies:
        """Two plies of a mesh."""
        return cls(mesh.nodes, np.concatenate([mesh.cells, mesh.cells]))

    @property
    def ply(self) -> Mesh:
        """One of them."""
        return Mesh(self.nodes, self.cells[: len(self.cells) // 2])

    @cached_property
    def rim_edges(self) -> NDArray[np.int64]:
        """Nodes (edges, 2) of the edges that belong to one cell only of a ply."""
        return self.ply.rim_edges
