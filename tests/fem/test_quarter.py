"""Does a quarter of a membrane tell what the whole does?"""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from bulgefit.errors import Cause, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.kernels import assemble, assemble_sensitivity
from bulgefit.fem.linear import NotPositiveDefiniteError
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import Mesh, disc
from bulgefit.fem.quarter import quarter_of, trace_by_quarter
from bulgefit.fem.trace import trace, traced
from bulgefit.fem.tracing.ends import BRACKET

STIFFNESS = orthotropic_stiffness(330.0, 240.0, 30.0, 0.24)
PRESSURES = np.array([0.001, 0.02, 0.1, 0.19, 0.3])
#: Refinements whose axes run along edges, and across cells.
EVEN, ODD = 2, 3
LAWED = Fabric(slack=(0.001, -0.002), gain=(300.0, 100.0), bend=(-80.0, 60.0), knee=(0.012, 0.02))


def turned(mesh: Mesh, angle: float) -> Mesh:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Mesh(mesh.nodes @ turn, mesh.cells)


@pytest.mark.parametrize("fabric", [Fabric(), LAWED])
@pytest.mark.parametrize("law", ["hencky", "svk"])
@pytest.mark.parametrize(
    "mesh",
    [disc(100.0, EVEN), disc(100.0, ODD), turned(disc(100.0, ODD), np.pi / 4)],
    ids=["axes along edges", "axes across edges", "axes along diagonals"],
)
def test_paths_and_their_derivatives_are_the_wholes(mesh: Mesh, law: str, fabric: Fabric) -> None:
    membrane = Membrane(mesh, 0.81, law, fabric=fabric)
    path = trace(membrane, STIFFNESS, sensitivities=True)
    found = trace_by_quarter(membrane, STIFFNESS, sensitivities=True)
    assert found.factorisations == path.factorisations + 3 * len(path.pressure)
    np.testing.assert_allclose(found(PRESSURES), path(PRESSURES), rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found.nodes, path.nodes)
    # where cloth is wrinkled slopes come by the factor of a shape 1e-5 mm away, with which
    # derivatives are off by a thousandth (`equilibrium.solve`)
    loose = path.wrinkled > 0
    for mine, theirs, share in (
        (found.sensitivity, path.sensitivity, 1e-5),
        (found.sensitivity_slope, path.sensitivity_slope, 2e-3),
    ):
        assert mine is not None
        assert theirs is not None
        apart = np.abs(mine - theirs) / np.abs(theirs).max()
        assert apart[~loose].max() < 1e-5
        assert apart[loose].max(initial=0.0) < share


@pytest.mark.parametrize("refine", [EVEN, ODD])
def test_each_kind_of_displacement_has_the_wholes_stiffness(refine: int) -> None:
    """The potential's second difference along a displacement is four times the quarter's."""
    membrane = Membrane(disc(100.0, refine), 0.81)
    quarter = quarter_of(membrane)
    assert quarter is not None
    shape = trace(quarter.even, STIFFNESS, (0.1, 0.1)).displacement[0]
    kinds = (quarter.even, *quarter.odd)
    assert sum(kind.linear.size for kind in kinds) == membrane.linear.size
    whole = quarter.whole(shape)
    energy = membrane.state(whole, 0.1, STIFFNESS, tangent=False).potential
    assert quarter.even.state(shape, 0.1, STIFFNESS).potential == pytest.approx(energy / 4, 1e-12)
    seen = []
    for kind, parity in zip(kinds, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True):
        unknowns = np.random.default_rng(0).normal(size=kind.linear.size)
        field = kind.spread(unknowns)
        # the whole's displacement, from the definition of its mirrors
        sign = quarter.sign * np.prod(
            np.where(membrane.mesh.nodes < -1e-6, np.array(parity, dtype=float), 1.0), axis=1
        )[:, None]  # fmt: skip
        displacement = sign * field[quarter.node]
        product = kind.tangent_product(shape, 0.1, STIFFNESS, field[None])[0]
        of_whole = membrane.tangent_product(whole, 0.1, STIFFNESS, displacement[None])[0]
        expected = membrane.gather(displacement) @ of_whole
        assert 4.0 * unknowns @ product == pytest.approx(expected, 1e-10)
        factor = kind.factorise(kind.state(shape, 0.1, STIFFNESS))
        np.testing.assert_allclose(factor.solve(product), unknowns, rtol=0, atol=1e-7)
        seen.append(membrane.gather(displacement))
    together = np.array(seen) @ np.array(seen).T
    np.testing.assert_allclose(together, np.diag(np.diag(together)), atol=1e-9)


