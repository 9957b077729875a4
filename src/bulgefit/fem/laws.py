"""The membrane's laws: stored energy, stress and tangent of one material point.

A law is a strain measure (`hencky`: e = ½ ln C; `svk`: e = ½ (C - I)) under a quadratic
potential in material axes,

    W(C) = ½ e : D : e              stored energy per reference volume, MPa
    S    = 2 ∂W/∂C                  second Piola-Kirchhoff stress, MPa
    CC   = 4 ∂²W/∂C∂C               material tangent, MPa

so the membrane's energy per reference area is t0 W and, under `hencky`, it thins as
t0/(λ1 λ2). Voigt order is 11, 22, 12, strains with engineering shear; the right Cauchy-Green
tensor C = FᵀF comes as its components C11, C22, C12.

The logarithm of a symmetric 2x2 tensor needs no eigenvectors: with m = tr C/2, h = (C11-C22)/2,
k = C12, s = h² + k² and g(m, s) = atanh(√s/m)/√s,

    ln C = ½ ln(m² - s) I + g (C - m I)                        (Sylvester's formula, n = 2)

and g has closed derivatives: ∂g/∂m = -1/det C, ∂g/∂s = (m/det C - g)/(2s). Near equal stretches
the latter cancel and a series in s/m² takes over.
"""

from __future__ import annotations

import math

from bulgefit.fem.jit import inner, merged

__all__ = [
    "LAWS",
    "by_stiffness",
    "log_strain",
    "pull_back",
    "response",
    "straight_potential",
    "stress_by_stiffness",
]

#: Laws by name; the number is what the kernels branch on.
LAWS = {"hencky": 0, "svk": 1}

_SERIES_BELOW = 0.01  # in z = s/m²; eight terms leave 1e-17


@merged
def _log_coefficient(m, s):
    """g(m, s) = atanh(√s/m)/√s and g_s."""
    z = s / (m * m)
    if z < _SERIES_BELOW:
        # g = φ(z)/m, φ = Σ zⁿ/(2n+1)
        phi, phi_1 = 0.0, 0.0
        for n in range(9, -1, -1):
            phi_1 = phi_1 * z + (n + 1) / (2.0 * n + 3.0)
            phi = phi * z + 1.0 / (2.0 * n + 1.0)
        return phi / m, phi_1 / m**3
    d = math.sqrt(s)
    g = 0.5 * math.log((m + d) / (m - d)) / d
    return g, (m / (m * m - s) - g) / (2.0 * s)


@merged
def _log_curvature(m, s, g_s):
    """g_ss of `_log_coefficient`."""
    det = m * m - s
    z = s / (m * m)
    if z < _SERIES_BELOW:
        phi_2 = 0.0
        for n in range(9, -1, -1):
            phi_2 = phi_2 * z + (n + 1) * (n + 2) / (2.0 * n + 5.0)
        return phi_2 / m**5
    return (m / (det * det) - 3.0 * g_s) / (2.0 * s)


@inner
def _strain(c11, c22, c12, law):
    """Strain (e11, e22, 2 e12) of C in the law's measure, and its derivatives.

    The derivatives ∂e_i/∂E_j, row by row, take a stress T that is conjugate to e to
    S_j = Σ T_i ∂e_i/∂E_j; E is Green's strain, its shear the engineering one.
    """
    if law == 1:
        return (
            0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12,
            1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0,
        )  # fmt: skip
    m, h, k = 0.5 * (c11 + c22), 0.5 * (c11 - c22), c12
    s = h * h + k * k
    g, g_s = _log_coefficient(m, s)
    return log_strain(m, h, k, 0.5 * math.log(m * m - s), g, g_s)


@merged
def log_strain(m, h, k, area, g, g_s):
    """`_strain` of the logarithmic law."""
    det = m * m - (h * h + k * k)
    g_m = -1.0 / det
    # derivatives of A, B, G as in `pull_back`, in m, h and k
    gh, gk = 2.0 * h * g_s, 2.0 * k * g_s
    a_m, a_h, a_k = m / det, -h / det, -k / det
    b_m, b_h, b_k = g_m * h, g + gh * h, gk * h
    c_m, c_h, c_k = g_m * k, gh * k, g + gk * k
    return (
        0.5 * (area + g * h), 0.5 * (area - g * h), g * k,
        0.5 * (a_m + a_h + b_m + b_h), 0.5 * (a_m - a_h + b_m - b_h), 0.5 * (a_k + b_k),
        0.5 * (a_m + a_h - b_m - b_h), 0.5 * (a_m - a_h - b_m + b_h), 0.5 * (a_k - b_k),
        c_m + c_h, c_m - c_h, c_k,
    )  # fmt: skip


