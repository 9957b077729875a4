"""Are the compiled laws those of their plain energies, and what is special about each?"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bulge_lab.fung import FUNG

from bulgefit.cli.main import main
from bulgefit.errors import InputError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import solve
from bulgefit.fem.laws import LAWS, registry
from bulgefit.fem.laws.law import Law
from bulgefit.fem.laws.potential import KNOTS, PARAMETERS, energy
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc, rectangle
from bulgefit.fem.relaxation import SLACK, point_response
from bulgefit.fem.trace import trace

STIFFNESS = orthotropic_stiffness(303.0, 229.0, 5.0, 0.24)
OWN = ("hencky", "svk", "yarn")
CURVE = np.array([[0.3, 0.1, -0.2, -0.5, -0.4, 0.1, -0.3], [-0.6, -0.4, 0.0, 0.2, 0.5, 0.7, 0.4]])
FABRICS = {
    "straight": Fabric(),
    "gains": Fabric(slack=(0.002, -0.001), gain=(500.0, 300.0)),
    "bends": Fabric(slack=(0.002, -0.001), gain=(50.0, 0.0), bend=(-100.0, 60.0)),
    "spent": Fabric(slack=(0.002, -0.001), gain=(-900.0, -2500.0), bend=(-100.0, 60.0)),
    "curve": Fabric(slack=(0.002, -0.001), curve=CURVE),
    "all": Fabric(slack=(0.002, -0.001), gain=(50.0, 9.0), bend=(90.0, 60.0), curve=CURVE),
    "coupled": Fabric(
        slack=(0.002, -0.001),
        gain=(50.0, 9.0),
        bend=(90.0, 60.0),
        curve=CURVE,
        coupling=(12.0, -9.0),
    ),
}
#: C11, C22, C12: near, sheared, long beyond every knot, and far from the natural state.
POINTS = [
    (1.08, 1.05, 0.01), (1.012, 1.003, -0.004), (1.05, 1.02, 0.2), (1.2, 1.15, -0.03),
    (1.9, 1.05, 0.02), (3.9, 3.5, 0.1), (0.96, 0.99, 0.05),
]  # fmt: skip


def responded(law: Law, c: tuple[float, ...], q: tuple[float, ...]) -> np.ndarray:
    out = np.empty(10)
    assert point_response(*c, q, law, False, out) == 0
    return out


def by_complex_step(law: Law, c: tuple[float, ...], q: tuple[float, ...]) -> np.ndarray:
    """W, S and CC from the plain energy: steps are of E11, E22 and 2 E12."""
    steps = np.diag([2.0, 2.0, 1.0])
    point = np.array(c, dtype=complex)

    def slope(at: np.ndarray, step: np.ndarray) -> float:
        return float(law.energy(at + 1e-30j * step, q).imag / 1e-30)

    stress = [slope(point, step) for step in steps]
    h = 1e-5
    matrix = [
        [(slope(point + h * b, a) - slope(point - h * b, a)) / (2 * h) for b in steps]
        for a in steps
    ]
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    energy = float(law.energy(point, q).real)
    return np.array([energy, *stress, *(matrix[i][j] for i, j in order)])


@pytest.mark.parametrize("c", POINTS)
@pytest.mark.parametrize("fabric", FABRICS)
@pytest.mark.parametrize("law", [*(LAWS[name] for name in OWN), FUNG], ids=lambda law: law.name)
def test_compiled_law_is_that_of_its_plain_energy(
    law: Law, fabric: str, c: tuple[float, ...]
) -> None:
    q = FABRICS[fabric].law_parameters(STIFFNESS)
    found, expected = responded(law, c, q), by_complex_step(law, c, q)
    np.testing.assert_allclose(found[:4], expected[:4], rtol=1e-12, atol=1e-13 * STIFFNESS[0])
    scale = np.abs(expected[4:]).max()
    np.testing.assert_allclose(found[4:], expected[4:], rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("fabric", FABRICS)
@pytest.mark.parametrize("name", OWN)
def test_points_in_lanes_respond_as_single_ones(name: str, fabric: str) -> None:
    """Force, tangent and what the law's parameters change, of a cell under a homogeneous strain."""
    mesh = rectangle((0.0, 1.0), (0.0, 1.0), 1, 1)
    free = np.zeros((4, 3), dtype=bool)
    membrane = Membrane(mesh, 1.0, name, fabric=FABRICS[fabric], fixed=free, relaxation=False)
    q = membrane.law_parameters(STIFFNESS)
    rng = np.random.default_rng(7)
    for c in POINTS:
        out = responded(LAWS[name], c, q)
        f11 = np.sqrt(c[0])
        f = np.array([[f11, c[2] / f11], [0.0, np.sqrt(c[1] - c[2] ** 2 / c[0])]])
        move = np.column_stack([mesh.nodes @ (f - np.eye(2)).T, np.zeros(4)])
        found = membrane.state(move, 0.0, STIFFNESS)
        assert found.potential == pytest.approx(out[0], rel=1e-11, abs=1e-13)
        stress = f @ np.array([[out[1], out[3]], [out[3], out[2]]])
        work = found.reaction[:, :2].T @ mesh.nodes
        np.testing.assert_allclose(work, stress, rtol=0, atol=1e-12 * STIFFNESS[0])
        df = rng.normal(size=(2, 2))
        field = np.column_stack([mesh.nodes @ df.T, np.zeros(4)])
        e = f.T @ df
        de = np.array([e[0, 0], e[1, 1], e[0, 1] + e[1, 0]])
        a, b, s, ab, as_, bs = out[4:]
        ds = np.array([[a, ab, as_], [ab, b, bs], [as_, bs, s]]) @ de
        change = df @ np.array([[out[1], out[3]], [out[3], out[2]]])
        change = change + f @ np.array([[ds[0], ds[2]], [ds[2], ds[1]]])
        product = membrane.spread(membrane.tangent_product(move, 0.0, STIFFNESS, field[None]))[0]
        np.testing.assert_allclose(
            product[:, :2].T @ mesh.nodes, change, rtol=0, atol=1e-11 * np.abs(change).max()
        )


