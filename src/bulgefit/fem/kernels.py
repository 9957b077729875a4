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
from bulgefit.fem.lanes import LANES, respond_in_lanes, stiffness_in_lanes
from bulgefit.fem.relaxation import natural_state, respond, stress_sensitivity

__all__ = ["assemble", "assemble_pressure", "assemble_sensitivity"]


def _load_coupling():
    """∂²V/∂x_a∂x_b of a cell is the cross product with Σ_c coupling[a, b, c] x_c, (4, 4, 4).

    That is its symmetric part: half of what the two orders of a and b give.
    """
    u = np.einsum("ga,gb,gc->abc", SHAPE, SHAPE_ETA, SHAPE_XI)
    v = np.einsum("ga,gb,gc->abc", SHAPE, SHAPE_XI, SHAPE_ETA)
    return 0.5 * ((u - v) - np.swapaxes(u - v, 0, 1))


_COUPLING = _load_coupling()


def _entries():
    """Where the lower triangle of a cell's matrix, row by row, stands in its blocks (10, 3, 3).

    The blocks are those of the pairs of nodes a >= b: 00, 10, 11, 20 and so on.
    """
    row, column = np.tril_indices(12)
    a, b = row // 3, column // 3
    return 9 * (a * (a + 1) // 2 + b) + 3 * (row % 3) + column % 3


_ENTRY = _entries()


@inlined
def _gather(x, cells, first, count, corners):
    """Positions of the nodes of `count` cells into corners (4, 3, lanes)."""
    for c in range(count):
        for a in range(4):
            node = cells[first + c, a]
            for i in range(3):
                corners[a, i, c] = x[node, i]


@inlined
def _gather_reference(gradient, weight, first, count, slopes, heavy):
    """Shape gradients and weights of `count` cells: (4 points, 4 nodes, 2, lanes), (4, lanes)."""
    for c in range(count):
        for g in range(4):
            heavy[g, c] = weight[first + c, g]
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
def _strain(f, strain):
    """Components C11, C22, C12 of FᵀF at a Gauss point, into strain (3, lanes)."""
    for c in range(LANES):
        f11, f21, f31, f12, f22, f32 = f[0, c], f[1, c], f[2, c], f[3, c], f[4, c], f[5, c]
        strain[0, c] = f11 * f11 + f21 * f21 + f31 * f31
        strain[1, c] = f12 * f12 + f22 * f22 + f32 * f32
        strain[2, c] = f11 * f12 + f21 * f22 + f31 * f32


@inlined
def _find_load(corners, lift, volume):
    """Nodal forces of a unit pressure into lift; the cells' parts of 3 V into volume (lanes,)."""
    lift[:] = 0.0
    volume[:] = 0.0
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
                lift[a, 0, c] += share * n1
                lift[a, 1, c] += share * n2
                lift[a, 2, c] += share * n3
                volume[c] += share * (
                    corners[a, 0, c] * n1 + corners[a, 1, c] * n2 + corners[a, 2, c] * n3
                )


@inlined
def _take_load(pressure, lift, forces):
    """Subtract the pressure's nodal forces."""
    for a in range(4):
        for i in range(3):
            for c in range(LANES):
                forces[a, i, c] -= pressure * lift[a, i, c]


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
def _load_blocks(corners, pressure, load):
    """Vectors w (6, 3, lanes): block ab, a > b, of a cell's load stiffness is the product w ×.

    Block ba is its negative, and the blocks aa are zero.
    """
    pair = 0
    for a in range(1, 4):
        for b in range(a):
            w0, w1 = -pressure * _COUPLING[a, b, 0], -pressure * _COUPLING[a, b, 1]
            w2, w3 = -pressure * _COUPLING[a, b, 2], -pressure * _COUPLING[a, b, 3]
            for i in range(3):
                for c in range(LANES):
                    load[pair, i, c] = (
                        w0 * corners[0, i, c] + w1 * corners[1, i, c]
                        + w2 * corners[2, i, c] + w3 * corners[3, i, c]
                    )  # fmt: skip
            pair += 1


@inlined
def _add_load_change(load, moves, forces):
    """Add the load stiffness times moves (4, 3, lanes) to forces."""
    pair = 0
    for a in range(1, 4):
        for b in range(a):
            for c in range(LANES):
                x, y, z = load[pair, 0, c], load[pair, 1, c], load[pair, 2, c]
                forces[a, 0, c] += y * moves[b, 2, c] - z * moves[b, 1, c]
                forces[a, 1, c] += z * moves[b, 0, c] - x * moves[b, 2, c]
                forces[a, 2, c] += x * moves[b, 1, c] - y * moves[b, 0, c]
                forces[b, 0, c] -= y * moves[a, 2, c] - z * moves[a, 1, c]
                forces[b, 1, c] -= z * moves[a, 0, c] - x * moves[a, 2, c]
                forces[b, 2, c] -= x * moves[a, 1, c] - y * moves[a, 0, c]
            pair += 1


@inlined
def _moduli(f, at, moduli):
    """∂P/∂F of P = F S at a Gauss point, times t dA: moduli (4, 3, 3, lanes).

    For columns 11, 12, 21 and 22 of P and F, the parts [i, j] = ∂P_i/∂F_j.
    """
    for i in range(3):
        for j in range(3):
            same = 1.0 if i == j else 0.0
            for c in range(LANES):
                f1, f2 = f[i, c], f[3 + i, c]
                u, v = f[j, c], f[3 + j, c]
                sheared = at[9, c] * v + at[6, c] * u
                moduli[0, i, j, c] = (
                    f1 * (at[4, c] * u + at[8, c] * v)
                    + f2 * (at[8, c] * u + at[6, c] * v)
                    + same * at[1, c]
                )
                mixed = f1 * (at[7, c] * v + at[8, c] * u) + f2 * sheared + same * at[3, c]
                moduli[1, i, j, c] = mixed
                moduli[2, j, i, c] = mixed
                moduli[3, i, j, c] = (
                    f2 * (at[5, c] * v + at[9, c] * u) + f1 * sheared + same * at[2, c]
                )


@inlined
def _add_stiffness(moduli, slopes, blocks):
    """blocks[ab] += G_a · ∂P/∂F · G_b of a Gauss point, for the ten pairs of nodes a >= b.

    Written out, so that what the pairs share stays in registers.
    """
    for i in range(3):
        for j in range(3):
            for c in range(LANES):
                m11, m12 = moduli[0, i, j, c], moduli[1, i, j, c]
                m21, m22 = moduli[2, i, j, c], moduli[3, i, j, c]
                u0, v0 = slopes[0, 0, c], slopes[0, 1, c]
                u1, v1 = slopes[1, 0, c], slopes[1, 1, c]
                u2, v2 = slopes[2, 0, c], slopes[2, 1, c]
                u3, v3 = slopes[3, 0, c], slopes[3, 1, c]
                x, y = m11 * u0 + m12 * v0, m21 * u0 + m22 * v0
                blocks[0, i, j, c] += u0 * x + v0 * y
                blocks[1, i, j, c] += u1 * x + v1 * y
                blocks[3, i, j, c] += u2 * x + v2 * y
                blocks[6, i, j, c] += u3 * x + v3 * y
                x, y = m11 * u1 + m12 * v1, m21 * u1 + m22 * v1
                blocks[2, i, j, c] += u1 * x + v1 * y
                blocks[4, i, j, c] += u2 * x + v2 * y
                blocks[7, i, j, c] += u3 * x + v3 * y
                x, y = m11 * u2 + m12 * v2, m21 * u2 + m22 * v2
                blocks[5, i, j, c] += u2 * x + v2 * y
                blocks[8, i, j, c] += u3 * x + v3 * y
                x, y = m11 * u3 + m12 * v3, m21 * u3 + m22 * v3
                blocks[9, i, j, c] += u3 * x + v3 * y


@inlined
def _add_load_stiffness(load, blocks):
    """Add the products w × of `_load_blocks` to the blocks of the pairs of nodes a > b."""
    pair = 0
    for a in range(1, 4):
        for b in range(a):
            block = a * (a + 1) // 2 + b
            for c in range(LANES):
                x, y, z = load[pair, 0, c], load[pair, 1, c], load[pair, 2, c]
                blocks[block, 0, 1, c] -= z
                blocks[block, 0, 2, c] += y
                blocks[block, 1, 0, c] += z
                blocks[block, 1, 2, c] -= x
                blocks[block, 2, 0, c] -= y
                blocks[block, 2, 1, c] += x
            pair += 1


@inlined
def _add_to_tangent(blocks, scatter, first, count, data):
    """Add the lower triangles of `count` cells' matrices, row by row, to where they belong."""
    flat = blocks.reshape(90, LANES)
    for c in range(count):
        for k in range(78):
            data[scatter[first + c, k]] += flat[_ENTRY[k], c]


@compiled
def assemble(
    x,
    cells,
    gradient,
    weight,
    q,
    law,
    relax,
    pressure,
    scatter,
    residual,
    data,
    fields,
    rates,
    products,
):
    """Potential, out-of-balance force, its tangent and its changes at positions x.

    For a few fields the changes take less time than the tangent that they do without.

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
    fields : (k, n, 3) array
    rates : (k,) array
    products : (k, n, 3) array
        Overwritten with how the force changes along the fields, while the pressure changes at
        these rates: the tangent's product less rate times ∂V/∂x.

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
    lift = np.empty((4, 3, LANES))
    # at every Gauss point: F, and W, S and CC times t dA
    f, at = np.zeros((4, 6, LANES)), np.zeros((4, 10, LANES))
    strain, heavy, plain = np.empty((3, LANES)), np.zeros((4, LANES)), np.empty(LANES)
    natural = natural_state(q, law)
    moduli, stiffness = np.empty((4, 3, 3, LANES)), np.empty((10, 3, 3, LANES))
    # of one field: its values, F and stress, and the load stiffness
    moves, df, change = np.zeros((4, 3, LANES)), np.empty((6, LANES)), np.empty((3, LANES))
    load = np.empty((6, 3, LANES))
    residual[:] = 0.0
    data[:] = 0.0
    products[:] = 0.0
    potential, wrinkled = 0.0, 0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        _gather_reference(gradient, weight, first, count, slopes, heavy)
        forces[:] = 0.0
        for g in range(4):
            _deformation(corners, slopes[g], f[g])
            _strain(f[g], strain)
            respond_in_lanes(strain, heavy[g], q, law, relax, natural, at[g], plain)
            for c in range(count):
                if plain[c] == 0.0:
                    state, found = respond(strain[0, c], strain[1, c], strain[2, c], q, law, relax)
                    if state < 0:
                        return np.nan, wrinkled
                    wrinkled += state != 0
                    for k in range(10):
                        at[g, k, c] = heavy[g, c] * found[k]
                potential += at[g, 0, c]
            _add_stress(f[g], slopes[g], at[g, 1:4], forces)
        _find_load(corners, lift, volume)
        _take_load(pressure, lift, forces)
        _add_to_nodes(forces, cells, first, count, residual)
        for c in range(count):
            potential -= pressure * volume[c] / 3.0
        if stiff:
            _load_blocks(corners, pressure, load)
        if with_tangent:
            stiffness[:] = 0.0
            for g in range(4):
                _moduli(f[g], at[g], moduli)
                _add_stiffness(moduli, slopes[g], stiffness)
            _add_load_stiffness(load, stiffness)
            _add_to_tangent(stiffness, scatter, first, count, data)
        for k in range(len(fields)):
            _gather(fields[k], cells, first, count, moves)
            forces[:] = 0.0
            for g in range(4):
                _deformation(moves, slopes[g], df)
                _stress_change(f[g], df, at[g], change)
                _add_stress(f[g], slopes[g], change, forces)
                _add_stress(df, slopes[g], at[g, 1:4], forces)
            _add_load_change(load, moves, forces)
            _take_load(rates[k], lift, forces)
            _add_to_nodes(forces, cells, first, count, products[k])
    return potential, wrinkled


@compiled
def assemble_pressure(x, cells, out):
    """Force of a unit pressure at positions x: ∂V/∂x, into out (n, 3) mm²."""
    corners, lift = np.zeros((4, 3, LANES)), np.empty((4, 3, LANES))
    volume = np.empty(LANES)
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        _find_load(corners, lift, volume)
        _add_to_nodes(lift, cells, first, count, out)


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
    f, heavy = np.zeros((4, 6, LANES)), np.zeros((4, LANES))
    strain, stress, plain = np.empty((3, LANES)), np.empty((3, LANES)), np.empty(LANES)
    by_stiffness, natural = np.empty((4, 3, LANES)), natural_state(q, law)
    forces = np.empty((4, 4, 3, LANES))
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        _gather(x, cells, first, count, corners)
        _gather_reference(gradient, weight, first, count, slopes, heavy)
        forces[:] = 0.0
        for g in range(4):
            _deformation(corners, slopes[g], f[g])
            _strain(f[g], strain)
            stiffness_in_lanes(
                strain, heavy[g], q, law, relax, natural, by_stiffness, stress, plain
            )
            for c in range(count):
                if plain[c] == 0.0:
                    state, found = stress_sensitivity(
                        strain[0, c], strain[1, c], strain[2, c], q, law, relax
                    )
                    if state < 0:
                        return False
                    for k in range(4):
                        for i in range(3):
                            by_stiffness[k, i, c] = heavy[g, c] * found[k][i]
            for k in range(4):
                _add_stress(f[g], slopes[g], by_stiffness[k], forces[k])
        for k in range(4):
            _add_to_nodes(forces[k], cells, first, count, out[k])
    return True
