"""Take the mesh's error off a virtual test, and judge what is left of it.

It falls with the square of the cells where shapes are smooth. Bands of shear, which may form where
the law is not elliptic, are not: they are as wide as a cell, and lie elsewhere on every mesh. What
is not stable keeps its error, and so does what other meshes do not have alike.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import SolveError
from bulgefit.model.inflation import Shapes
from bulgefit.model.richardson import (
    agrees,
    coarser,
    finer,
    left_over,
    taken_off,
    told_by_coarser,
)
from bulgefit.model.smooth import smooth_value
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["correct_mesh", "corrected", "is_taken_off", "mesh_remainder"]

Floats = NDArray[np.float64]


def correct_mesh(virtual: VirtualTest, shapes: Shapes) -> None:
    """Set the virtual test's correction from a finer mesh, at given shapes.

    It hardly changes with the parameters. Where the finer mesh finds no equilibrium there is none,
    none in frames that are not stable on both, and where the law is not elliptic none that a
    coarser mesh does not confirm; `mesh_remainder` says None.
    """
    virtual.correction = None
    if not virtual.setup.corrects_mesh:
        return
    refine = virtual.setup.refine
    try:
        there, stable = _on_mesh(virtual, finer(refine), shapes)
    except SolveError:
        return
    virtual.correction = taken_off(refine, shapes.displacement, there)
    known = shapes.stable & stable
    doubted = known & ~_elliptic(virtual, shapes)
    if doubted.any():
        known &= ~doubted | _confirmed(virtual, shapes, virtual.correction)
    virtual.correction[~known] = 0.0


def _elliptic(virtual: VirtualTest, shapes: Shapes) -> NDArray[np.bool_]:
    """Whether the law is elliptic all over the shape of each frame, (frames,)."""
    given = virtual.description(shapes.values)
    membrane = virtual.inflation.membrane(given)
    return np.array([membrane.is_elliptic(one, given.stiffness) for one in shapes.displacement])


def _confirmed(virtual: VirtualTest, shapes: Shapes, correction: Floats) -> NDArray[np.bool_]:
    """Whether a coarser mesh tells much the same of each frame, (frames,)."""
    refine = virtual.setup.refine
    try:
        coarse, stable = _on_mesh(virtual, coarser(refine), shapes)
    except SolveError:
        return np.zeros(len(correction), dtype=bool)
    other = told_by_coarser(refine, shapes.displacement, coarse)
    return np.asarray(stable & agrees(correction, other))


def corrected(virtual: VirtualTest, shapes: Shapes) -> NDArray[np.bool_]:
    """Frames in which the correction holds, or these shapes have not moved at all."""
    moved = np.any(shapes.displacement, axis=(1, 2))
    if virtual.correction is None:
        return ~moved
    return np.any(virtual.correction, axis=(1, 2)) | ~moved


def is_taken_off(virtual: VirtualTest, shapes: Shapes) -> bool:
    """Whether there is a correction, and it holds for every frame."""
    return virtual.correction is not None and bool(corrected(virtual, shapes).all())


def mesh_remainder(virtual: VirtualTest, shapes: Shapes) -> Floats | None:
    """What the correction leaves of the mesh's error at the nodes, (frames, n, 3) mm.

    None where it is not known.
    """
    correction, refine = virtual.correction, virtual.setup.refine
    if correction is None or not is_taken_off(virtual, shapes):
        return None
    try:
        coarse, stable = _on_mesh(virtual, coarser(refine), shapes)
    except SolveError:
        return None
    if not stable.all():
        return None
    return left_over(refine, shapes.displacement, correction, coarse)


def _on_mesh(virtual: VirtualTest, refine: int, shapes: Shapes) -> tuple[Floats, NDArray[np.bool_]]:
    """Displacements (frames, n, 3) mm of this mesh's nodes as another mesh has them; if stable."""
    setup = replace(virtual.setup, refine=refine, correct_mesh=False)
    other = VirtualTest(virtual.test, setup, virtual.threads)
    here, there = virtual.circle.nodes, other.circle.nodes
    found = _found(other, shapes, here, there)
    back = smooth_value(there, here)
    return np.stack([back @ one for one in found.displacement]), found.stable


def _found(other: VirtualTest, shapes: Shapes, here: Floats, there: Floats) -> Shapes:
    """Shapes of another mesh, by their own path where it is one of a quarter, else by these."""
    if not other.description(shapes.values).is_plain:
        between = smooth_value(here, there)
        guess = np.stack([between @ one for one in shapes.displacement])
        near = replace(shapes, displacement=guess, derivative={})
        with suppress(SolveError):
            return other.shapes(shapes.values, near=near)
    return other.shapes(shapes.values)