def test_what_is_unstable_against_odd_displacements_is_told_as_by_the_whole() -> None:
    """Under soft shear the even shapes are a stable branch; the whole fabric may leave it."""
    soft = orthotropic_stiffness(330.0, 200.0, 5.0, 0.24)
    membrane = Membrane(disc(100.0, ODD), 0.81)
    quarter = quarter_of(membrane)
    assert quarter is not None
    even = trace(quarter.even, soft)
    assert even.stable.all()
    assert not quarter.stable(even, soft).all()
    found, whole = (of(membrane, soft, beyond_ellipticity=True) for of in (trace_by_quarter, trace))
    np.testing.assert_allclose(found(PRESSURES), whole(PRESSURES), rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found.stable, whole.stable)
    mirrored = quarter.whole(found.displacement[:, quarter.kept])
    np.testing.assert_array_equal(mirrored, found.displacement)  # it is of a quarter
    assert found.stable[0]
    assert not found.stable.all()
    errors = []
    for of in (trace_by_quarter, trace):
        with pytest.raises(SolveError) as caught:
            of(membrane, soft)
        errors.append(caught.value)
    assert errors[0].cause is errors[1].cause is Cause.LOSS_OF_ELLIPTICITY
    # each by a bisection to `BRACKET` in p^(1/3); the whole goes on from the quarter's levels
    assert errors[0].pressure == pytest.approx(errors[1].pressure, rel=3.0 * BRACKET)


@pytest.mark.parametrize(
    ("moduli", "cause", "alike"),
    [
        ((25.0, 25.0, 8.0), Cause.LIMIT_PRESSURE, True),
        ((60.0, 15.0, 20.0), Cause.LIMIT_PRESSURE, True),
        # an odd displacement leaves the whole's path 1 % before the even one would
        ((60.0, 15.0, 8.0), Cause.LOSS_OF_ELLIPTICITY, False),
    ],
)
def test_the_whole_is_traced_where_it_may_end_elsewhere(
    moduli: tuple[float, float, float], cause: Cause, alike: bool
) -> None:
    stiffness, membrane = orthotropic_stiffness(*moduli, 0.24), Membrane(disc(100.0, ODD), 0.81)
    quarter = quarter_of(membrane)
    assert quarter is not None
    found = traced(quarter.even, stiffness)
    assert found.error is not None
    assert found.path is not None
    kept = quarter.stable(found.path, stiffness)
    assert quarter.ends_alike(found, kept, stiffness) == alike
    with pytest.raises(SolveError) as whole:
        trace(membrane, stiffness)
    with pytest.raises(SolveError) as told:
        trace_by_quarter(membrane, stiffness)
    assert whole.value.cause is told.value.cause is cause
    assert (found.error.reached == pytest.approx(whole.value.reached, rel=1e-6)) == alike
    assert told.value.reached == pytest.approx(whole.value.reached, rel=3.0 * BRACKET)


