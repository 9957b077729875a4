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
from bulgefit.fem.jit import compiled
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


@compiled
def _gather(x, cells, e, corners):
    """Positions of cell e's nodes into corners (4, 3)."""
    for a in range(4):
        node = cells[e, a]
        for i in range(3):
            corners[a, i] = x[node, i]


@compiled
def _deformation(corners, gradient, e, g):
    """Columns (F_i1), (F_i2) of the deformation gradient at a Gauss point."""
    f11, f21, f31, f12, f22, f32 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(4):
        u, v = gradient[e, g, a, 0], gradient[e, g, a, 1]
        f11 += corners[a, 0] * u
        f21 += corners[a, 1] * u
        f31 += corners[a, 2] * u
        f12 += corners[a, 0] * v
        f22 += corners[a, 1] * v
        f32 += corners[a, 2] * v
    return f11, f21, f31, f12, f22, f32


@compiled
def _strain(f):
    """Components C11, C22, C12 of FᵀF."""
    return (
        f[0] * f[0] + f[1] * f[1] + f[2] * f[2],
        f[3] * f[3] + f[4] * f[4] + f[5] * f[5],
        f[0] * f[3] + f[1] * f[4] + f[2] * f[5],
    )


@compiled
def _normal(corners, g):
    """x,ξ × x,η at Gauss point g."""
    u1, u2, u3, v1, v2, v3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(4):
        xi, eta = SHAPE_XI[g, a], SHAPE_ETA[g, a]
        u1 += xi * corners[a, 0]
        u2 += xi * corners[a, 1]
        u3 += xi * corners[a, 2]
        v1 += eta * corners[a, 0]
        v2 += eta * corners[a, 1]
        v3 += eta * corners[a, 2]
    return u2 * v3 - u3 * v2, u3 * v1 - u1 * v3, u1 * v2 - u2 * v1


@compiled
def _add_load(corners, pressure, forces):
    """Subtract the pressure's nodal forces of a cell; returns its part of the volume V."""
    volume = 0.0
    for g in range(4):
        n1, n2, n3 = _normal(corners, g)
        for a in range(4):
            share = SHAPE[g, a]
            forces[a, 0] -= pressure * share * n1
            forces[a, 1] -= pressure * share * n2
            forces[a, 2] -= pressure * share * n3
            volume += share * (corners[a, 0] * n1 + corners[a, 1] * n2 + corners[a, 2] * n3)
    return volume / 3.0


@compiled
def _add_stress(f, gradient, e, g, s11, s22, s12, forces):
    """forces[a] += F S G_a, the work conjugate of the stress (already times t dA).

    With P = F S, a first Piola-Kirchhoff stress.
    """
    p11, p12 = f[0] * s11 + f[3] * s12, f[0] * s12 + f[3] * s22
    p21, p22 = f[1] * s11 + f[4] * s12, f[1] * s12 + f[4] * s22
    p31, p32 = f[2] * s11 + f[5] * s12, f[2] * s12 + f[5] * s22
    for a in range(4):
        u, v = gradient[e, g, a, 0], gradient[e, g, a, 1]
        forces[a, 0] += p11 * u + p12 * v
        forces[a, 1] += p21 * u + p22 * v
        forces[a, 2] += p31 * u + p32 * v


@compiled
def _strain_rows(f, gradient, e, g, w, at, strain, stress):
    """The strain operator B of Gauss point g, and w CC B, as rows 3 g to 3 g + 2."""
    c11, c22, c33 = w * at[4], w * at[5], w * at[6]
    c12, c13, c23 = w * at[7], w * at[8], w * at[9]
    r = 3 * g
    for a in range(4):
        u, v = gradient[e, g, a, 0], gradient[e, g, a, 1]
        for i in range(3):
            c = 3 * a + i
            b1, b2, b3 = f[i] * u, f[3 + i] * v, f[i] * v + f[3 + i] * u
            strain[r, c], strain[r + 1, c], strain[r + 2, c] = b1, b2, b3
            stress[r, c] = c11 * b1 + c12 * b2 + c13 * b3
            stress[r + 1, c] = c12 * b1 + c22 * b2 + c23 * b3
            stress[r + 2, c] = c13 * b1 + c23 * b2 + c33 * b3


@compiled
def _add_geometric(gradient, e, g, s11, s22, s12, geometric):
    """geometric[a, b] += G_a·S·G_b, lower triangle (stress already times t dA)."""
    for b in range(4):
        h1 = s11 * gradient[e, g, b, 0] + s12 * gradient[e, g, b, 1]
        h2 = s12 * gradient[e, g, b, 0] + s22 * gradient[e, g, b, 1]
        for a in range(b, 4):
            geometric[a, b] += gradient[e, g, a, 0] * h1 + gradient[e, g, a, 1] * h2