@merged
def straight_potential(e1, e2, e3, q):
    """Potential, stress T = ∂ψ/∂e and stiffness H = ∂²ψ/∂e² of the strain (e11, e22, 2 e12).

    `_potential` without its bends.
    """
    e1, e2 = e1 - q[4], e2 - q[5]
    t1 = q[0] * e1 + q[2] * e2
    t2 = q[2] * e1 + q[1] * e2
    t3 = q[3] * e3
    psi = 0.5 * (t1 * e1 + t2 * e2 + t3 * e3)
    p1, p2 = max(e1, 0.0), max(e2, 0.0)
    psi += (q[6] * p1 * p1 * p1 + q[7] * p2 * p2 * p2) / 3.0
    t1 += q[6] * p1 * p1
    t2 += q[7] * p2 * p2
    return psi, t1, t2, t3, q[0] + 2.0 * q[6] * p1, q[1] + 2.0 * q[7] * p2, q[3], q[2]


@merged
def _potential(e1, e2, e3, q):
    """Potential, stress T = ∂ψ/∂e and stiffness H = ∂²ψ/∂e² of the strain (e11, e22, 2 e12).

    Elastic strain e - slack. Along warp and fill, in tension, the stress gains a E e² and, where
    a coating or crimp gives way, s E (e - κ atan(e/κ)): the slope goes from E to (1 + s) E, half
    of the way at the knee κ.

    `q` holds D11, D22, D12, D33 (MPa), slack along warp and fill (1), the gains a E and s E, each
    along warp and fill (MPa), and κ along warp and fill (1).
    """
    psi, t1, t2, t3, h1, h2, h3, h12 = straight_potential(e1, e2, e3, q)
    if q[8] != 0.0 or q[9] != 0.0:
        psi_1, bent_1, slope_1 = _knee(max(e1 - q[4], 0.0), q[10])
        psi_2, bent_2, slope_2 = _knee(max(e2 - q[5], 0.0), q[11])
        psi += q[8] * psi_1 + q[9] * psi_2
        t1, h1 = t1 + q[8] * bent_1, h1 + q[8] * slope_1
        t2, h2 = t2 + q[9] * bent_2, h2 + q[9] * slope_2
    return psi, t1, t2, t3, h1, h2, h3, h12


@inner
def _knee(e, knee):
    """Integral, e - κ atan(e/κ), and its slope e²/(e² + κ²)."""
    x = e / knee
    turned = math.atan(x)
    return (
        knee * knee * (0.5 * x * x - x * turned + 0.5 * math.log1p(x * x)),
        knee * (x - turned),
        x * x / (1.0 + x * x),
    )


@inner
def response(c11, c22, c12, q, law):
    """Unrelaxed W, S (3), CC (11, 22, 33, 12, 13, 23)."""
    if law == 1:
        psi, t1, t2, t3, h11, h22, h33, h12 = _potential(
            0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12, q
        )
        return psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0
    m, h, k = 0.5 * (c11 + c22), 0.5 * (c11 - c22), c12
    s = h * h + k * k
    det = m * m - s
    g, g_s = _log_coefficient(m, s)
    area = 0.5 * math.log(det)
    at = _potential(0.5 * (area + g * h), 0.5 * (area - g * h), g * k, q)
    return pull_back(m, h, k, g, g_s, _log_curvature(m, s, g_s), at)


