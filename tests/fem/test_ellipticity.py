"""Is a law's loss of ellipticity found where rank-one changes stop costing energy?"""

from __future__ import annotations

import math

import numpy as np
import pytest

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.ellipticity import ROUNDING, least_margin, point_margin
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.relaxation import TAUT, WRINKLED, point_response

STIFFNESS = orthotropic_stiffness(303.0, 229.0, 5.0, 0.24)
SOFT = orthotropic_stiffness(303.0, 229.0, 0.5, 0.24)


def parameters(stiffness: np.ndarray) -> tuple[float, ...]:
    return Fabric().law_parameters(stiffness)


@pytest.mark.parametrize("stiffness", [STIFFNESS, SOFT], ids=["stiff", "soft"])
@pytest.mark.parametrize("law", LAWS)
def test_margin_is_the_least_cost_of_rank_one_changes(law: str, stiffness: np.ndarray) -> None:
    """Against second differences of the plain energy over directions of both kinds."""
    q, h = parameters(stiffness), 1e-5
    turns = np.linspace(0.0, math.pi, 181)
    n = np.array([np.cos(turns), np.sin(turns)])
    changes = np.einsum("im,jn->mnij", n, n)
    steps = np.moveaxis(changes, (2, 3), (0, 1))
    for c in ((1.08, 1.05, 0.01), (1.3, 1.02, 0.0), (1.05, 1.2, -0.1)):
        f11 = math.sqrt(c[0])
        f = np.array([[f11, c[2] / f11], [0.0, math.sqrt(c[1] - c[2] ** 2 / c[0])]])

        def slope(size: float, f: np.ndarray = f) -> np.ndarray:
            g = f[:, :, None, None] + (size + 1e-30j) * steps
            found = np.array([(g[:, 0] ** 2).sum(0), (g[:, 1] ** 2).sum(0),
                              (g[:, 0] * g[:, 1]).sum(0)])  # fmt: skip
            return LAWS[law].energy(found, q).imag / 1e-30

        cost = (slope(h) - slope(-h)) / (2 * h)
        margin, _ = point_margin(*c, q, LAWS[law], False)
        # one degree off in both directions the cost is higher by (π/360)² of its curvature
        near = 4.0 * math.radians(0.5) ** 2 * np.abs(cost).max()
        assert margin - 1e-6 <= cost.min() <= margin + near


@pytest.mark.parametrize("shear", [10.0, 1.0])
def test_hencky_under_equal_stretches_is_elliptic_up_to_a_closed_form(shear: float) -> None:
    """Shear by 2 ε costs G ε²/2 - |T1 - T2| ε²/4 there: e = 2 G12/(D11 - D22)."""
    stiffness = orthotropic_stiffness(300.0, 225.0, shear, 0.24)
    limit = 2.0 * shear / (stiffness[0] - stiffness[1])
    q = parameters(stiffness)
    for e, elliptic in ((0.999 * limit, True), (1.001 * limit, False)):
        c = math.exp(2.0 * e)
        margin, angle = point_margin(c, c, 0.0, q, LAWS["hencky"], True)
        assert (margin > 0.0) is elliptic
        # it is lost to shear across the fill, which bears less than the warp
        assert abs(math.remainder(angle - 0.5 * math.pi, math.pi)) < 1e-3
        for other in ("svk", "yarn"):
            assert point_margin(c, c, 0.0, q, LAWS[other], True)[0] > 0.5 * shear * math.exp(-2 * e)


@pytest.mark.parametrize("law", ["svk", "yarn"])
def test_other_laws_stay_elliptic_at_softest_shear(law: str) -> None:
    q = parameters(orthotropic_stiffness(300.0, 225.0, 0.05, 0.24))
    rng = np.random.default_rng(0)
    taut, lost = 0, 0
    for e1, e2, shear in rng.uniform([-0.1, -0.1, -0.3], [0.3, 0.3, 0.3], (3000, 3)):
        a, b = math.exp(2 * e1), math.exp(2 * e2)
        c = a, b, math.sin(shear) * math.sqrt(a * b)
        taut += point_response(*c, q, LAWS[law], True, np.empty(10)) == TAUT
        assert point_margin(*c, q, LAWS[law], True)[0] >= -ROUNDING * (q[0] + q[1])
        lost += point_margin(*c, q, LAWS["hencky"], True)[0] < -0.01
    assert taut > 1000
    assert lost > 1000


def test_lowest_margin_of_a_shape_is_that_of_its_points() -> None:
    mesh = disc(100.0, 2)
    membrane = Membrane(mesh, 0.81, angle=0.3)
    r2 = (mesh.nodes**2).sum(axis=1) / 1e4
    shape = np.column_stack([0.05 * mesh.nodes * (1 - r2)[:, None], 30 * (1 - r2)])
    q = membrane.law_parameters(SOFT)
    x, gradient = membrane.reference + shape, membrane.surface.gradient
    f = np.einsum("mai,mgaj->mgij", x[mesh.cells], gradient)
    c = np.einsum("mgki,mgkj->mgij", f, f)
    law = LAWS["hencky"]
    margins = np.array(
        [[point_margin(p[0, 0], p[1, 1], p[0, 1], q, law, True)[0] for p in cell] for cell in c]
    )
    lowest, where = least_margin(x, mesh.cells, gradient, q, law, True, -math.inf)
    assert lowest == pytest.approx(margins.min(), rel=1e-9)
    assert lowest < 0.0
    assert where == np.unravel_index(margins.argmin(), margins.shape)[0]
    # that some are below a tenth of it the first of them tells
    first = int(np.argmax(margins.ravel() < 0.1 * lowest))
    some, there = least_margin(x, mesh.cells, gradient, q, law, True, 0.1 * lowest)
    assert some == pytest.approx(margins.ravel()[first], rel=1e-9)
    assert there == first // 4 != where
    stretched, stiff = 1.01 * membrane.reference, parameters(STIFFNESS)
    nothing = least_margin(stretched, mesh.cells, gradient, stiff, law, True, -math.inf)
    assert nothing == (math.inf, -1)


@pytest.mark.parametrize("amplitude", [1e-2, 1e-4, 1e-5])
@pytest.mark.parametrize("law", LAWS)
def test_a_slight_wrinkle_is_flat_and_no_loss(law: str, amplitude: float) -> None:
    """Its energy does not change along the wrinkle's direction, however little there is of it.

    Of wrinkles of 1e-4 rounding made margins of -1e-8, and paths ended there as not elliptic.
    """
    q = parameters(orthotropic_stiffness(3727.0, 65.2, 60.0, 0.1))
    stress, free = np.empty(10), 1.0
    c11 = 1.002
    low, high = 0.9, 1.1
    for _ in range(200):  # the stretch along fill at which its stress is zero
        free = 0.5 * (low + high)
        point_response(c11, free, 0.0, q, LAWS[law], False, stress)
        low, high = (low, free) if stress[2] > 0.0 else (free, high)
    for angle in (0.0, 0.01):
        c12 = angle * amplitude**2
        c = c11, free - amplitude**2, c12
        assert point_response(*c, q, LAWS[law], True, stress) == WRINKLED
        margin, _ = point_margin(*c, q, LAWS[law], True)
        assert abs(margin) < 1e-12 * (q[0] + q[1])
