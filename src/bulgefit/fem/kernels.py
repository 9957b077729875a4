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
from bulgefit.fem.laws import point_response, stress_sensitivity

__all__ = ["assemble", "assemble_pressure", "assemble_sensitivity"]


@compiled
def _deformation(corners, gradient, f):
    """Deformation gradient f (3, 2) and the components C11, C22, C12."""
    for i in range(3):
        f0, f1 = 0.0, 0.0
        for a in range(4):
            f0 += corners[a, i] * gradient[a, 0]
            f1 += corners[a, i] * gradient[a, 1]
        f[i, 0], f[i, 1] = f0, f1
    c11 = f[0, 0] * f[0, 0] + f[1, 0] * f[1, 0] + f[2, 0] * f[2, 0]
    c22 = f[0, 1] * f[0, 1] + f[1, 1] * f[1, 1] + f[2, 1] * f[2, 1]
    c12 = f[0, 0] * f[0, 1] + f[1, 0] * f[1, 1] + f[2, 0] * f[2, 1]
    return c11, c22, c12


@compiled
def _tangents(corners, g, tangents):
    """x,ξ and x,η at Gauss point g into tangents (2, 3); also their cross product (3)."""
    for i in range(3):
        u, v = 0.0, 0.0
        for a in range(4):
            u += SHAPE_XI[g, a] * corners[a, i]
            v += SHAPE_ETA[g, a] * corners[a, i]
        tangents[0, i], tangents[1, i] = u, v
    u, v = tangents[0], tangents[1]
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@compiled
def _add_forces(f, grad, s11, s22, s12, forces):
    """forces[a] += f S G_a, the work conjugate of the stress (already times t dA)."""
    for a in range(4):
        v1 = s11 * grad[a, 0] + s12 * grad[a, 1]
        v2 = s12 * grad[a, 0] + s22 * grad[a, 1]
        for i in range(3):
            forces[a, i] += f[i, 0] * v1 + f[i, 1] * v2


@compiled
def _add_material_tangent(f, grad, w, out, strain, ke):
    """The cell's material and geometric stiffness, (12, 12).

    With the strain operator B (3, 12) in `strain`, BᵀCC B row by row: full rows of twelve keep
    the inner loop in vector registers, which costs less than half rows do.
    """
    s11, s22, s12 = w * out[1], w * out[2], w * out[3]
    c11, c22, c33 = w * out[4], w * out[5], w * out[6]
    c12, c13, c23 = w * out[7], w * out[8], w * out[9]
    for a in range(4):
        u, v = grad[a, 0], grad[a, 1]
        for i in range(3):
            strain[0, 3 * a + i] = f[i, 0] * u
            strain[1, 3 * a + i] = f[i, 1] * v
            strain[2, 3 * a + i] = f[i, 0] * v + f[i, 1] * u
    for r in range(12):
        b1, b2, b3 = strain[0, r], strain[1, r], strain[2, r]
        p1 = c11 * b1 + c12 * b2 + c13 * b3
        p2 = c12 * b1 + c22 * b2 + c23 * b3
        p3 = c13 * b1 + c23 * b2 + c33 * b3
        for c in range(12):
            ke[r, c] += p1 * strain[0, c] + p2 * strain[1, c] + p3 * strain[2, c]
    for b in range(4):
        h1 = s11 * grad[b, 0] + s12 * grad[b, 1]
        h2 = s12 * grad[b, 0] + s22 * grad[b, 1]
        for a in range(b, 4):
            geometric = grad[a, 0] * h1 + grad[a, 1] * h2
            for j in range(3):
                ke[3 * a + j, 3 * b + j] += geometric


@compiled
def _add_load_tangent(tangents, g, pressure, ke):
    """Symmetric part of -p ∂²V/∂x_a∂x_b at Gauss point g, lower triangle."""
    for b in range(4):
        for a in range(b + 1, 4):
            along_u = SHAPE[g, a] * SHAPE_ETA[g, b] - SHAPE[g, b] * SHAPE_ETA[g, a]
            along_v = SHAPE[g, a] * SHAPE_XI[g, b] - SHAPE[g, b] * SHAPE_XI[g, a]
            x = -0.5 * pressure * (along_u * tangents[0, 0] - along_v * tangents[1, 0])
            y = -0.5 * pressure * (along_u * tangents[0, 1] - along_v * tangents[1, 1])
            z = -0.5 * pressure * (along_u * tangents[0, 2] - along_v * tangents[1, 2])
            r, c = 3 * a, 3 * b
            ke[r, c + 1] -= z
            ke[r, c + 2] += y
            ke[r + 1, c] += z
            ke[r + 1, c + 2] -= x
            ke[r + 2, c] -= y
            ke[r + 2, c + 1] += x


