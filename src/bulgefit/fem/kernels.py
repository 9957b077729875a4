"""Energy, forces and tangent of a Q4 membrane, assembled over the cells.

Total potential of the membrane under a follower pressure p, with reference area element A and
thickness t,

    Π(x) = ∫ t W(FᵀF) dA - p V(x),        F = Σ x_a ⊗ G_a,
    V(x) = ⅓ ∫ x · (x,ξ × x,η) dξdη.

Its first derivative is the out-of-balance force, its second the tangent. With B_a = ∂E/∂x_a,

    R_a  = ∫ t B_aᵀ S dA - p ∫ N_a x,ξ × x,η dξdη
    K_ab = ∫ t (B_aᵀ CC B_b + (G_a·S·G_b) 1) dA - p ∂²V/∂x_a∂x_b.

Two by two Gauss points integrate V exactly. The load stiffness of a single cell is not
symmetric, but its skew part lives on the boundary and cancels for a membrane that is held at its
rim or slides in a plane of symmetry (Bufler, 1984), so the symmetric part is assembled.
"""

from __future__ import annotations

import numpy as np

from bulgefit.fem.geometry import SHAPE, SHAPE_ETA, SHAPE_XI
from bulgefit.fem.jit import compiled, inlined
from bulgefit.fem.laws import respond, stress_sensitivity

__all__ = ["assemble", "assemble_pressure", "assemble_sensitivity"]


def _load_coupling():
    """∂²V/∂x_a∂x_b of a cell is the cross product with Σ_c coupling[a, b, c] x_c, (4, 4, 4).

    That is its symmetric part: half of what the two orders of a and b give.
    """
    u = np.einsum("ga,gb,gc->abc", SHAPE, SHAPE_ETA, SHAPE_XI)
    v = np.einsum("ga,gb,gc->abc", SHAPE, SHAPE_XI, SHAPE_ETA)
    return 0.5 * ((u - v) - np.swapaxes(u - v, 0, 1))


_COUPLING = _load_coupling()


#: Cells that are taken together, one in each lane of the processor's vectors: the arrays below have
#: the lanes last, and the innermost loops run over them. With fewer of them LLVM unrolls these
#: loops instead. Lanes that the last cells leave empty are computed too, and not used.
LANES = 16


@inlined
def _gather(x, cells, first, count, corners):
    """Positions of the nodes of `count` cells into corners (4, 3, lanes)."""
    for c in range(count):
        for a in range(4):
            node = cells[first + c, a]
            for i in range(3):
                corners[a, i, c] = x[node, i]


@inlined
def _gather_gradient(gradient, first, count, slopes):
    """Shape gradients of `count` cells into slopes (4 points, 4 nodes, 2, lanes)."""
    for c in range(count):
        for g in range(4):
            for a in range(4):
                for i in range(2):
                    slopes[g, a, i, c] = gradient[first + c, g, a, i]


@inlined
def _add_to_nodes(forces, cells, first, count, nodal):
    """Add forces (4, 3, lanes) of `count` cells to nodal (n, 3)."""
    for c in range(count):
        for a in range(4):
            for i in range(3):
                nodal[cells[first + c, a], i] += forces[a, i, c]


@inlined
def _deformation(corners, slopes, f):
    """Columns (F_i1), (F_i2) of the deformation gradient at a Gauss point, into f (6, lanes)."""
    for i in range(3):
        for c in range(LANES):
            f1, f2 = 0.0, 0.0
            for a in range(4):
                f1 += corners[a, i, c] * slopes[a, 0, c]
                f2 += corners[a, i, c] * slopes[a, 1, c]
            f[i, c], f[3 + i, c] = f1, f2


@inlined
def _strain(f, g, c):
    """Components C11, C22, C12 of FᵀF at Gauss point g in lane c."""
    f11, f21, f31 = f[g, 0, c], f[g, 1, c], f[g, 2, c]
    f12, f22, f32 = f[g, 3, c], f[g, 4, c], f[g, 5, c]
    return (
        f11 * f11 + f21 * f21 + f31 * f31,
        f12 * f12 + f22 * f22 + f32 * f32,
        f11 * f12 + f21 * f22 + f31 * f32,
    )


