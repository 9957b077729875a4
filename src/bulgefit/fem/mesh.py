"""Meshes of four-node quadrilaterals: discs, rectangles, and any given arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bulgefit.errors import InputError

__all__ = ["DEFAULT_REFINE", "Mesh", "corner_areas", "disc", "ellipse", "rectangle"]

#: `disc` cells are 57 refine²: 912 cells, 961 nodes.
DEFAULT_REFINE = 4
#: 2.3 million cells, for which memory ends.
MOST_REFINE = 200
#: Coordinates up to which products of lengths stay well within floating point, mm.
_FARTHEST = 1e9


@dataclass(frozen=True, eq=False)
class Mesh:
    """A flat mesh of Q4 cells.

    Attributes
    ----------
    nodes : (n, 2) array, mm
    cells : (m, 4) int array
        Node numbers, counter-clockwise seen from +z.
    """

    nodes: NDArray[np.float64]
    cells: NDArray[np.int64]

    @classmethod
    def from_arrays(cls, nodes: ArrayLike, cells: ArrayLike) -> Mesh:
        """Check the arrays, turn clockwise cells round and return the mesh.

        Nodes may have a third column, which is left out: the mesh is flat.

        Raises
        ------
        InputError
            Wrong shapes, no numbers, node numbers that are not whole or out of range, nodes of no
            cell or far out of any membrane, cells that are degenerate or not convex, or that do not
            hang together.
        """
        try:
            points = np.ascontiguousarray(nodes, dtype=np.float64)
            numbers = np.array(cells, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError("mesh: give nodes and cells as arrays of numbers") from error
        if not (np.isfinite(numbers) & (numbers == np.floor(numbers))).all():
            raise InputError("mesh: cells must name nodes by whole numbers")
        quads = numbers.astype(np.int64)
        if points.ndim != 2 or points.shape[1] not in (2, 3) or not np.isfinite(points).all():
            raise InputError(f"mesh: nodes must be a finite (n, 2) array, got {points.shape}")
        points = np.ascontiguousarray(points[:, :2])
        if quads.ndim != 2 or quads.shape[1] != 4 or len(quads) == 0:
            raise InputError(f"mesh: cells must be an (m, 4) array of Q4 cells, got {quads.shape}")
        if quads.min() < 0 or quads.max() >= len(points):
            raise InputError(
                f"mesh: cells name nodes {quads.min()}..{quads.max()}, but there are "
                f"{len(points)} nodes numbered from 0"
            )
        unused = len(points) - len(np.unique(quads))
        if unused:
            raise InputError(f"mesh: {unused} nodes belong to no cell; remove them")
        if (reach := np.abs(points).max()) > _FARTHEST:
            raise InputError(
                f"mesh: nodes reach {reach:g} mm; give them in mm, up to {_FARTHEST:g} mm"
            )
        corner = corner_areas(points, quads)
        clockwise = (corner < 0).all(axis=1)
        quads[clockwise] = quads[clockwise][:, ::-1]
        bad = np.flatnonzero(~clockwise & (corner <= 0).any(axis=1))
        if len(bad):
            raise InputError(f"mesh: cell {bad[0]} is degenerate or not convex ({len(bad)} such)")
        parts = _parts(len(points), quads)
        if parts > 1:
            raise InputError(f"mesh: its cells fall into {parts} parts; give a single membrane")
        return cls(points, quads)

    @cached_property
    def rim_edges(self) -> NDArray[np.int64]:
        """Nodes (edges, 2) of the edges that belong to one cell only."""
        edges = np.sort(np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=2), axis=2)
        unique, count = np.unique(edges.reshape(-1, 2), axis=0, return_counts=True)
        return unique[count == 1]

    @cached_property
    def rim(self) -> NDArray[np.int64]:
        """Nodes on the rim's edges."""
        return np.unique(self.rim_edges)

    @cached_property
    def reach(self) -> float:
        """Largest distance of a node from the origin, mm."""
        return float(np.sqrt((self.nodes**2).sum(axis=1).max()))

    @property
    def apex(self) -> int:
        """The node nearest the origin."""
        return int(np.argmin((self.nodes**2).sum(axis=1)))


