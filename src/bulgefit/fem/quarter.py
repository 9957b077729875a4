"""Trace a quarter of a membrane where its shapes mirror in both axes.

A flat disc of a fabric whose warp runs along x or y, evenly clamped and inflated, takes shapes that
mirror in both axes. The displacements that keep to these mirrors, u = T v (see `ties`), are a
quarter of all, and their tangent a sixteenth of the work. That the others stay zero asks for
stability against them: the whole tangent falls apart into those of the four ways of being even or
odd in each mirror (Healey, 1988, A group-theoretic approach to computational bifurcation
problems with symmetry, sec. 4), so it is positive definite where all four are. Where one is not,
or where the path stops at a shape that is not known, the whole membrane is traced; unless unstable
shapes are followed too: the whole's steps then keep to the mirrors as well, at ten times the cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product, takewhile
from operator import itemgetter
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.errors import Cause
from bulgefit.fem.linear import LinearSolver, NotPositiveDefiniteError
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.path import Path
from bulgefit.fem.ties import Ties
from bulgefit.fem.trace import TOLERANCE, Traced, traced

__all__ = ["Quarter", "along_axis", "quarter_of", "trace_by_quarter"]

Floats = NDArray[np.float64]

#: Nodes are mirror images of each other within this share of the radius.
_ALIKE = 1e-10
#: What the mirrors x -> -x and y -> -y do to a displacement.
_MIRRORS = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Quarter:
    """The cells of a membrane with x, y >= 0, and how the rest follows.

    Attributes
    ----------
    even : Membrane
        Its shapes are even in both mirrors.
    odd : tuple of three Membranes
        Small displacements that are odd in one mirror or both.
    node : (n,) int array
        The quarter's node that is, or mirrors, each node of the whole.
    sign : (n, 3) array
        Displacement of each node of the whole over that node's.
    kept : (q,) int array
        The whole's nodes that are the quarter's.
    """

    even: Membrane
    odd: tuple[Membrane, ...]
    node: NDArray[np.int64]
    sign: Floats
    kept: NDArray[np.int64]

    def alike(self, membrane: Membrane) -> Quarter:
        """The quarter of another membrane of the same mesh, with the linear solvers of this one."""

        def of_kind(kind: Membrane) -> Membrane:
            return Membrane(
                kind.mesh, membrane.thickness, membrane.law, relaxation=membrane.relaxation,
                angle=membrane.angle, fixed=kind.fixed, solver=membrane.forced,
                fabric=membrane.fabric, like=kind, ties=kind.ties,
            )  # fmt: skip

        return replace(self, even=of_kind(self.even), odd=tuple(of_kind(k) for k in self.odd))

    def whole(self, field: Floats) -> Floats:
        """A field (..., n, 3) of the whole from that of the quarter."""
        return field[..., self.node, :] * self.sign

    def stable(self, path: Path, stiffness: Floats) -> NDArray[np.bool_]:
        """Whether no small displacement of any kind lowers the potential, at each level."""
        out = path.stable.copy()
        for level in np.flatnonzero(out):
            shape, pressure = path.displacement[level], float(path.pressure[level])
            out[level] = self.keeps(shape, pressure, stiffness)
        return out

    def ends_alike(self, found: Traced, kept: NDArray[np.bool_], stiffness: Floats) -> bool:
        """Whether the whole ends where and why the quarter does (`found.error`).

        What ends the quarter's path ends the whole's, unless an odd displacement has left it
        before: at a level that is not `kept` (levels,), or by the last shape, if it is known.
        """
        error = found.error
        assert error is not None
        if error.cause is Cause.INADMISSIBLE:
            return True
        if found.path is None or found.last is None:
            return False
        kept = kept[found.path.pressure <= error.reached]
        return bool(kept.all()) and self.keeps(found.last, error.reached, stiffness)

    def keeps(self, shape: Floats, pressure: float, stiffness: Floats) -> bool:
        """Whether no small odd displacement lowers the potential at a balanced shape (q, 3) mm."""
        try:
            for membrane in self.odd:
                membrane.factorise(membrane.state(shape, pressure, stiffness), spent=True)
        except NotPositiveDefiniteError:
            return False
        return True


def trace_by_quarter(
    membrane: Membrane,
    stiffness: Floats,
    pressure: tuple[float, float] = (1e-4, 0.3),
    *,
    tolerance: float = TOLERANCE,
    sensitivities: bool = False,
    parameters: Mapping[str, float] | None = None,
    beyond_ellipticity: bool = False,
) -> Path:
    """`trace`, of a quarter of the membrane where shapes mirror in both axes and are followed.

    Parameters and errors are those of `trace`. The path's `factorisations` are then those of
    the quarter, three a level to see that it is stable included.
    """
    quarter, begun = quarter_of(membrane), list[tuple[float, Floats]]()
    if quarter is not None:
        found = traced(
            quarter.even, stiffness, pressure, tolerance=tolerance,
            sensitivities=sensitivities, parameters=parameters,
            beyond_ellipticity=beyond_ellipticity,
        )  # fmt: skip
        path, stable = found.path, np.zeros(0, dtype=bool)
        if path is not None:
            stable = quarter.stable(path, stiffness)
            if found.error is None and (beyond_ellipticity or stable.all()):
                return _whole(replace(path, stable=stable), quarter, membrane, stiffness)
            # so far the whole does as the quarter did
            alike = zip(path.pressure, path.displacement, stable, strict=True)
            begun = [(float(p), quarter.whole(u)) for p, u, _ in takewhile(itemgetter(2), alike)]
        if found.error is not None and quarter.ends_alike(found, stable, stiffness):
            raise found.error
    whole = traced(
        membrane, stiffness, pressure, tolerance=tolerance,
        sensitivities=sensitivities, parameters=parameters,
        beyond_ellipticity=beyond_ellipticity, begun=begun,
    )  # fmt: skip
    return whole.whole()


def _whole(path: Path, quarter: Quarter, membrane: Membrane, stiffness: Floats) -> Path:
    """The path of the whole membrane from that of its quarter."""

    def spread(field: Floats | None) -> Floats | None:
        return None if field is None else quarter.whole(field)

    displacement, wrinkled = quarter.whole(path.displacement), path.wrinkled
    if wrinkled.any():
        wrinkled = np.array(
            [
                membrane.state(shape, p, stiffness, tangent=False).wrinkled
                for shape, p in zip(displacement, path.pressure, strict=True)
            ]
        )
    return replace(
        path,
        nodes=membrane.mesh.nodes,
        cells=membrane.mesh.cells,
        displacement=displacement,
        slope=quarter.whole(path.slope),
        sensitivity=spread(path.sensitivity),
        sensitivity_slope=spread(path.sensitivity_slope),
        factorisations=path.factorisations + len(quarter.odd) * len(path.pressure),
        wrinkled=wrinkled,
    )


_KNOWN: WeakKeyDictionary[Membrane, Quarter | None] = WeakKeyDictionary()
#: Of the first membrane of each mesh: those that share its linear solver are cut as it was.
_CUT: WeakKeyDictionary[LinearSolver, Quarter | None] = WeakKeyDictionary()


def along_axis(angle: float) -> bool:
    """Whether a warp at an angle (rad) to x runs along x or y."""
    return angle % (0.5 * np.pi) == 0.0


def quarter_of(membrane: Membrane) -> Quarter | None:
    """The quarter of a membrane, made once; None where its shapes need not mirror."""
    try:
        return _KNOWN[membrane]
    except KeyError:
        found = _KNOWN[membrane] = _quarter_of(membrane)
        return found


def _quarter_of(membrane: Membrane) -> Quarter | None:
    fabric = membrane.fabric
    uneven = fabric.surface is not None or fabric.thickness is not None or any(fabric.coupling)
    if uneven or fabric.compliance is not None or not along_axis(membrane.angle) or membrane.ties:
        return None
    try:
        first = _CUT[membrane.linear]
    except KeyError:
        first = _CUT[membrane.linear] = _cut(membrane)
        return first
    return None if first is None else first.alike(membrane)


def _cut(membrane: Membrane) -> Quarter | None:
    fabric, mesh = membrane.fabric, membrane.mesh
    images = _images(mesh)
    if images is None or any((membrane.fixed[i] != membrane.fixed).any() for i in images):
        return None
    # a node's representative has no negative coordinate: it lies beyond the mirrors that it is
    # `over`
    near = _ALIKE * membrane.radius
    over = mesh.nodes < -near
    first = np.where(over[:, 0], images[0], np.arange(len(mesh.nodes)))
    first = np.where(over[:, 1], images[1][first], first)
    centre = mesh.nodes[mesh.cells].mean(axis=1)
    mine = (centre > -near).all(axis=1)
    kept, cells = np.unique(mesh.cells[mine], return_inverse=True)
    number = np.full(len(mesh.nodes), -1)
    number[kept] = np.arange(len(kept))
    part = Mesh(mesh.nodes[kept], cells.reshape(-1, 4))
    share = 0.5 ** (np.abs(centre[mine]) <= near).sum(axis=1)
    on = np.abs(part.nodes) <= near

    def of_kind(parity: tuple[float, ...]) -> tuple[Membrane, Floats]:
        """The quarter of displacements that are even (+1) or odd (-1) in each mirror."""
        turn = np.array(parity)[:, None] * _MIRRORS
        sign = np.where(over[:, :, None], turn, 1.0).prod(axis=1)
        # what a mirror turns round on itself is zero
        held = membrane.fixed[kept] | (on[:, :, None] & (turn < 0.0)).any(axis=1)
        ties = Ties(number[first[kept]], sign[kept], share)
        return Membrane(
            part, membrane.thickness, membrane.law, relaxation=membrane.relaxation,
            angle=membrane.angle, fixed=held, solver=membrane.forced, fabric=fabric, ties=ties,
        ), sign  # fmt: skip

    (even, sign), *odd = (of_kind(parity) for parity in product((1.0, -1.0), repeat=2))
    return Quarter(even, tuple(other for other, _ in odd), number[first], sign, kept)


def _images(mesh: Mesh) -> list[NDArray[np.int64]] | None:
    """Each node's mirror images in x and y; None where the mesh does not mirror."""
    tree = KDTree(mesh.nodes)
    near = _ALIKE * float(np.abs(mesh.nodes).max())
    known = {frozenset(cell) for cell in mesh.cells.tolist()}
    found = []
    for mirror in _MIRRORS:
        distance, image = tree.query(mesh.nodes * mirror[:2])
        if distance.max() > near:
            return None
        if any(frozenset(cell) not in known for cell in image[mesh.cells].tolist()):
            return None
        found.append(image)
    return found