@compiled
def _stiffness(corners, strain, stress, geometric, pressure, ke):
    """The cell's matrix (12, 12), right in its lower triangle.

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
                x += share * corners[c, 0]
                y += share * corners[c, 1]
                z += share * corners[c, 2]
            r, c = 3 * a, 3 * b
            ke[r, c + 1] -= z
            ke[r, c + 2] += y
            ke[r + 1, c] += z
            ke[r + 1, c + 2] -= x
            ke[r + 2, c] -= y
            ke[r + 2, c + 1] += x


@compiled
def assemble(x, cells, gradient, weight, q, law, relax, pressure, scatter, residual, data):
    """Potential, out-of-balance force and tangent at positions x.

    Parameters
    ----------
    x : (n, 3) array, mm
    cells : (m, 4) int array
    gradient : (m, 4, 4, 2) array, 1/mm
    weight : (m, 4) array, mm³
        Thickness times reference area of each Gauss point.
    q : tuple of 11, MPa and 1
    law, relax : int, bool
    pressure : float, MPa
    scatter : (m, 78) int array
        Where the lower triangle of a cell's matrix (row by row) goes in `data`; the last entry
        of `data` takes what belongs to fixed displacements.
    residual : (n, 3) array, N
        Overwritten.
    data : (nnz + 1,) array, N/mm
        Overwritten; empty: no tangent.

    Returns
    -------
    potential : float, N mm
        NaN where a cell has collapsed or its wrinkles did not converge.
    wrinkled : int
        Gauss points in tension-field relaxation.
    """
    with_tangent = len(data) > 0
    corners, forces, geometric = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 4))
    strain, stress, ke = np.empty((12, 12)), np.empty((12, 12)), np.empty((12, 12))
    residual[:] = 0.0
    data[:] = 0.0
    energy, volume, wrinkled = 0.0, 0.0, 0
    for e in range(cells.shape[0]):
        _gather(x, cells, e, corners)
        forces[:] = 0.0
        geometric[:] = 0.0
        for g in range(4):
            f, w = _deformation(corners, gradient, e, g), weight[e, g]
            c11, c22, c12 = _strain(f)
            state, at = respond(c11, c22, c12, q, law, relax, with_tangent)
            if state < 0:
                return np.nan, wrinkled
            wrinkled += state != 0
            energy += w * at[0]
            s11, s22, s12 = w * at[1], w * at[2], w * at[3]
            _add_stress(f, gradient, e, g, s11, s22, s12, forces)
            if with_tangent:
                _strain_rows(f, gradient, e, g, w, at, strain, stress)
                _add_geometric(gradient, e, g, s11, s22, s12, geometric)
        volume += _add_load(corners, pressure, forces)
        for a in range(4):
            for i in range(3):
                residual[cells[e, a], i] += forces[a, i]
        if with_tangent:
            _stiffness(corners, strain, stress, geometric, pressure, ke)
            position = 0
            for r in range(12):
                for c in range(r + 1):
                    data[scatter[e, position]] += ke[r, c]
                    position += 1
    return energy - pressure * volume, wrinkled


@compiled
def assemble_pressure(x, cells, out):
    """Force of a unit pressure at positions x: ∂V/∂x, into out (n, 3) mm²."""
    corners, forces = np.empty((4, 3)), np.empty((4, 3))
    out[:] = 0.0
    for e in range(cells.shape[0]):
        _gather(x, cells, e, corners)
        forces[:] = 0.0
        _add_load(corners, -1.0, forces)
        for a in range(4):
            for i in range(3):
                out[cells[e, a], i] += forces[a, i]


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
    corners, forces = np.empty((4, 3)), np.empty((4, 4, 3))
    out[:] = 0.0
    for e in range(cells.shape[0]):
        _gather(x, cells, e, corners)
        forces[:] = 0.0
        for g in range(4):
            f, w = _deformation(corners, gradient, e, g), weight[e, g]
            c11, c22, c12 = _strain(f)
            state, by_stiffness = stress_sensitivity(c11, c22, c12, q, law, relax)
            if state < 0:
                return False
            for k in range(4):
                s11, s22, s12 = by_stiffness[k]
                _add_stress(f, gradient, e, g, w * s11, w * s22, w * s12, forces[k])
        for k in range(4):
            for a in range(4):
                for i in range(3):
                    out[k, cells[e, a], i] += forces[k, a, i]
    return True
