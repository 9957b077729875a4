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

from bulgefit.fem.cells import (
    add_load_change,
    add_load_stiffness,
    add_share,
    add_stiffness,
    add_stress,
    add_to_nodes,
    add_to_tangent,
    find_deformation,
    find_load,
    find_load_blocks,
    find_moduli,
    find_strain,
    find_stress,
    find_stress_change,
    gather,
    gather_reference,
    gather_share,
    gather_tilt,
    start_forces,
    work,
)
from bulgefit.fem.jit import compiled, merged
from bulgefit.fem.lanes import (
    LANES,
    find_plain,
    measure_in_lanes,
    respond_at_points,
    stiffness_in_lanes,
    stress_in_lanes,
)
from bulgefit.fem.relaxation import respond, stress_sensitivity

__all__ = [
    "assemble",
    "assemble_law_changes",
    "assemble_pressure",
    "assemble_reference_changes",
    "assemble_sensitivity",
    "assemble_weight_changes",
]


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
    share,
    scatter,
    times,
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
    q : tuple of floats
        As `laws.potential.PARAMETERS` names them.
    law, relax : Law, bool
    pressure : float, MPa
    share : (m,) array
        How much of each cell the pressure acts on, 1.
    scatter : (m, 78) int array
        Where the lower triangle of a cell's matrix (row by row) goes in `data`; the last entry
        of `data` takes what belongs to fixed displacements.
    times : (m, 78) array
        How often each of these entries counts; empty: once.
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
    # Lanes beyond the last cell are worked on too; what they hold is not read.
    corners, slopes = np.empty((4, 3, LANES)), np.empty((4, 4, 2, LANES))
    forces, lift, part = np.empty((4, 3, LANES)), np.empty((4, 3, LANES)), np.empty(LANES)
    # at every Gauss point: F, and W, S and CC times t dA; at one of them: P
    f, at = np.empty((4, 6, LANES)), np.empty((4, 10, LANES))
    strain, heavy, plain = np.empty((3, LANES)), np.empty((4, LANES)), np.empty(LANES)
    p, natural = np.empty((6, LANES)), law.natural(q)
    moduli, stiffness = np.empty((4, 3, 3, LANES)), np.empty((10, 3, 3, LANES))
    # of one field: its values and F, and the load stiffness
    moves, df, load = np.empty((4, 3, LANES)), np.empty((6, LANES)), np.empty((6, 3, LANES))
    residual[:] = 0.0
    data[:] = 0.0
    products[:] = 0.0
    potential, wrinkled = 0.0, 0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_reference(gradient, weight, first, count, slopes, heavy)
        gather_share(share, first, count, part)
        find_load(corners, part, lift)
        start_forces(pressure, lift, forces)
        potential -= pressure * work(lift, corners, count) / 3.0
        for g in range(4):
            find_deformation(corners, slopes[g], f[g])
            find_strain(f[g], strain)
            relaxed = respond_at_points(
                strain, heavy[g], count, q, law, relax, natural, at[g], plain
            )
            if relaxed < 0:
                return np.nan, wrinkled
            wrinkled += relaxed
            for c in range(count):
                potential += at[g, 0, c]
            find_stress(f[g], at[g, 1:4], p)
            add_stress(p, slopes[g], forces)
        add_to_nodes(forces, cells, first, count, residual)
        if stiff:
            find_load_blocks(corners, pressure, part, load)
        if with_tangent:
            stiffness[:] = 0.0
            for g in range(4):
                find_moduli(f[g], at[g], moduli)
                add_stiffness(moduli, slopes[g], stiffness)
            add_load_stiffness(load, stiffness)
            add_to_tangent(stiffness, scatter, times, first, count, data)
        for k in range(len(fields)):
            gather(fields[k], cells, first, count, moves)
            start_forces(rates[k], lift, forces)
            for g in range(4):
                find_deformation(moves, slopes[g], df)
                find_stress_change(f[g], df, at[g], p)
                add_stress(p, slopes[g], forces)
            add_load_change(load, moves, forces)
            add_to_nodes(forces, cells, first, count, products[k])
    return potential, wrinkled