@pytest.mark.parametrize("g12", [3.0, 6.0, 7.0])
def test_stability_is_the_wholes(g12: float) -> None:
    stiffness = orthotropic_stiffness(330.0, 200.0, g12, 0.24)
    membrane = Membrane(disc(100.0, ODD), 0.81)
    quarter = quarter_of(membrane)
    assert quarter is not None
    path = trace(quarter.even, stiffness)
    with nullcontext() if g12 == 7.0 else pytest.raises(NotPositiveDefiniteError):
        for pressure, shape in zip(path.pressure, quarter.whole(path.displacement), strict=True):
            membrane.factorise(membrane.state(shape, pressure, stiffness))
    assert quarter.stable(path, stiffness).all() == (g12 == 7.0)


def test_a_mesh_is_cut_once_for_all_membranes_that_share_its_solver() -> None:
    first = Membrane(disc(100.0, ODD), 0.81)
    other, alone = (Membrane(first.mesh, 0.5, "svk", fabric=LAWED, like=like)
                    for like in (first, None))  # fmt: skip
    known, cut, own = (quarter_of(membrane) for membrane in (first, other, alone))
    assert known is not None
    assert cut is not None
    assert own is not None
    for mine, theirs in zip((cut.even, *cut.odd), (known.even, *known.odd), strict=True):
        assert mine.linear is theirs.linear
        assert mine.linear is not own.even.linear
    paths = [trace_by_quarter(membrane, STIFFNESS) for membrane in (other, alone)]
    np.testing.assert_array_equal(paths[0].displacement, paths[1].displacement)
    uneven = Fabric(thickness=np.ones((len(first.mesh.cells), 4)))
    assert quarter_of(Membrane(first.mesh, fabric=uneven, like=first)) is None


def test_wrinkled_points_are_those_of_the_whole() -> None:
    """A tight warp and a slack fill wrinkle at light pressure."""
    fabric = Fabric(slack=(-0.02, 0.05))
    membrane = Membrane(disc(100.0, ODD), 0.81, fabric=fabric)
    light = (1e-4, 0.002)
    path = trace(membrane, STIFFNESS, light)
    found = trace_by_quarter(membrane, STIFFNESS, light)
    assert found.factorisations == path.factorisations + 3 * len(path.pressure)
    assert path.wrinkled.any()
    np.testing.assert_array_equal(found.wrinkled, path.wrinkled)


def test_the_same_compiled_kernels_serve_a_quarter_and_the_whole() -> None:
    membrane = Membrane(disc(100.0, ODD), 0.81)
    kernels = assemble, assemble_sensitivity
    trace(membrane, STIFFNESS, sensitivities=True)
    known = [list(kernel.signatures) for kernel in kernels]
    trace_by_quarter(membrane, STIFFNESS, sensitivities=True)
    assert [list(kernel.signatures) for kernel in kernels] == known


def moved(mesh: Mesh) -> Mesh:
    nodes = mesh.nodes.copy()
    nodes[mesh.apex + 1] += 1e-3
    return Mesh(nodes, mesh.cells)


def held(mesh: Mesh) -> np.ndarray:
    fixed = np.zeros((len(mesh.nodes), 3), dtype=bool)
    fixed[mesh.rim] = True
    fixed[mesh.rim[0], 0] = False
    return fixed


@pytest.mark.parametrize(
    "membrane",
    [
        Membrane(disc(100.0, 2), angle=0.1),
        Membrane(disc(100.0, 2), fabric=Fabric(compliance=0.01)),
        Membrane(disc(100.0, 2), fabric=Fabric(thickness=np.ones((228, 4)))),
        Membrane(turned(disc(100.0, 2), 0.1)),
        Membrane(moved(disc(100.0, 2))),
        Membrane(disc(100.0, 2), fixed=held(disc(100.0, 2))),
    ],
    ids=["turned warp", "slipping clamp", "uneven", "turned mesh", "moved node", "held unevenly"],
)
def test_what_need_not_mirror_has_no_quarter(membrane: Membrane) -> None:
    assert quarter_of(membrane) is None
    assert quarter_of(membrane) is None