@pytest.mark.parametrize(
    ("law", "fabric"),
    [*((name, fabric) for name in OWN for fabric in FABRICS), ("fung", "straight")],
)
def test_derivatives_by_stiffness_and_parameters_are_differences(
    law: str, fabric: str, fung: Path
) -> None:
    """At a shape with taut, wrinkled and slack points."""
    mesh = disc(100.0, 2)
    membrane = Membrane(mesh, 0.81, law, fabric=FABRICS[fabric])
    r2 = (mesh.nodes**2).sum(axis=1) / 1e4
    shape = np.column_stack([0.02 * mesh.nodes * (1 - r2)[:, None], 22 * (1 - r2)])
    shape[:, 0] -= 0.04 * mesh.nodes[:, 0] * (1 - r2)
    assert 0 < membrane.state(shape, 0.0, STIFFNESS).wrinkled < 4 * len(mesh.cells)
    found = membrane.stiffness_force(shape, STIFFNESS)
    # a wrinkle that is found to 1e-9 N less well at one end shows in the difference over that step
    for k, column in enumerate(np.diag(STIFFNESS)):
        errors = []
        for share in (3e-5, 1e-5, 3e-6):
            above, below = (
                membrane.state(shape, 0.0, STIFFNESS + sign * share * column).residual
                for sign in (1, -1)
            )
            expected = (above - below) / (2 * share * column[k])
            errors.append(np.abs(found[k] - expected).max() / np.abs(expected).max())
        assert min(errors) < 2e-6
    steps = 1e-5 * np.diag(STIFFNESS)
    change = membrane.law_changes(
        shape,
        np.array([membrane.law_parameters(STIFFNESS - steps[0])]),
        np.array([membrane.law_parameters(STIFFNESS + steps[0])]),
    )[0]
    above, below = (
        membrane.state(shape, 0.0, STIFFNESS + sign * steps[0]).residual for sign in (1, -1)
    )
    np.testing.assert_allclose(change, above - below, atol=1e-10 * np.abs(change).max() + 1e-11)


