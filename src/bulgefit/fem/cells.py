"""What the assembly does with the cells that lie in the lanes: gather, deform, press, scatter.

Arrays have the lanes last, one cell in each. F is kept by its columns, stress as 11, 22, 12, and a
cell's matrix by its blocks of nodes. What the formulas are is told in `kernels`.
"""

from __future__ import annotations

import numpy as np

from bulgefit.fem.geometry import SHAPE, SHAPE_ETA, SHAPE_XI
from bulgefit.fem.jit import inlined, merged
from bulgefit.fem.lanes import LANES

__all__ = [
    "add_load_change",
    "add_load_stiffness",
    "add_share",
    "add_stiffness",
    "add_stress",
    "add_to_nodes",
    "add_to_tangent",
    "find_deformation",
    "find_load",
    "find_load_blocks",
    "find_moduli",
    "find_strain",
    "find_stress",
    "find_stress_change",
    "gather",
    "gather_reference",
    "gather_share",
    "gather_tilt",
    "start_forces",
    "work",
]


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


@merged
def gather(x, cells, first, count, corners):
    """Positions of the nodes of `count` cells into corners (4, 3, lanes)."""
    for c in range(count):
        for a in range(4):
            node = cells[first + c, a]
            for i in range(3):
                corners[a, i, c] = x[node, i]


@merged
def gather_reference(gradient, weight, first, count, slopes, heavy):
    """Shape gradients and weights of `count` cells: (4 points, 4 nodes, 2, lanes), (4, lanes)."""
    for c in range(count):
        for g in range(4):
            heavy[g, c] = weight[first + c, g]
            for a in range(4):
                for i in range(2):
                    slopes[g, a, i, c] = gradient[first + c, g, a, i]


@merged
def add_to_nodes(forces, cells, first, count, nodal):
    """Add forces (4, 3, lanes) of `count` cells to nodal (n, 3)."""
    for c in range(count):
        for a in range(4):
            for i in range(3):
                nodal[cells[first + c, a], i] += forces[a, i, c]


@merged
def _column(corners, slopes, i, k, c):
    """F_ik = Σ x_ai G_ak in lane c."""
    return (
        corners[0, i, c] * slopes[0, k, c] + corners[1, i, c] * slopes[1, k, c]
        + corners[2, i, c] * slopes[2, k, c] + corners[3, i, c] * slopes[3, k, c]
    )  # fmt: skip


@inlined
def find_deformation(corners, slopes, f):
    """Columns (F_i1), (F_i2) of the deformation gradient at a Gauss point, into f (6, lanes)."""
    for i in range(3):
        for c in range(LANES):
            f[i, c] = _column(corners, slopes, i, 0, c)
            f[3 + i, c] = _column(corners, slopes, i, 1, c)


@merged
def _put_strain(f, strain, c):
    """`find_strain` of lane c."""
    f11, f21, f31, f12, f22, f32 = f[0, c], f[1, c], f[2, c], f[3, c], f[4, c], f[5, c]
    strain[0, c] = f11 * f11 + f21 * f21 + f31 * f31
    strain[1, c] = f12 * f12 + f22 * f22 + f32 * f32
    strain[2, c] = f11 * f12 + f21 * f22 + f31 * f32


@inlined
def find_strain(f, strain):
    """Components C11, C22, C12 of FᵀF at a Gauss point, into strain (3, lanes)."""
    for c in range(LANES):
        _put_strain(f, strain, c)


@merged
def gather_share(share, first, count, part):
    """How much of each of `count` cells counts, into part (lanes,)."""
    for c in range(count):
        part[c] = share[first + c]


@merged
def gather_tilt(tilts, gains, first, count, g, tilt, gain):
    """Changes at Gauss point g of `count` cells: slopes (4, 2, lanes), weight (lanes,)."""
    for c in range(count):
        gain[c] = gains[first + c, g]
        for a in range(4):
            for i in range(2):
                tilt[a, i, c] = tilts[first + c, g, a, i]