@merged
def pull_back(m, h, k, g, g_s, g_ss, at):
    """`response` of the logarithmic law, with `_potential` at its strain."""
    psi, t1, t2, t3, h11, h22, h33, h12 = at
    s = h * h + k * k
    det = m * m - s
    g_m = -1.0 / det
    # In y = (m, h, k): e11 + e22 = ½ ln det =: A, e11 - e22 = g h =: B, 2 e12 = g k =: G.
    ta, tb = 0.5 * (t1 + t2), 0.5 * (t1 - t2)  # conjugate to A and B
    haa = 0.25 * (h11 + h22 + 2.0 * h12)
    hbb = 0.25 * (h11 + h22 - 2.0 * h12)
    hab = 0.25 * (h11 - h22)
    # first derivatives; ∂s = (0, 2h, 2k)
    a_m, a_h, a_k = m / det, -h / det, -k / det
    gh, gk = 2.0 * h * g_s, 2.0 * k * g_s
    b_m, b_h, b_k = g_m * h, g + gh * h, gk * h
    c_m, c_h, c_k = g_m * k, gh * k, g + gk * k
    w_m = ta * a_m + tb * b_m + t3 * c_m
    w_h = ta * a_h + tb * b_h + t3 * c_h
    w_k = ta * a_k + tb * b_k + t3 * c_k
    # second derivatives
    det2 = det * det
    g_mm, g_ms = 2.0 * m / det2, -1.0 / det2
    a_mm, a_hh, a_kk = -(m * m + s) / det2, -(det + 2 * h * h) / det2, -(det + 2 * k * k) / det2
    a_mh, a_mk, a_hk = 2 * m * h / det2, 2 * m * k / det2, -2 * h * k / det2
    g_mh, g_mk = 2.0 * h * g_ms, 2.0 * k * g_ms
    g_hh = 2.0 * g_s + 4.0 * h * h * g_ss
    g_kk = 2.0 * g_s + 4.0 * k * k * g_ss
    g_hk = 4.0 * h * k * g_ss
    b_mm, b_mh, b_mk = g_mm * h, g_m + g_mh * h, g_mk * h
    b_hh, b_kk, b_hk = 2.0 * gh + g_hh * h, g_kk * h, gk + g_hk * h
    c_mm, c_mh, c_mk = g_mm * k, g_mh * k, g_m + g_mk * k
    c_hh, c_kk, c_hk = g_hh * k, 2.0 * gk + g_kk * k, gh + g_hk * k

    pa_m = haa * a_m + hab * b_m
    pb_m = hab * a_m + hbb * b_m
    pa_h = haa * a_h + hab * b_h
    pb_h = hab * a_h + hbb * b_h
    pa_k = haa * a_k + hab * b_k
    pb_k = hab * a_k + hbb * b_k
    w_mm = a_m * pa_m + b_m * pb_m + h33 * c_m * c_m + ta * a_mm + tb * b_mm + t3 * c_mm
    w_hh = a_h * pa_h + b_h * pb_h + h33 * c_h * c_h + ta * a_hh + tb * b_hh + t3 * c_hh
    w_kk = a_k * pa_k + b_k * pb_k + h33 * c_k * c_k + ta * a_kk + tb * b_kk + t3 * c_kk
    w_mh = a_m * pa_h + b_m * pb_h + h33 * c_m * c_h + ta * a_mh + tb * b_mh + t3 * c_mh
    w_mk = a_m * pa_k + b_m * pb_k + h33 * c_m * c_k + ta * a_mk + tb * b_mk + t3 * c_mk
    w_hk = a_h * pa_k + b_h * pb_k + h33 * c_h * c_k + ta * a_hk + tb * b_hk + t3 * c_hk

    # dm = dE11 + dE22, dh = dE11 - dE22, dk = 2 dE12
    return (
        psi, w_m + w_h, w_m - w_h, w_k,
        w_mm + w_hh + 2.0 * w_mh, w_mm + w_hh - 2.0 * w_mh, w_kk,
        w_mm - w_hh, w_mk + w_hk, w_mk - w_hk,
    )  # fmt: skip


@inner
def stress_by_stiffness(c11, c22, c12, q, law):
    """∂(S11, S22, S12)/∂ each of D11, D22, D12, D33 of the unrelaxed law."""
    return by_stiffness(_strain(c11, c22, c12, law), q)


@merged
def by_stiffness(strain, q):
    """`stress_by_stiffness` at what `_strain` finds."""
    e1, e2, e3, p11, p12, p13, p21, p22, p23, p31, p32, p33 = strain
    e1, e2 = e1 - q[4], e2 - q[5]
    return (
        (e1 * p11, e1 * p12, e1 * p13),
        (e2 * p21, e2 * p22, e2 * p23),
        (e2 * p11 + e1 * p21, e2 * p12 + e1 * p22, e2 * p13 + e1 * p23),
        (e3 * p31, e3 * p32, e3 * p33),
    )