def corner_areas(points: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Twice the signed areas of the corner triangles, (m, 4) mm²."""
    here = points[cells]
    ahead = np.roll(here, -1, axis=1) - here
    behind = np.roll(here, 1, axis=1) - here
    return ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]


def _parts(count: int, cells: NDArray[np.int64]) -> int:
    """Pieces that cells with common nodes make of so many nodes."""
    ends = np.roll(cells, -1, axis=1)
    joined = coo_array((np.ones(cells.size), (cells.ravel(), ends.ravel())), shape=(count, count))
    return int(connected_components(joined, directed=False, return_labels=False))


def check_refine(refine: int) -> None:
    """Refuse a number of refinements that no mesh of ours has; InputError."""
    if not isinstance(refine, Integral) or not 1 <= refine <= MOST_REFINE:
        raise InputError(f"mesh: refine must be a whole number, 1 to {MOST_REFINE}, got {refine!r}")


def disc(radius: float = 100.0, refine: int = DEFAULT_REFINE) -> Mesh:
    """An O-grid: a rounded square in the middle, a ring of rays round it.

    The nodes are a smooth function of cell coordinates that does not depend on `refine`, so the
    discretisation error has a clean expansion and Richardson extrapolation holds.

    Parameters
    ----------
    radius : float, mm
    refine : int
        Cells grow as 57 refine² (refine 4: 912 cells, 961 nodes).

    Raises
    ------
    InputError
        Radius or `refine` cannot be.
    """
    check_refine(refine)
    if not isinstance(radius, Real) or not 0.0 < radius < np.inf:
        raise InputError(f"mesh: radius must be a length above 0 mm, got {radius!r}")
    side, ring = 3 * refine, 4 * refine
    core = 0.42  # half diagonal of the middle square over the radius
    t = np.linspace(-1.0, 1.0, side + 1)
    u, v = (g.ravel() for g in np.meshgrid(t, t, indexing="xy"))

    # Middle: a blend of a square and a disc, halfway, keeps its corner angles below 180°.
    square = np.stack([u, v], axis=1) / np.sqrt(2.0)
    round_ = np.stack([u * np.sqrt(1 - v**2 / 2), v * np.sqrt(1 - u**2 / 2)], axis=1)
    middle = core * (0.6 * square + 0.4 * round_)

    index = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)  # [row v, column u]
    edge = np.concatenate(  # counter-clockwise from the corner (-1, -1)
        [index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]]
    )
    outer_angle = -0.75 * np.pi + np.arange(4 * side) * (2 * np.pi / (4 * side))
    outer = np.stack([np.cos(outer_angle), np.sin(outer_angle)], axis=1)
    fraction = np.arange(1, ring + 1)[:, None, None] / ring
    rays = (1 - fraction) * middle[edge] + fraction * outer

    nodes = np.concatenate([middle, rays.reshape(-1, 2)]) * radius
    numbers = np.concatenate(
        [edge[None], len(middle) + np.arange(ring * 4 * side).reshape(ring, 4 * side)]
    )
    inner = np.stack(
        [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1
    ).reshape(-1, 4)
    following = np.roll(numbers, -1, axis=1)
    around = np.stack([numbers[:-1], numbers[1:], following[1:], following[:-1]], axis=-1).reshape(
        -1, 4
    )
    return Mesh.from_arrays(nodes, np.concatenate([inner, around]))


def ellipse(radius: float, ellipticity: float, refine: int = DEFAULT_REFINE) -> Mesh:
    """`disc` stretched to the semi-axes radius (1 + ellipticity), radius (1 - ellipticity), mm."""
    circle = disc(radius, refine)
    return Mesh(circle.nodes * [1.0 + ellipticity, 1.0 - ellipticity], circle.cells)


def rectangle(x: tuple[float, float], y: tuple[float, float], cells_x: int, cells_y: int) -> Mesh:
    """A regular grid on the rectangle `x` times `y` (mm)."""
    gx, gy = np.meshgrid(np.linspace(*x, cells_x + 1), np.linspace(*y, cells_y + 1), indexing="xy")
    index = np.arange(gx.size).reshape(gx.shape)
    cells = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    return Mesh.from_arrays(np.stack([gx.ravel(), gy.ravel()], axis=1), cells.reshape(-1, 4))
