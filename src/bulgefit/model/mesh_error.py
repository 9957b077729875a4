"""How large is the mesh's error, and what is left of it once it is taken off?

The error of balanced nodes falls with the square of the cell size, and hardly changes with the
parameters. So the difference between the nodes of two meshes tells the error of either
(Richardson, 1911), and a third, coarser one judges what that leaves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import SolveError
from bulgefit.model.inflation import Shapes
from bulgefit.model.smooth import smooth_value
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["correct_mesh", "mesh_remainder"]

Floats = NDArray[np.float64]


def correct_mesh(virtual: VirtualTest, shapes: Shapes) -> None:
    """Set the virtual test's correction from a finer mesh, at given shapes.

    Where the finer mesh finds no equilibrium there is none, and `mesh_remainder` says None.
    """
    virtual.correction = None
    if not virtual.setup.corrects_mesh:
        return
    fine = _finer(virtual.setup.refine)
    try:
        there = _on_mesh(virtual, fine, shapes)
    except SolveError:
        return
    ratio = (fine / virtual.setup.refine) ** 2
    virtual.correction = (there - shapes.displacement) * ratio / (ratio - 1.0)


def mesh_remainder(virtual: VirtualTest, shapes: Shapes) -> Floats | None:
    """What the correction leaves of the mesh's error at the nodes, (frames, n, 3) mm.

    Richardson's extrapolation from cells of sizes h and k leaves an error in h²k², so that of the
    rougher pair over that of the finer one is (fine/coarse)². None where it is not known.
    """
    correction, refine = virtual.correction, virtual.setup.refine
    if correction is None:
        return None
    coarse, fine = _coarser(refine), _finer(refine)
    try:
        fall = shapes.displacement - _on_mesh(virtual, coarse, shapes)
    except SolveError:
        return None
    other = fall / ((refine / coarse) ** 2 - 1.0)
    left = (other - correction) / ((fine / coarse) ** 2 - 1.0)
    return np.asarray(left)


def _finer(refine: int) -> int:
    return refine + max(1, refine // 2)


def _coarser(refine: int) -> int:
    return max(1, refine - max(1, refine // 4))


def _on_mesh(virtual: VirtualTest, refine: int, shapes: Shapes) -> Floats:
    """Displacements (frames, n, 3) mm of this mesh's nodes as another mesh has them."""
    setup = replace(virtual.setup, refine=refine, correct_mesh=False)
    other = VirtualTest(virtual.test, setup, virtual.threads)
    here, there = virtual.mesh.nodes, other.mesh.nodes
    between = smooth_value(here, there)
    guess = np.stack([between @ one for one in shapes.displacement])
    near = replace(shapes, displacement=guess, derivative={})
    try:
        found = other.shapes(shapes.values, near=near)
    except SolveError:
        found = other.shapes(shapes.values)
    back = smooth_value(there, here)
    return np.stack([back @ one for one in found.displacement])