@compiled
def assemble_reference_changes(
    x, cells, gradient, weight, q, law, relax, pressure, share, moves, tilts, gains, out
):
    """How the out-of-balance force changes with the reference surface, at fixed displacements.

    Positions move along with the surface, so that with G' and w' for the changes of gradient and
    weight, F' = Σ x'_a ⊗ G_a + x_a ⊗ G'_a and P = F S

        R'_a = Σ w (P' G_a + P G'_a + w'/w P G_a) - p ∂²V/∂x_a∂x_b x'_b.

    Parameters
    ----------
    x, cells, gradient, weight, q, law, relax, pressure, share
        As `assemble` takes them.
    moves : (k, n, 3) array, mm
        x'.
    tilts : (k, m, 4, 4, 2) array, 1/mm
        G'.
    gains : (k, m, 4) array
        w'/w.
    out : (k, n, 3) array, N
        Overwritten.

    Returns
    -------
    ok : bool
    """
    corners, slopes = np.empty((4, 3, LANES)), np.empty((4, 4, 2, LANES))
    lift, part = np.empty((4, 3, LANES)), np.empty(LANES)
    f, at = np.empty((4, 6, LANES)), np.empty((4, 10, LANES))
    strain, heavy, plain = np.empty((3, LANES)), np.empty((4, LANES)), np.empty(LANES)
    p, dp, natural = np.empty((4, 6, LANES)), np.empty((6, LANES)), law.natural(q)
    corner_moves, tilt, gain = np.empty((4, 3, LANES)), np.empty((4, 2, LANES)), np.empty(LANES)
    df, turned, load = np.empty((6, LANES)), np.empty((6, LANES)), np.empty((6, 3, LANES))
    forces = np.empty((4, 3, LANES))
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_reference(gradient, weight, first, count, slopes, heavy)
        gather_share(share, first, count, part)
        find_load(corners, part, lift)
        find_load_blocks(corners, pressure, part, load)
        for g in range(4):
            find_deformation(corners, slopes[g], f[g])
            find_strain(f[g], strain)
            relaxed = respond_at_points(
                strain, heavy[g], count, q, law, relax, natural, at[g], plain
            )
            if relaxed < 0:
                return False
            find_stress(f[g], at[g, 1:4], p[g])
        for k in range(len(out)):
            gather(moves[k], cells, first, count, corner_moves)
            start_forces(0.0, lift, forces)
            for g in range(4):
                gather_tilt(tilts[k], gains[k], first, count, g, tilt, gain)
                find_deformation(corner_moves, slopes[g], df)
                find_deformation(corners, tilt, turned)
                for i in range(6):
                    for c in range(LANES):
                        df[i, c] += turned[i, c]
                find_stress_change(f[g], df, at[g], dp)
                add_share(p[g], gain, dp)
                add_stress(dp, slopes[g], forces)
                add_stress(p[g], tilt, forces)
            add_load_change(load, corner_moves, forces)
            add_to_nodes(forces, cells, first, count, out[k])
    return True


@compiled
def assemble_weight_changes(x, cells, gradient, weight, q, law, relax, gains, out):
    """How the out-of-balance force changes with the weights of the Gauss points at fixed positions.

    Parameters
    ----------
    gains : (k, m, 4) array
        Changes of the weights over the weights.
    out : (k, n, 3) array, N
        Overwritten.

    Returns
    -------
    ok : bool
    """
    corners, slopes = np.empty((4, 3, LANES)), np.empty((4, 4, 2, LANES))
    f, at, p = np.empty((6, LANES)), np.empty((10, LANES)), np.empty((6, LANES))
    strain, heavy, plain = np.empty((3, LANES)), np.empty((4, LANES)), np.empty(LANES)
    of_point, forces = np.empty((4, 4, 3, LANES)), np.empty((4, 3, LANES))
    natural = law.natural(q)
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_reference(gradient, weight, first, count, slopes, heavy)
        of_point[:] = 0.0
        for g in range(4):
            find_deformation(corners, slopes[g], f)
            find_strain(f, strain)
            relaxed = respond_at_points(strain, heavy[g], count, q, law, relax, natural, at, plain)
            if relaxed < 0:
                return False
            find_stress(f, at[1:4], p)
            add_stress(p, slopes[g], of_point[g])
        for k in range(len(out)):
            forces[:] = 0.0
            for g in range(4):
                for c in range(count):
                    heavy[g, c] = gains[k, first + c, g]
                for a in range(4):
                    for i in range(3):
                        for c in range(LANES):
                            forces[a, i, c] += heavy[g, c] * of_point[g, a, i, c]
            add_to_nodes(forces, cells, first, count, out[k])
    return True