@pytest.mark.parametrize(("e1", "e2"), [(0.02, 0.05), (0.3, 0.001), (0.15, 0.15)])
@pytest.mark.parametrize("fabric", [name for name in FABRICS if name != "coupled"])
def test_yarn_is_hencky_under_tension_along_the_axes(e1: float, e2: float, fabric: str) -> None:
    q = FABRICS[fabric].law_parameters(STIFFNESS)
    c = (math.exp(2 * e1), math.exp(2 * e2), 0.0)
    yarn, hencky = (responded(LAWS[name], c, q) for name in ("yarn", "hencky"))
    np.testing.assert_allclose(yarn[:4], hencky[:4], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(yarn[[4, 5, 7]], hencky[[4, 5, 7]], rtol=1e-11)


def test_yarn_strain_is_that_of_lines_drawn_on_the_cloth() -> None:
    f = np.array([[1.1, 0.2], [-0.05, 0.95], [0.3, 0.1]])
    c = f.T @ f
    warp, fill = f.T
    angle = math.acos(warp @ fill / np.linalg.norm(warp) / np.linalg.norm(fill))
    expected = [math.log(np.linalg.norm(warp)), math.log(np.linalg.norm(fill)), math.pi / 2 - angle]
    found = LAWS["yarn"].strain(np.array([c[0, 0], c[1, 1], c[0, 1]]))
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_a_curve_of_zeros_is_the_straight_law() -> None:
    q = Fabric(slack=(0.002, -0.001)).law_parameters(STIFFNESS)
    assert Fabric(slack=(0.002, -0.001), curve=np.zeros((2, 7))).law_parameters(STIFFNESS) == q
    assert len(q) == len(PARAMETERS)


def test_uniaxial_tension_follows_the_curve() -> None:
    """Slope over E is the given one at the knots, linear between; beside a straight fill."""
    curve = CURVE * [[1.0], [0.0]]
    q = Fabric(curve=curve).law_parameters(STIFFNESS)
    nu12 = STIFFNESS[2] / STIFFNESS[1]
    e = np.linspace(0.0, 0.1, 29)
    stretch = np.exp(2 * e), np.exp(-2 * nu12 * e)
    out = [responded(LAWS["hencky"], (a, b, 0.0), q) for a, b in zip(*stretch, strict=True)]
    assert np.abs([found[2] for found in out]).max() < 1e-12
    tension = np.array([found[1] for found in out]) * stretch[0]
    fine = np.linspace(0.0, 0.1, 100001)
    slope = 303.0 * np.interp(fine, KNOTS, np.exp(curve[0]))
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1])) * (fine[1] - fine[0])])
    np.testing.assert_allclose(tension, np.interp(e, fine, whole), atol=1e-7)
    assert (np.diff(tension) > 0).all()


@pytest.mark.parametrize("gain", [(-400.0, 900.0), (-1300.0, 0.0)])
def test_a_curve_multiplies_the_slopes_of_gains_and_bends(gain: tuple[float, float]) -> None:
    """At the knots: what softens by a law with a name is not taken back by an offset of slopes."""
    named = Fabric(gain=gain, bend=(-60.0, 30.0), knee=(0.02, 0.01))
    q, with_curve = (
        fabric.law_parameters(STIFFNESS) for fabric in (named, replace(named, curve=CURVE))
    )
    lateral = STIFFNESS[2] ** 2 / STIFFNESS[1::-1]  # of the stiffness, beyond the modulus

    def slope(axis: int, strain: float, q: tuple[float, ...]) -> float:
        at, step = np.zeros((3, 2), dtype=complex), 1e-6
        at[axis] = strain + 1e-20j + np.array([-step, step])
        return float(np.diff(energy(at, q).imag)[0] / 1e-20 / (2.0 * step))

    for axis, logs in enumerate(CURVE):
        for knot, log in zip(KNOTS[1:], logs[1:], strict=True):
            before, after = (slope(axis, knot, one) - lateral[axis] for one in (q, with_curve))
            assert before > 0.0
            # what it takes off at the last one it takes off beyond, of what is left at last
            last = knot == KNOTS[-1] and log < 0.0
            of = min(before, slope(axis, 0.3, q) - lateral[axis]) if last else before
            assert after == pytest.approx(before + of * math.expm1(log), rel=1e-3)