@compiled
def assemble(
    x, cells, gradient, weight, q, law, relax, pressure, scatter, residual, data, with_tangent
):
    """Potential, out-of-balance force and, on request, tangent at positions x.

    Parameters
    ----------
    x : (n, 3) array, mm
    cells : (m, 4) int array
    gradient : (m, 4, 4, 2) array, 1/mm
    weight : (m, 4) array, mm³
        Thickness times reference area of each Gauss point.
    q : (8,) array, MPa and 1
    law, relax : int, bool
    pressure : float, MPa
    scatter : (m, 78) int array
        Where the lower triangle of a cell's matrix (row by row) goes in `data`; the last entry
        of `data` takes what belongs to fixed displacements.
    residual : (n, 3) array, N
        Overwritten.
    data : (nnz + 1,) array, N/mm
        Overwritten if `with_tangent`.

    Returns
    -------
    potential : float, N mm
        NaN where a cell has collapsed or its wrinkles did not converge.
    wrinkled : int
        Gauss points in tension-field relaxation.
    """
    corners, f, tangents = np.empty((4, 3)), np.empty((3, 2)), np.empty((2, 3))
    out = np.empty(10)
    forces, ke, strain = np.empty((4, 3)), np.empty((12, 12)), np.empty((3, 12))
    residual[:] = 0.0
    if with_tangent:
        data[:] = 0.0
    energy, volume, wrinkled = 0.0, 0.0, 0
    for e in range(cells.shape[0]):
        for a in range(4):
            for i in range(3):
                corners[a, i] = x[cells[e, a], i]
        forces[:] = 0.0
        ke[:] = 0.0
        for g in range(4):
            grad, w = gradient[e, g], weight[e, g]
            c11, c22, c12 = _deformation(corners, grad, f)
            state = point_response(c11, c22, c12, q, law, relax, out)
            if state < 0:
                return np.nan, wrinkled
            wrinkled += state != 0
            energy += w * out[0]
            _add_forces(f, grad, w * out[1], w * out[2], w * out[3], forces)
            n1, n2, n3 = _tangents(corners, g, tangents)
            for a in range(4):
                share = SHAPE[g, a]
                forces[a, 0] -= pressure * share * n1
                forces[a, 1] -= pressure * share * n2
                forces[a, 2] -= pressure * share * n3
                along = corners[a, 0] * n1 + corners[a, 1] * n2 + corners[a, 2] * n3
                volume += share * along / 3.0
            if with_tangent:
                _add_material_tangent(f, grad, w, out, strain, ke)
                _add_load_tangent(tangents, g, pressure, ke)
        for a in range(4):
            for i in range(3):
                residual[cells[e, a], i] += forces[a, i]
        if with_tangent:
            position = 0
            for r in range(12):
                for c in range(r + 1):
                    data[scatter[e, position]] += ke[r, c]
                    position += 1
    return energy - pressure * volume, wrinkled


@compiled
def assemble_pressure(x, cells, out):
    """Force of a unit pressure at positions x: ∂V/∂x, into out (n, 3) mm²."""
    corners, tangents = np.empty((4, 3)), np.empty((2, 3))
    out[:] = 0.0
    for e in range(cells.shape[0]):
        for a in range(4):
            for i in range(3):
                corners[a, i] = x[cells[e, a], i]
        for g in range(4):
            n1, n2, n3 = _tangents(corners, g, tangents)
            for a in range(4):
                share = SHAPE[g, a]
                out[cells[e, a], 0] += share * n1
                out[cells[e, a], 1] += share * n2
                out[cells[e, a], 2] += share * n3


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
    corners, f = np.empty((4, 3)), np.empty((3, 2))
    work, unit, stresses = np.empty(10), np.empty(8), np.empty((4, 3))
    forces = np.empty((4, 4, 3))
    out[:] = 0.0
    for e in range(cells.shape[0]):
        for a in range(4):
            for i in range(3):
                corners[a, i] = x[cells[e, a], i]
        forces[:] = 0.0
        for g in range(4):
            grad, w = gradient[e, g], weight[e, g]
            c11, c22, c12 = _deformation(corners, grad, f)
            if stress_sensitivity(c11, c22, c12, q, law, relax, work, unit, stresses) < 0:
                return False
            for k in range(4):
                _add_forces(
                    f, grad,
                    w * stresses[k, 0], w * stresses[k, 1], w * stresses[k, 2], forces[k],
                )  # fmt: skip
        for k in range(4):
            for a in range(4):
                for i in range(3):
                    out[k, cells[e, a], i] += forces[k, a, i]
    return True