@inlined
def _add_load(corners, pressure, forces, volume):
    """Subtract the pressure's nodal forces; add the cells' parts of 3 V to volume (lanes,)."""
    for g in range(4):
        for c in range(LANES):
            u1, u2, u3, v1, v2, v3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for a in range(4):
                xi, eta = SHAPE_XI[g, a], SHAPE_ETA[g, a]
                u1 += xi * corners[a, 0, c]
                u2 += xi * corners[a, 1, c]
                u3 += xi * corners[a, 2, c]
                v1 += eta * corners[a, 0, c]
                v2 += eta * corners[a, 1, c]
                v3 += eta * corners[a, 2, c]
            # x,ξ × x,η
            n1, n2, n3 = u2 * v3 - u3 * v2, u3 * v1 - u1 * v3, u1 * v2 - u2 * v1
            for a in range(4):
                share = SHAPE[g, a]
                forces[a, 0, c] -= pressure * share * n1
                forces[a, 1, c] -= pressure * share * n2
                forces[a, 2, c] -= pressure * share * n3
                volume[c] += share * (
                    corners[a, 0, c] * n1 + corners[a, 1, c] * n2 + corners[a, 2, c] * n3
                )


@inlined
def _add_stress(f, slopes, stress, forces):
    """forces[a] += F S G_a, the work conjugate of the stress (3, lanes; already times t dA).

    With P = F S, a first Piola-Kirchhoff stress.
    """
    for i in range(3):
        for c in range(LANES):
            p1 = f[i, c] * stress[0, c] + f[3 + i, c] * stress[2, c]
            p2 = f[i, c] * stress[2, c] + f[3 + i, c] * stress[1, c]
            for a in range(4):
                forces[a, i, c] += p1 * slopes[a, 0, c] + p2 * slopes[a, 1, c]


@inlined
def _stress_change(f, df, at, change):
    """Change of the stress with that of F by df (6, lanes) at a Gauss point, into (3, lanes)."""
    for c in range(LANES):
        e11, e22, e12 = 0.0, 0.0, 0.0
        for i in range(3):
            e11 += f[i, c] * df[i, c]
            e22 += f[3 + i, c] * df[3 + i, c]
            e12 += f[i, c] * df[3 + i, c] + f[3 + i, c] * df[i, c]
        change[0, c] = at[4, c] * e11 + at[7, c] * e22 + at[8, c] * e12
        change[1, c] = at[7, c] * e11 + at[5, c] * e22 + at[9, c] * e12
        change[2, c] = at[8, c] * e11 + at[9, c] * e22 + at[6, c] * e12


@inlined
def _load_blocks(corners, pressure, blocks):
    """Vectors w (4, 4, 3, lanes): block ab of a cell's load stiffness is the product w ×."""
    for a in range(4):
        for b in range(4):
            for i in range(3):
                for c in range(LANES):
                    total = 0.0
                    for d in range(4):
                        total -= _COUPLING[a, b, d] * corners[d, i, c]
                    blocks[a, b, i, c] = pressure * total


@inlined
def _add_load_change(blocks, moves, forces):
    """Add the load stiffness times moves (4, 3, lanes) to forces."""
    for a in range(4):
        for b in range(4):
            if a == b:
                continue  # its load stiffness is zero
            for c in range(LANES):
                x, y, z = blocks[a, b, 0, c], blocks[a, b, 1, c], blocks[a, b, 2, c]
                forces[a, 0, c] += y * moves[b, 2, c] - z * moves[b, 1, c]
                forces[a, 1, c] += z * moves[b, 0, c] - x * moves[b, 2, c]
                forces[a, 2, c] += x * moves[b, 1, c] - y * moves[b, 0, c]


@inlined
def _strain_rows(f, slopes, at, g, c, strain, stress):
    """The strain operator B of Gauss point g in lane c, and CC B, as rows 3 g to 3 g + 2."""
    c11, c22, c33 = at[g, 4, c], at[g, 5, c], at[g, 6, c]
    c12, c13, c23 = at[g, 7, c], at[g, 8, c], at[g, 9, c]
    r = 3 * g
    for a in range(4):
        u, v = slopes[g, a, 0, c], slopes[g, a, 1, c]
        for i in range(3):
            k = 3 * a + i
            f1, f2 = f[g, i, c], f[g, 3 + i, c]
            b1, b2, b3 = f1 * u, f2 * v, f1 * v + f2 * u
            strain[r, k], strain[r + 1, k], strain[r + 2, k] = b1, b2, b3
            stress[r, k] = c11 * b1 + c12 * b2 + c13 * b3
            stress[r + 1, k] = c12 * b1 + c22 * b2 + c23 * b3
            stress[r + 2, k] = c13 * b1 + c23 * b2 + c33 * b3