@inlined
def find_load(corners, part, lift):
    """Nodal forces of a unit pressure into lift: the cells' parts of ∫ N_a x,ξ × x,η dξdη.

    Their virtual work on the positions themselves is 3 V.
    """
    lift[:] = 0.0
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
                share = part[c] * SHAPE[g, a]
                lift[a, 0, c] += share * n1
                lift[a, 1, c] += share * n2
                lift[a, 2, c] += share * n3


@inlined
def start_forces(pressure, lift, forces):
    """Forces are those of the pressure alone."""
    for a in range(4):
        for i in range(3):
            for c in range(LANES):
                forces[a, i, c] = -pressure * lift[a, i, c]


@inlined
def work(forces, moves, count):
    """Σ forces · moves, both (4, 3, lanes), of `count` cells."""
    done = 0.0
    for a in range(4):
        for i in range(3):
            for c in range(count):
                done += forces[a, i, c] * moves[a, i, c]
    return done


@inlined
def find_stress(f, stress, p):
    """First Piola-Kirchhoff stress P = F S at a Gauss point, by its columns, into p (6, lanes).

    `stress` (3, lanes) is S times t dA.
    """
    for i in range(3):
        for c in range(LANES):
            f1, f2 = f[i, c], f[3 + i, c]
            p[i, c] = f1 * stress[0, c] + f2 * stress[2, c]
            p[3 + i, c] = f1 * stress[2, c] + f2 * stress[1, c]


@inlined
def find_stress_change(f, df, at, p):
    """Change of P with that of F by df (6, lanes) at a Gauss point, into p (6, lanes).

    `at` (10, lanes) are W, S and CC times t dA.
    """
    for c in range(LANES):
        e11, e22, e12 = 0.0, 0.0, 0.0
        for i in range(3):
            e11 += f[i, c] * df[i, c]
            e22 += f[3 + i, c] * df[3 + i, c]
            e12 += f[i, c] * df[3 + i, c] + f[3 + i, c] * df[i, c]
        s11 = at[4, c] * e11 + at[7, c] * e22 + at[8, c] * e12
        s22 = at[7, c] * e11 + at[5, c] * e22 + at[9, c] * e12
        s12 = at[8, c] * e11 + at[9, c] * e22 + at[6, c] * e12
        for i in range(3):
            f1, f2, u, v = f[i, c], f[3 + i, c], df[i, c], df[3 + i, c]
            p[i, c] = f1 * s11 + f2 * s12 + u * at[1, c] + v * at[3, c]
            p[3 + i, c] = f1 * s12 + f2 * s22 + u * at[3, c] + v * at[2, c]


@inlined
def add_share(p, gain, out):
    """out += gain P, both (6, lanes), of a Gauss point."""
    for i in range(6):
        for c in range(LANES):
            out[i, c] += gain[c] * p[i, c]


@inlined
def add_stress(p, slopes, forces):
    """forces[a] += P G_a of a Gauss point."""
    for i in range(3):
        for c in range(LANES):
            for a in range(4):
                forces[a, i, c] += p[i, c] * slopes[a, 0, c] + p[3 + i, c] * slopes[a, 1, c]


@inlined
def find_load_blocks(corners, pressure, part, load):
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
                    load[pair, i, c] = part[c] * (
                        w0 * corners[0, i, c] + w1 * corners[1, i, c]
                        + w2 * corners[2, i, c] + w3 * corners[3, i, c]
                    )  # fmt: skip
            pair += 1


@inlined
def add_load_change(load, moves, forces):
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
def find_moduli(f, at, moduli):
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
def add_stiffness(moduli, slopes, blocks):
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
def add_load_stiffness(load, blocks):
    """Add the products w × of `find_load_blocks` to the blocks of the pairs of nodes a > b."""
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
def add_to_tangent(blocks, scatter, times, first, count, data):
    """Add the lower triangles of `count` cells' matrices, row by row, to where they belong.

    Each entry counts so many `times`; empty: once.
    """
    flat = blocks.reshape(90, LANES)
    for c in range(count):
        if len(times) == 0:
            for k in range(78):
                data[scatter[first + c, k]] += flat[_ENTRY[k], c]
        else:
            for k in range(78):
                data[scatter[first + c, k]] += times[first + c, k] * flat[_ENTRY[k], c]