@compiled
def assemble_pressure(x, cells, share, out):
    """Force of a unit pressure at positions x: ∂V/∂x, into out (n, 3) mm²."""
    corners, lift, part = np.empty((4, 3, LANES)), np.empty((4, 3, LANES)), np.empty(LANES)
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_share(share, first, count, part)
        find_load(corners, part, lift)
        add_to_nodes(lift, cells, first, count, out)


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
    corners, slopes = np.empty((4, 3, LANES)), np.empty((4, 4, 2, LANES))
    f, heavy, p = np.empty((6, LANES)), np.empty((4, LANES)), np.empty((6, LANES))
    strain, stress, plain = np.empty((3, LANES)), np.empty((3, LANES)), np.empty(LANES)
    by_stiffness, natural = np.empty((4, 3, LANES)), law.natural(q)
    forces = np.empty((4, 4, 3, LANES))
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_reference(gradient, weight, first, count, slopes, heavy)
        forces[:] = 0.0
        for g in range(4):
            find_deformation(corners, slopes[g], f)
            find_strain(f, strain)
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
                find_stress(f, by_stiffness[k], p)
                add_stress(p, slopes[g], forces[k])
        for k in range(4):
            add_to_nodes(forces[k], cells, first, count, out[k])
    return True


@merged
def _tuple_of(q):
    """The law's parameters as the laws take them."""
    return (
        q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], q[8], q[9], q[10], q[11],
        q[12], q[13], q[14], q[15], q[16], q[17], q[18], q[19], q[20], q[21], q[22], q[23],
        q[24], q[25], q[26], q[27], q[28], q[29],
    )  # fmt: skip


@compiled
def assemble_law_changes(x, cells, gradient, weight, before, after, law, relax, out):
    """How the out-of-balance force changes with the law's parameters at fixed positions.

    Strains are found once for all changes.

    Parameters
    ----------
    before, after : (k, 30) array
        What the kernels call q.
    out : (k, n, 3) array, N
        Overwritten.

    Returns
    -------
    ok : bool
    """
    corners, slopes = np.empty((4, 3, LANES)), np.empty((4, 4, 2, LANES))
    f, heavy, p = np.empty((6, LANES)), np.empty((4, LANES)), np.empty((6, LANES))
    strain, plain = np.empty((3, LANES)), np.empty(LANES)
    measure, stress, change = np.empty((12, LANES)), np.empty((3, LANES)), np.empty((3, LANES))
    forces = np.empty((len(out), 4, 3, LANES))
    out[:] = 0.0
    for first in range(0, len(cells), LANES):
        count = min(LANES, len(cells) - first)
        gather(x, cells, first, count, corners)
        gather_reference(gradient, weight, first, count, slopes, heavy)
        forces[:] = 0.0
        for g in range(4):
            find_deformation(corners, slopes[g], f)
            find_strain(f, strain)
            measure_in_lanes(strain, law, measure)
            for k in range(len(out)):
                low, high = _tuple_of(before[k]), _tuple_of(after[k])
                stress_in_lanes(measure, heavy[g], low, stress)
                stress_in_lanes(measure, heavy[g], high, change)
                if not law.vectorised:
                    plain[:] = 0.0
                elif k == 0:  # the changes are slight: so all of them
                    find_plain(strain, stress, heavy[g], low, relax, law.natural(low), plain)
                for i in range(3):
                    for c in range(LANES):
                        change[i, c] -= stress[i, c]
                for c in range(count):
                    if plain[c] == 0.0:
                        c11, c22, c12 = strain[0, c], strain[1, c], strain[2, c]
                        state, old = respond(c11, c22, c12, low, law, relax)
                        other, new = respond(c11, c22, c12, high, law, relax)
                        if state < 0 or other < 0:
                            return False
                        for i in range(3):
                            change[i, c] = heavy[g, c] * (new[1 + i] - old[1 + i])
                find_stress(f, change, p)
                add_stress(p, slopes[g], forces[k])
        for k in range(len(out)):
            add_to_nodes(forces[k], cells, first, count, out[k])
    return True