@inlined
def _add_geometric(slopes, at, g, c, geometric):
    """geometric[a, b] += G_a·S·G_b at Gauss point g in lane c, lower triangle."""
    s11, s22, s12 = at[g, 1, c], at[g, 2, c], at[g, 3, c]
    for b in range(4):
        h1 = s11 * slopes[g, b, 0, c] + s12 * slopes[g, b, 1, c]
        h2 = s12 * slopes[g, b, 0, c] + s22 * slopes[g, b, 1, c]
        for a in range(b, 4):
            geometric[a, b] += slopes[g, a, 0, c] * h1 + slopes[g, a, 1, c] * h2


@compiled
def _stiffness(corners, lane, strain, stress, geometric, pressure, ke):
    """The matrix (12, 12) of a lane's cell, right in its lower triangle.

    Material part BᵀCC B over all Gauss points at once. Written out and up to a multiple of four
    columns, a row stays in vector registers: a quarter of the time of a plain triple loop.
    """
    for r in range(12):
        p0, p1, p2, p3 = stress[0, r], stress[1, r], stress[2, r], stress[3, r]
        p4, p5, p6, p7 = stress[4, r], stress[5, r], stress[6, r], stress[7, r]
        p8, p9, p10, p11 = stress[8, r], stress[9, r], stress[10, r], stress[11, r]
        for c in range(4 * (r // 4) + 4):
            ke[r, c] = (
                p0 * strain[0, c] + p1 * strain[1, c] + p2 * strain[2, c] + p3 * strain[3, c]
                + p4 * strain[4, c] + p5 * strain[5, c] + p6 * strain[6, c] + p7 * strain[7, c]
                + p8 * strain[8, c] + p9 * strain[9, c] + p10 * strain[10, c]
                + p11 * strain[11, c]
            )  # fmt: skip
    for a in range(4):
        for b in range(a + 1):
            for i in range(3):
                ke[3 * a + i, 3 * b + i] += geometric[a, b]
        for b in range(a):
            x, y, z = 0.0, 0.0, 0.0
            for c in range(4):
                share = -pressure * _COUPLING[a, b, c]
                x += share * corners[c, 0, lane]
                y += share * corners[c, 1, lane]
                z += share * corners[c, 2, lane]
            r, c = 3 * a, 3 * b
            ke[r, c + 1] -= z
            ke[r, c + 2] += y
            ke[r + 1, c] += z
            ke[r + 1, c + 2] -= x
            ke[r + 2, c] -= y
            ke[r + 2, c + 1] += x


@compiled
def assemble(
    x, cells, gradient, weight, q, law, relax, pressure, scatter, residual, data, fields, products
):
    """Potential, out-of-balance force and tangent, or its products, at positions x.

    For a few fields the products take less time than the tangent that they do without.

    Parameters
    ----------
    x : (n, 3) array, mm
    cells : (m, 4) int array
    gradient : (m, 4, 4, 2) array, 1/mm
    weight : (m, 4) array, mm³
        Thickness times reference area of each Gauss point.
    q : tuple of 12, MPa and 1
    law, relax : int, bool
    pressure : float, MPa
    scatter : (m, 78) int array
        Where the lower triangle of a cell's matrix (row by row) goes in `data`; the last entry
        of `data` takes what belongs to fixed displacements.
    residual : (n, 3) array, N
        Overwritten.
    data : (nnz + 1,) array, N/mm
        Overwritten; empty: no tangent.
    fields : (k, n, 3) array, mm
    products : (k, n, 3) array, N
        Overwritten with the tangent times the fields.

    Returns
    -------
    potential : float, N mm
        NaN where a cell has collapsed or its wrinkles did not converge.
    wrinkled : int
        Gauss points in tension-field relaxation.
    """
    with_tangent = len(data) > 0
    stiff = with_tangent or len(fields) > 0
    corners, slopes = np.zeros((4, 3, LANES)), np.zeros((4, 4, 2, LANES))
    forces, volume = np.empty((4, 3, LANES)), np.empty(LANES)
    # at every Gauss point: F, and W, S and CC times t dA
    f, at = np.zeros((4, 6, LANES)), np.zeros((4, 10, LANES))
    wanted = 10 if stiff else 4
    geometric, ke = np.empty((4, 4)), np.empty((12, 12))
    strain, stress = np.empty((12, 12)), np.empty((12, 12))
    # of one field: its values, F and stress, and the load stiffness
    moves, df, change = np.zeros((4, 3, LANES)), np.empty((6, LANES)), np.empty((3, LANES))
    blocks = np.empty((4, 4, 3, LANES))
    residual[:] = 0.0
    data[:] = 0.0
    products[:] = 0.0
    potential, wrinkled = 0.0, 0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        _gather_gradient(gradient, first, count, slopes)
        forces[:] = 0.0
        volume[:] = 0.0
        for g in range(4):
            _deformation(corners, slopes[g], f[g])
            for c in range(count):
                c11, c22, c12 = _strain(f, g, c)
                state, found = respond(c11, c22, c12, q, law, relax, stiff)
                if state < 0:
                    return np.nan, wrinkled
                wrinkled += state != 0
                for k in range(wanted):
                    at[g, k, c] = weight[first + c, g] * found[k]
                potential += at[g, 0, c]
            _add_stress(f[g], slopes[g], at[g, 1:4], forces)
        _add_load(corners, pressure, forces, volume)
        _add_to_nodes(forces, cells, first, count, residual)
        for c in range(count):
            potential -= pressure * volume[c] / 3.0
        if with_tangent:
            for c in range(count):
                geometric[:] = 0.0
                for g in range(4):
                    _strain_rows(f, slopes, at, g, c, strain, stress)
                    _add_geometric(slopes, at, g, c, geometric)
                _stiffness(corners, c, strain, stress, geometric, pressure, ke)
                position = 0
                for r in range(12):
                    for k in range(r + 1):
                        data[scatter[first + c, position]] += ke[r, k]
                        position += 1
        if len(fields) > 0:
            _load_blocks(corners, pressure, blocks)
        for k in range(len(fields)):
            _gather(fields[k], cells, first, count, moves)
            forces[:] = 0.0
            for g in range(4):
                _deformation(moves, slopes[g], df)
                _stress_change(f[g], df, at[g], change)
                _add_stress(f[g], slopes[g], change, forces)
                _add_stress(df, slopes[g], at[g, 1:4], forces)
            _add_load_change(blocks, moves, forces)
            _add_to_nodes(forces, cells, first, count, products[k])
    return potential, wrinkled


@compiled
def assemble_pressure(x, cells, out):
    """Force of a unit pressure at positions x: ∂V/∂x, into out (n, 3) mm²."""
    corners, forces = np.zeros((4, 3, LANES)), np.empty((4, 3, LANES))
    volume = np.zeros(LANES)
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        forces[:] = 0.0
        _add_load(corners, -1.0, forces, volume)
        _add_to_nodes(forces, cells, first, count, out)


@compiled
def assemble_sensitivity(x, cells, gradient, weight, q, law, relax, out):
    """∂R/∂D at fixed positions, for D11, D22, D12, D33.

    Parameters
    ----------
    out : (4, n, 3) array, N/MPa
        Overwritten.

    Returns
    -------
    ok : bool
    """
    corners, slopes = np.zeros((4, 3, LANES)), np.zeros((4, 4, 2, LANES))
    f, stress = np.zeros((4, 6, LANES)), np.zeros((4, 3, LANES))
    forces = np.empty((4, 4, 3, LANES))
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        _gather_gradient(gradient, first, count, slopes)
        forces[:] = 0.0
        for g in range(4):
            _deformation(corners, slopes[g], f[g])
            for c in range(count):
                c11, c22, c12 = _strain(f, g, c)
                state, found = stress_sensitivity(c11, c22, c12, q, law, relax)
                if state < 0:
                    return False
                for k in range(4):
                    for i in range(3):
                        stress[k, i, c] = weight[first + c, g] * found[k][i]
            for k in range(4):
                _add_stress(f[g], slopes[g], stress[k], forces[k])
        for k in range(4):
            _add_to_nodes(forces[k], cells, first, count, out[k])
    return True