@pytest.mark.parametrize(
    ("curve", "said"),
    [
        (np.zeros((2, 6)), "curve: expected 2 x 7 finite logarithms"),
        (np.full((2, 7), np.nan), "curve: expected 2 x 7 finite logarithms"),
        (np.full((2, 7), -2.0), "leave no positive strain energy"),
    ],
)
def test_curves_that_are_none(curve: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Fabric(curve=curve).law_parameters(STIFFNESS)


def test_a_bend_that_goes_on_beyond_a_curve_leaves_a_rising_stress() -> None:
    """What a curve takes off at its last knot, it takes off beyond, where the bend goes on."""
    e1 = STIFFNESS[0] - STIFFNESS[2] ** 2 / STIFFNESS[1]
    soft = np.array([[0.0, *[-1.0] * 6], [0.0] * 7])
    for given in ({"bend": (-0.9 * e1, 0.0), "knee": (0.05, 0.01)}, {"gain": (-4.0 * e1, 0.0)}):
        q = Fabric(curve=soft, **given).law_parameters(STIFFNESS)
        strain = np.linspace(0.08, 0.3, 12)  # where coated fabrics are torn
        stress = [energy(np.array([e + 1e-20j, 0.0, 0.0]), q).imag / 1e-20 for e in strain]
        assert np.diff(stress).min() > 0.0


def test_softest_curves_that_are_admitted_have_a_positive_energy() -> None:
    """The bound is that of the stiffness: slopes on it leave a semidefinite one."""
    ratio = STIFFNESS[2] / math.sqrt(STIFFNESS[0] * STIFFNESS[1])  # √(ν12 ν21)
    least = math.log(ratio / (1.0 + ratio))
    for more, positive in ((1e-6, True), (-1e-6, False)):
        curve = np.full((2, 7), least + more)
        if not positive:
            with pytest.raises(InputError):
                Fabric(curve=curve).law_parameters(STIFFNESS)
            continue
        q = Fabric(curve=curve).law_parameters(STIFFNESS)
        out = responded(LAWS["svk"], (1.02, 1.03, 0.0), q)
        low = np.linalg.eigvalsh([[out[4], out[7]], [out[7], out[5]]])[0]
        assert 0.0 < low < 1e-3


@pytest.mark.parametrize("by", ["gain", "bend"])
def test_what_softens_both_ways_keeps_a_positive_energy(by: str) -> None:
    """Admitted up to where the stiffness is semidefinite, as a curve is; one way alone, always."""
    moduli = np.array([303.0, 229.0])
    ratio = STIFFNESS[2] / math.sqrt(STIFFNESS[0] * STIFFNESS[1])  # √(ν12 ν21)
    least, strain = ratio / (1.0 + ratio), KNOTS[-1]
    for more, positive in ((1e-5, True), (-1e-5, False)):
        falls = (least + more - 1.0) * moduli
        # the slope there is 2 gain e less, or all but all of the bend
        given = 0.5 * falls / strain if by == "gain" else falls * (1.0 + (1e-6 / strain) ** 2)
        fabric = Fabric(**{by: tuple(given)}, knee=(1e-6, 1e-6))
        for alone in ((given[0], 0.0), (0.0, given[1])):
            replace(fabric, **{by: alone}).law_parameters(STIFFNESS)
        if not positive:
            with pytest.raises(InputError, match="leave no positive strain energy"):
                fabric.law_parameters(STIFFNESS)
            continue
        q = fabric.law_parameters(STIFFNESS)
        step = 1e-6 * np.eye(3)[:2]
        at = np.array([strain, strain, 0.0])

        def stress(where: np.ndarray, axis: int, q: tuple[float, ...] = q) -> float:
            return energy(where + 1e-20j * np.eye(3)[axis], q).imag / 1e-20

        slopes = [
            [(stress(at + h, axis) - stress(at - h, axis)) / 2e-6 for axis in (0, 1)] for h in step
        ]
        assert 0.0 < np.linalg.eigvalsh(slopes)[0] < 0.02


PACKAGE = """[bulgefit.laws]
fung = bulge_lab.fung:FUNG
"""


@pytest.fixture
def fung(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A package with the law `fung` is installed."""
    information = tmp_path / "fung-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: fung\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(PACKAGE)
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._others.cache_clear()
    yield information
    registry._others.cache_clear()


def test_couplings_are_weighed_beside_what_softening_leaves() -> None:
    """Each alone leaves a positive strain energy, both together do not."""
    stiffness = orthotropic_stiffness(303.0, 229.0, 30.0, 0.24)
    soft = {"bend": (-0.5 * 303.0, -0.5 * 229.0), "knee": (0.005, 0.005)}
    coupled = {"coupling": (0.8 * np.sqrt(303.0 * 30.0), 0.0)}
    Fabric(**soft).law_parameters(stiffness)
    Fabric(**coupled).law_parameters(stiffness)
    with pytest.raises(InputError, match=r"coupling: .* leave no positive strain energy"):
        Fabric(**soft, **coupled).law_parameters(stiffness)


def test_stiffness_that_falls_to_nothing_somewhere_is_refused() -> None:
    mesh = disc(100.0, 1)
    share = np.ones((len(mesh.cells), 4))
    share[3, 2] = 0.0
    with pytest.raises(InputError, match="stiffness falls to 0 of its mean"):
        Membrane(mesh, fabric=Fabric(thickness=share))


def test_law_of_another_package_blows_a_membrane(fung: Path) -> None:
    """Its differences by the stiffness give the path's derivatives."""
    assert [*LAWS] == [*OWN, "fung"]
    assert len(LAWS) == 4
    membrane = Membrane(disc(100.0, 3), 0.81, "fung")
    path = trace(membrane, STIFFNESS, sensitivities=True)
    assert path.stable.all()
    assert path.error_estimate < 1e-3
    h = 1e-3 * STIFFNESS[0]
    change = h * np.eye(4)[0]
    above, below = (
        solve(membrane, path.displacement[-1], 0.3, STIFFNESS + sign * change).displacement
        for sign in (1, -1)
    )
    assert path.sensitivity is not None
    expected = (above - below) / (2 * h)
    np.testing.assert_allclose(
        path.sensitivity[-1, 0], expected, rtol=0, atol=1e-5 * np.abs(expected).max()
    )


def test_command_line_sees_the_law_of_another_package(
    fung: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = ["simulate", "--E", "250", "--nu", "0.24", "--pressure", "1", "--refine", "2"]
    assert main([*run, "--law", "fung", "--json", "-"]) == 0
    stiff = capsys.readouterr().out
    assert main([*run, "--law", "svk", "--json", "-"]) == 0
    assert capsys.readouterr().out != stiff
    assert main([*run, "--law", "fang"]) == 2
    assert "choose from hencky, svk, yarn, fung" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("bad = no_such_module:LAW", "law 'bad' .* cannot be loaded: ModuleNotFoundError"),
        ("bad = math:pi", "expected a bulgefit.fem.laws.law.Law, got 3.14"),
        ("svk = bulge_lab.fung:FUNG", "bulgefit has a law of that name"),
    ],
)
def test_entry_points_that_lead_to_no_law(fung: Path, line: str, said: str) -> None:
    (fung / "entry_points.txt").write_text(f"[bulgefit.laws]\n{line}\n")
    registry._others.cache_clear()
    with pytest.raises(InputError, match=said):
        Membrane(disc(100.0, 1), law="bad")


def test_a_law_whose_source_changes_is_compiled_anew(tmp_path: Path) -> None:
    """What kernels know it by is kept on the disc beside what was compiled."""
    source = Path(FUNG.response.__code__.co_filename).read_text()
    types = []
    for k, text in enumerate((source, source, source.replace("40.0", "41.0"))):
        file = tmp_path / f"{k}.py"
        file.write_text(text)
        space: dict[str, object] = {"__name__": "other"}
        exec(compile(text, str(file), "exec"), space)
        law = space["FUNG"]
        assert isinstance(law, Law)
        types.append(law.type)
    assert types[0] == types[1]
    assert types[0] != types[2]


@pytest.mark.parametrize("fabric", FABRICS)
@pytest.mark.parametrize("name", OWN)
def test_what_lies_within_the_natural_state_is_slack(name: str, fabric: str) -> None:
    """Slack and all: a strain of s is there without tension, by each law's own measure of it."""
    given = FABRICS[fabric]
    natural = [1.0 + 2.0 * s if name == "svk" else math.exp(2.0 * s) for s in given.slack]
    q, out = given.law_parameters(STIFFNESS), np.empty(10)
    for within in (1e-5, -1e-5):
        c11, c22 = np.array(natural) - within
        state = point_response(c11, c22, 0.0, q, LAWS[name], True, out)
        assert (state == SLACK) == (within > 0.0)
