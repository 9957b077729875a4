"""Does `bulgefit simulate` give the right numbers and files, and refuse in one line?"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, read_test
from bulgefit.errors import BulgefitError, InputError, SolveError
from bulgefit.fem.linear import NotPositiveDefiniteError
from bulgefit.fem.mesh import disc
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup
from bulgefit.model.simulation import simulate

MESH = Path(__file__).parents[3] / "shared" / "data" / "abaqus" / "mesh.npz"
MATERIAL = ["--E1", "303", "--E2", "229", "--G12", "5", "--nu12", "0.24"]
CONSTANTS = {"E1": 303.0, "E2": 229.0, "G12": 5.0, "nu12": 0.24}

needs_mesh = pytest.mark.skipif(
    not MESH.is_file(), reason="the study's mesh (../shared/data/abaqus/mesh.npz) is not here"
)


def run(*words):
    return main(["simulate", *(str(word) for word in words)])


@needs_mesh
@pytest.mark.parametrize(
    ("law", "apex"),
    [
        ("hencky", [20.49514, 26.44803, 34.75211, 41.40784]),
        ("svk", [19.89363, 25.17823, 31.95835, 36.81727]),
    ],
)
def test_apex_on_the_studys_mesh(law, apex):
    done = subprocess.run(
        [sys.executable, "-m", "bulgefit", "simulate", *MATERIAL, "--law", law, "--mesh", MESH,
         "--pressure", "0.5,1,2,3", "--json", "-"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    result = json.loads(done.stdout)
    assert result["pressure_bar"] == [0.5, 1.0, 2.0, 3.0]
    assert result["apex_mm"] == pytest.approx(apex, abs=6e-6)
    assert 0 < result["factorisations"] <= 60
    assert result["seconds"] > 0
    assert result["stable"] is True
    assert result["wrinkled_points"] == [0, 0, 0, 0]
    assert result["law"] == law
    assert result["parameters"]["G12"] == {"value": 5.0, "unit": "MPa"}
    assert result["mesh"]["nodes"] == 937
    assert {"bulgefit", "numpy"} <= set(result["versions"])


def test_effects_that_act_are_told(capsys):
    words = [*MATERIAL, "--refine", "1", "--pressure", "1", "--hold"]
    held = "clamp_slip.compliance=0.01,initial_shape.h0=2,initial_shape.hx=-0.5"
    assert run(*words, held) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:3] == [
        "with clamp_slip: compliance = 0.01 mm per N/mm",
        "with initial_shape: h0 = 2 mm, hx = -0.5 mm",
    ]
    bumps = ",".join(f"stiffness_field.b{i}=0.1" for i in range(9))
    assert run(*words, bumps) == 0
    assert "with stiffness_field: 9 values" in capsys.readouterr().out
    assert run(*words, held, "--json", "-") == 0
    effects = json.loads(capsys.readouterr().out)["effects"]
    assert list(effects) == held_names(held)
    assert effects["initial_shape.h0"] == {"value": 2.0, "unit": "mm"}


def held_names(held):
    return [item.partition("=")[0] for item in held.split(",")]


def test_order_of_pressures_and_table(capsys):
    words = ["--E", "250", "--nu", "0.24", "--refine", "1", "--thickness", "0.81"]
    assert run(*words, "--pressure", "3,0.5,3", "--json", "-") == 0
    first = json.loads(capsys.readouterr().out)
    assert first["pressure_bar"] == [3, 0.5, 3]
    assert first["apex_mm"][0] == first["apex_mm"][2] > first["apex_mm"][1]
    assert run(*words, "--pressure", "0.5") == 0
    table = capsys.readouterr().out
    assert f"{first['apex_mm'][1]:.5f}" in table
    assert "E = 250 MPa" in table


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--thickness", "60"],
            ["more than half the radius", "a plate and no membrane", "E1 t is"],
        ),
        (["--radius", "0.1", "--thickness", "1e-3"], ["radius 0.1 mm is too small", "E1 t is"]),
        (["--E1", "250e9", "--E2", "250e9", "--G12", "1e11"], ["stiffer than diamond"]),
        (["--E1", "250e3"], ["E1 t is 2.02e+05 N/mm, which no fabric has"]),
        ([], []),
    ],
)
def test_sizes_that_info_would_not_believe_are_warned_of(words, said, capsys):
    assert run(*MATERIAL, "--pressure", "1", "--refine", "1", *words) == 0
    warned = capsys.readouterr().err.splitlines()
    assert len(warned) == len(said)
    for line, part in zip(warned, said, strict=True):
        assert line.startswith("warning: ")
        assert part in line


def test_radius_scales_and_angle_turns(capsys):
    def apexes(*words):
        assert run(*MATERIAL, "--refine", "2", "--pressure", "1", "--json", "-", *words) == 0
        return json.loads(capsys.readouterr().out)["apex_mm"][0]

    reference = apexes()
    # twice the size with twice the thickness is the same problem
    assert apexes("--radius", 200, "--thickness", 1.62) == pytest.approx(2 * reference, rel=1e-9)
    # the mesh has the symmetry of a square, so a quarter turn swaps warp and fill
    swapped = ["--E1", 229, "--E2", 303, "--nu12", 0.24 * 229 / 303]
    assert apexes(*swapped, "--angle", 90) == pytest.approx(reference, rel=1e-9)
    # a round clamp has no axes, but the mesh has: turned by 45°, only its error changes the apex
    turned, kept = apexes("--angle", 45), "--keep-mesh-error"
    assert abs(turned - reference) < 1e-3 < abs(apexes("--angle", 45, kept) - apexes(kept))


def test_a_path_is_a_bulge_test(tmp_path, capsys):
    file, result = tmp_path / "p.npz", tmp_path / "p.json"
    words = [*MATERIAL, "--refine", 2, "--pressure", "0.5,2", "--output", file, "--json", result]
    assert run(*words) == 0
    assert "apex" in capsys.readouterr().out
    apex = json.loads(result.read_text())["apex_mm"]
    with np.load(file, allow_pickle=False) as arrays:
        np.testing.assert_allclose(arrays["pressure"], [0.05, 0.2])
        assert arrays["nodes"].shape == (len(disc(100.0, 2).nodes), 2)
        assert arrays["cells"].shape == (228, 4)
        assert arrays["displacement"].shape == (2, len(arrays["nodes"]), 3)
    test = read_test(file)
    np.testing.assert_allclose(test.apex_displacement, apex)
    assert test.thickness == 0.81
    assert run(*words) == 2
    assert "exists; use --force" in capsys.readouterr().err
    assert run(*words, "--force") == 0


@pytest.mark.parametrize("angle", [0, 30])
def test_the_path_of_an_elliptic_clamp(tmp_path, capsys, angle):
    """It is a test of that clamp and warp, and its virtual test sees the same."""
    file, result = tmp_path / "p.npz", tmp_path / "p.json"
    soft = ["--E1", 303, "--E2", 229, "--G12", 20, "--nu12", 0.24, "--refine", 3]
    words = ["--semi-axes", 120, 80, "--pressure", 0.5, "--output", file, "--json", result]
    assert run(*soft, *words, "--angle", angle) == 0
    assert "semi-axes 120, 80 mm" in capsys.readouterr().out
    told = json.loads(result.read_text())
    assert told["semi_axes_mm"] == [120.0, 80.0]
    assert "radius_mm" not in told
    test = read_test(file)
    np.testing.assert_allclose(test.semi_axes, [120.0, 80.0])
    assert test.warp_angle == (angle or None)
    moduli = {"E1": 303.0, "E2": 229.0, "G12": 20.0, "nu12": 0.24}
    seen = predict(test, moduli, setup=Setup(refine=3)).displacement
    # what is left of the mesh's error
    assert np.abs(test.blocks[0].displacement - seen).max() < 2.0 * told["mesh_error_mm"]


def test_paraview(tmp_path):
    import pyvista

    file = tmp_path / "path.pvd"
    assert run(*MATERIAL, "--refine", 2, "--pressure", "2,0.5", "--output", file) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "path.pvd", "path_0000.vtu", "path_0001.vtu",
    ]  # fmt: skip
    reader = pyvista.get_reader(file)
    assert reader.time_values == [0.5, 2.0]
    reader.set_active_time_value(2.0)
    grid = reader.read()[0]
    expected = simulate(CONSTANTS, [0.05, 0.2], refine=2)
    np.testing.assert_allclose(grid.point_data["displacement"], expected.displacement[1], atol=1e-6)
    assert {"strain_11", "stress_12_MPa", "wrinkled"} <= set(grid.cell_data)
    assert grid.n_cells == 228


@pytest.mark.parametrize("law", ["hencky", "svk"])
def test_cell_fields_of_an_isotropic_disc(law):
    """At the pole strain and stress are equibiaxial, and the sphere there balances p."""
    made = simulate({"E1": 250.0, "E2": 250.0, "G12": 250 / 2.48, "nu12": 0.24}, [0.1], law=law,
                    mesh=disc(100.0, 6))  # fmt: skip
    fields = made.cell_fields(0)
    corners = made.mesh.nodes[made.mesh.cells].mean(axis=1)
    pole = np.hypot(*corners.T).argmin()
    e, s = fields["strain_11"][pole], fields["stress_11"][pole]
    assert fields["strain_22"][pole] == pytest.approx(e, rel=1e-3)
    assert abs(fields["strain_12"][pole]) < 1e-3 * e
    # S = (E/(1 - nu)) e over the squared stretch that conjugates the law's strain
    stretch2 = np.exp(2 * e) if law == "hencky" else 1 + 2 * e
    conjugate = stretch2 if law == "hencky" else 1.0
    assert s == pytest.approx(250 / 0.76 * e / conjugate, rel=1e-3)
    # membrane force per deformed length n = t S, with p = 2 n/R at the pole
    x, z = np.hypot(*(made.mesh.nodes + made.displacement[0, :, :2]).T), made.displacement[0, :, 2]
    near = (x > 1.0) & (x < 25.0)
    curvature = np.median(2 * (made.apex[0] - z[near]) / x[near] ** 2)
    assert 2 * 0.81 * s * curvature == pytest.approx(0.1, rel=0.03)
    assert not fields["wrinkled"].any()


@pytest.mark.parametrize(
    "effects", [{}, {"clamp_slip.compliance": 0.02}, {"axis_misalignment.angle": 10.0}]
)
def test_shapes_are_what_predict_sees_at_the_nodes(effects):
    """Fields are interpolated through the nodes, so both ways tell of the same shape."""
    made = simulate(CONSTANTS, [0.05, 0.2], refine=3, effects=effects)
    inside = np.delete(np.arange(len(made.mesh.nodes)), made.mesh.rim)
    points = np.column_stack([made.mesh.nodes[inside], np.zeros(len(inside))])
    test = BulgeTest.from_arrays(points, np.zeros((2, len(inside), 3)), [0.05, 0.2])
    seen = predict(test, CONSTANTS, effects=effects, setup=Setup(refine=3, interpolation="none"))
    np.testing.assert_allclose(made.displacement[:, inside], seen.displacement, atol=1e-9)
    path = made.path([0.05, 0.2])
    here = made.displacement - path  # what was taken off the mesh's error, and the path's
    assert np.abs(here).max() == pytest.approx(made.mesh_error_taken_off, abs=1e-3)
    assert np.abs(made.path(0.2) - path[1]).max() == 0.0


def test_no_path_goes_through_shapes_of_a_rim_that_moves():
    made = simulate(CONSTANTS, [0.05, 0.2], refine=2, effects={"rim_lift.amplitude": 0.5})
    with pytest.raises(InputError, match="there is no path where effects move the rim"):
        _ = made.path


@pytest.mark.parametrize(("g12", "stable"), [(30.0, [True, True]), (5.0, [True, False])])
def test_shapes_balance_the_whole_membrane(g12, stable):
    """Though a quarter of it is balanced, and under soft shear one that odd shapes would leave."""
    moduli = {"E1": 330.0, "E2": 200.0, "G12": g12, "nu12": 0.24}
    made = simulate(moduli, [0.1, 0.3], refine=3, correct_mesh=False)
    stiffness = made.description.stiffness
    definite = []
    for shape, pressure in zip(made.displacement, made.pressure, strict=True):
        state = made.membrane.state(shape, pressure, stiffness)
        assert np.abs(state.residual).max() < 1e-6  # N, of some 10 at a node
        try:
            made.membrane.factorise(state)
            definite.append(True)
        except NotPositiveDefiniteError:
            definite.append(False)
    assert definite == stable
    assert made.stable == all(stable)


def test_a_rim_that_rises():
    lift = {"rim_lift.amplitude": 0.5, "rim_lift.direction": 90.0}
    made = simulate(CONSTANTS, [0.1], refine=1, effects=lift)
    x, y = made.mesh.nodes[made.mesh.rim].T
    expected = 0.5 * np.maximum(y, 0.0) / np.hypot(x, y)  # mm at 1 bar, towards y
    np.testing.assert_allclose(made.displacement[0, made.mesh.rim, 2], expected, atol=1e-8)


def test_cells_know_the_effects():
    own = simulate({**CONSTANTS, "nu12": 0.3}, [0.1], refine=1).cell_fields(0)
    held = simulate(CONSTANTS, [0.1], refine=1, effects={"poisson_ratio.nu12": 0.3}).cell_fields(0)
    for name, values in own.items():
        np.testing.assert_allclose(held[name], values, rtol=1e-9, atol=1e-12)


def test_nothing_is_loaded_that_is_not_used():
    """Neither readers of tests, nor what numba compiles by where nothing is compiled."""
    words = ["simulate", *MATERIAL, "--refine", "1", "--pressure", "1", "--quiet"]
    script = (
        "import sys; from bulgefit.cli.main import main; "
        f"assert main({words}) == 0; "
        "print(*{'bulgefit.dic.readers', 'numba.np.arraymath'} & set(sys.modules))"
    )
    for _ in range(2):  # the first may have to compile
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        )
    assert done.stdout.splitlines()[-1] == ""


def test_many_pressures_come_from_the_dense_output():
    loads = np.linspace(0.01, 0.3, 60)
    many = simulate(CONSTANTS, loads, mesh=disc(100.0, 2))
    few = simulate(CONSTANTS, loads[[3, 30, 50]], mesh=disc(100.0, 2))
    assert many.factorisations < 60
    assert 0 < many.error <= 1e-3
    assert few.error == 0.0
    np.testing.assert_allclose(many.apex[[3, 30, 50]], few.apex, atol=2e-3)


def test_errors_of_the_library():
    for wrong in ([], [[0.1, 0.2]], [0.1, -0.2], [np.nan], 0.0):
        with pytest.raises(InputError, match="pressure"):
            simulate(CONSTANTS, wrong)
    for name in ("radius", "thickness", "tolerance"):
        with pytest.raises(InputError, match=name):
            simulate(CONSTANTS, 0.1, **{name: 0.0})
    with pytest.raises(InputError, match="angle"):
        simulate(CONSTANTS, 0.1, angle=np.inf)
    with pytest.raises(InputError, match="missing: nu12"):
        simulate({"E1": 1.0, "E2": 1.0, "G12": 1.0}, 0.1)


def test_limit_pressure(capsys):
    """Soft fabric blows up: an answer that names what was reached."""
    assert run("--E", 1, "--refine", 1, "--pressure", "0.01,5") == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.splitlines()[-1].startswith("bulgefit simulate: error: no equilibrium")
    assert "equilibrium was reached up to" in output.err
    with pytest.raises(SolveError) as caught:
        simulate({"E1": 1.0, "E2": 1.0, "G12": 0.4, "nu12": 0.24}, 0.5, mesh=disc(100.0, 1))
    assert 0 < caught.value.reached < 0.5


def test_what_a_simulation_does_not_show_of_what_was_found(tmp_path, capsys):
    slip = {"effect": "clamp_slip", "parameters": {"compliance": {"value": 0.02}}}
    moved = {"effect": "rigid_motion", "parameters": {"shift_z": {"value": 0.3}}}
    given = {name: {"value": CONSTANTS[name]} for name in ("E1", "E2", "G12")}
    gap = tmp_path / "gap.json"
    words = [*MATERIAL, "--pressure", "1", "--refine", "1", "--json", "-"]
    words += ["--radius", "100", "--thickness", "0.81"]
    apex = []
    for causes in ([slip], [slip, moved]):
        gap.write_text(json.dumps({"causes": causes, "parameters": {"corrected": given}}))
        assert run(*words, "--from", gap) == 0
        output = capsys.readouterr()
        apex.append(json.loads(output.out)["apex_mm"])
    assert apex[0] == apex[1]
    assert output.err == (
        f"note: --from {gap}: a simulation shows nothing of rigid_motion.shift_z (what cameras do "
        "changes no shape)\n"
    )


#: How a test was mounted, as results tell it, and as options say it.
OVAL = {"semi_axes_mm": [52.0, 47.0], "thickness_mm": 0.4, "warp_angle_degree": 30.0}
OPTIONS = {"--semi-axes": [52, 47], "--thickness": [0.4], "--angle": [30]}
RESULTS = {
    "fit": lambda tests: {
        "starts": [], "sources": tests, "material": "orthotropic",
        "parameters": {name: {"value": value} for name, value in CONSTANTS.items()},
    },
    "diagnose": lambda tests: {
        "causes": [], "report": {"tests": tests},
        "parameters": {"corrected": {n: {"value": CONSTANTS[n]} for n in ("E1", "E2", "G12")}},
    },
}  # fmt: skip


@pytest.fixture
def simulated(tmp_path, capsys):
    """JSON and stderr of a simulation by a result of these tests, and more options."""

    def of(kind, tests, *options):
        (tmp_path / "found.json").write_text(json.dumps(RESULTS[kind](tests)))
        words = ["--pressure", "0.5,1", "--refine", "1", "--json", "-"]
        assert run(*words, "--from", tmp_path / "found.json", *options) == 0
        output = capsys.readouterr()
        return json.loads(output.out), output.err

    return of


@pytest.mark.parametrize("kind", RESULTS)
def test_the_membrane_of_a_result_is_mounted_as_its_tests_were(kind, simulated, capsys):
    found, told = simulated(kind, [OVAL, OVAL])
    by_hand = [str(word) for option, values in OPTIONS.items() for word in (option, *values)]
    words = [*MATERIAL, "--pressure", "0.5,1", "--refine", "1", "--json", "-"]
    assert run(*words, *by_hand) == 0
    said = json.loads(capsys.readouterr().out)
    assert (found["semi_axes_mm"], found["thickness_mm"]) == ([52.0, 47.0], 0.4)
    assert found["angle_degree"] == 30.0
    assert found["apex_mm"] == said["apex_mm"]
    assert "warning" not in told


def test_options_go_before_what_a_result_tells(simulated):
    found, told = simulated("fit", [OVAL], "--radius", "60", "--thickness", "0.5", "--angle", "10")
    assert found["radius_mm"] == pytest.approx(60.0, rel=1e-12)
    assert (found["thickness_mm"], found["angle_degree"]) == (0.5, 10.0)
    # and the tests may then differ, or not tell
    other = {"semi_axes_mm": [90.0, 90.0]}
    assert (
        simulated("fit", [OVAL, other], "--radius", "60", "--thickness", "0.5", "--angle", "10")[0][
            "apex_mm"
        ]
        == found["apex_mm"]
    )
    assert "warning" not in told


def test_a_result_that_does_not_tell_how_its_tests_were_mounted(simulated, tmp_path):
    found, told = simulated("fit", [{"name": "a"}])
    assert (found["radius_mm"], found["thickness_mm"], found["angle_degree"]) == (100.0, 0.81, 0.0)
    where = f"warning: --from {tmp_path / 'found.json'}:"
    assert told.splitlines() == [
        f"{where} semi_axes_mm of its tests is not told, 100 mm is taken; give --radius or "
        "--semi-axes",
        f"{where} thickness_mm of its tests is not told, 0.81 mm is taken; give --thickness",
    ]


@pytest.mark.parametrize(
    ("tests", "said"),
    [
        (
            [OVAL, OVAL | {"semi_axes_mm": [50.0, 50.0]}],
            "semi_axes_mm of its tests differs ([52.0, 47.0], [50.0, 50.0]); give --radius or "
            "--semi-axes",
        ),
        ([OVAL, OVAL | {"thickness_mm": 0.5}], "thickness_mm of its tests differs (0.4, 0.5)"),
        ([OVAL, {**OVAL, "warp_angle_degree": 0.0}], "differs (30.0, 0.0); give --angle"),
        ([OVAL | {"thickness_mm": "0.4"}], "thickness_mm of its tests is not as it was written"),
        ([OVAL | {"thickness_mm": -0.4}], "thickness_mm of its tests is not as it was written"),
        ([OVAL | {"semi_axes_mm": 50.0}], "semi_axes_mm of its tests is not as it was written"),
        (["a"], "its tests are not as they were written"),
    ],
)
def test_tests_of_a_result_that_differ_or_make_no_sense(tests, said, tmp_path, capsys):
    path = tmp_path / "found.json"
    path.write_text(json.dumps(RESULTS["fit"](tests)))
    assert run("--pressure", "1", "--refine", "1", "--from", path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"bulgefit simulate: error: --from {path}: ")
    assert said in line


BAD = {
    "law": (["--law", "hooke"], "law: 'hooke' is unknown; choose from hencky, svk, yarn"),
    "inadmissible": (["--E1", "5", "--nu12", "0.9"], "E1/E2 must exceed nu12²"),
    "shear": (["--G12", "-5"], "G12 must be positive, got -5 MPa"),
    "beyond numbers": (["--G12", "1e200"], "G12 must be at most 1e+30 MPa, got 1e+200 MPa"),
    "mixture": (["--E", "5"], "--E1 and --E do not go together"),
    "number": (["--E1", "lots"], "argument --E1: 'lots' is no number"),
    "mesh missing": (["--mesh", "nowhere.npz"], "nowhere.npz: cannot be read"),
    "mesh of what": (["--mesh", "other.npz"], "other.npz: not a mesh, it has no nodes and no"),
    "mesh and refine": (["--mesh", "m.npz", "--refine", "2"], "do not go together"),
    "mesh and radius": (["--mesh", "m.npz", "--radius", "50"], "m.npz reaches 100 mm"),
    "refine": (["--refine", "0"], "refine must be a whole number, 1 to 200, got 0"),
    "mesh of text": (["--mesh", "text.npz"], "text.npz: nodes holds"),
    "mesh with a damaged header": (["--mesh", "header.npz"], "header.npz: not an npz file with"),
    "mesh of one cell": (["--mesh", "one.npz"], "lies on its rim; give a disc about the"),
    "mesh elsewhere": (["--mesh", "far.npz"], "lies on its rim; give a disc about the"),
    "mesh in two": (["--mesh", "two.npz"], "mesh: its cells fall into 2 parts"),
    "radius": (["--radius", "-1"], "--radius -1: give a length above 0 mm"),
    "huge radius": (["--radius", "1e300"], "mesh: nodes reach 1e+300 mm; give them in mm, up to"),
    "semi-axes": (["--semi-axes", "120", "-80"], "--semi-axes -80: give a length above 0 mm"),
    "semi-axes and radius": (
        ["--semi-axes", "120", "80", "--radius", "90"],
        "--semi-axes: does not go with --radius",
    ),
    "thickness": (["--thickness", "0"], "--thickness 0: give a length above 0 mm"),
    "angle": (["--angle", "nan"], "--angle nan"),
    "solver": (["--linear-solver", "abacus"], "abacus"),
    "cameras": (
        ["--hold", "rigid_motion.shift_z=5,creep.rate=0.1,dic_scale.scale=0.01"],
        "--hold: a simulation shows nothing of rigid_motion.shift_z, dic_scale.scale (what cameras "
        "do changes no shape) and creep.rate (it has no time); leave that out",
    ),
    "two ratios": (["--hold", "poisson_ratio.nu12=0.4"], "takes the place of nu12"),
    "pressure word": (["--pressure", "1,two"], "--pressure: 'two' is no number"),
    "pressure empty": (["--pressure", "1,,2"], "--pressure: '' is no number"),
    "pressure zero": (["--pressure", "0"], "--pressure: 0 is not a pressure above 0 bar"),
    "pressure negative": (["--pressure", "-1,2"], "--pressure: -1 is not a pressure above 0"),
    "pressure nan": (["--pressure", "nan"], "--pressure: nan is not a pressure"),
    "json exists": (["--json", "there.json"], "there.json: exists; use --force"),
    "json folder": (["--json", "."], "is a folder"),
    "no folder": (["--json", "no/such/r.json"], "does not exist"),
    "json in what was found": (
        ["--from", "found.json", "--json", "./found.json", "--force"],
        "would replace what is read",
    ),
    "json in the mesh": (["--mesh", "m.npz", "--json", "m.npz", "--force"], "would replace what"),
    "outputs of one name": (["--output", "z.npz", "--json", "./z.npz"], "two outputs have this"),
    "picture and json": (["--picture", "z.png", "--json", "z.png"], "two outputs have this name"),
    "piece and json": (["--output", "a.pvd", "--json", "a_0000.vtu"], "two outputs have this"),
    "output exists": (["--output", "m.npz"], "m.npz: exists; use --force"),
    "output kind": (["--output", "path.txt"], "ends in .npz or .pvd"),
    "piece exists": (["--output", "path.pvd"], "path_0000.vtu: exists; use --force"),
    "picture kind": (["--picture", "a.jpg"], "ends in .png"),
    "unknown option": (["--colour", "red"], "unrecognized arguments: --colour red"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    mesh = disc(100.0, 1)
    np.savez("m.npz", nodes=mesh.nodes, cells=mesh.cells)
    np.savez("other.npz", something=mesh.nodes)
    np.savez("one.npz", nodes=[[-50, -50], [50, -50], [50, 50], [-50, 50]], cells=[[0, 1, 2, 3]])
    with zipfile.ZipFile("text.npz", "w") as archive:
        archive.writestr("nodes", "0 0")
        archive.writestr("cells", "0 1 2 3")
    with zipfile.ZipFile("header.npz", "w") as archive:
        for key in ("nodes.npy", "cells.npy"):
            archive.writestr(key, b"\x93NUMPY\x01\x00\x10\x00{'descr': (((((\n")
    np.savez("far.npz", nodes=mesh.nodes + np.array([500.0, 0.0]), cells=mesh.cells)
    nodes = np.concatenate([mesh.nodes, mesh.nodes + np.array([300.0, 0.0])])
    np.savez("two.npz", nodes=nodes, cells=[*mesh.cells, *(mesh.cells + len(mesh.nodes))])
    Path("there.json").touch()
    Path("found.json").touch()
    Path("path_0000.vtu").touch()
    before = sorted(os.listdir())
    words, message = BAD[case]
    assert run(*MATERIAL, "--pressure", "1", "--quiet", *words) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("bulgefit simulate: error: ")
    assert output.err.count("\n") == 1
    assert message in output.err
    assert sorted(os.listdir()) == before


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("option", ["--json", "--output", "--picture"])
def test_place_that_cannot_be_written(option, monkeypatch, capsys):
    """Even root may not make files in /proc; it is seen before the work."""
    file = {"--json": "/proc/r.json", "--output": "/proc/r.npz", "--picture": "/proc/r.png"}[option]
    monkeypatch.setattr("bulgefit.model.simulation.simulate", lambda *_, **__: pytest.fail("began"))
    assert run(*MATERIAL, "--refine", 1, "--pressure", "1", option, file) == 2
    assert f"{file}: cannot be written" in capsys.readouterr().err


def test_a_picture_shows_the_opening_and_the_height_that_there_are(tmp_path, monkeypatch):
    """A lobed clamp was drawn as a disc, and a dome before inflation left out of its shape."""
    drawn = []
    monkeypatch.setattr(
        "bulgefit.report.fields.plot_fields", lambda *given, **_: drawn.append(given)
    )
    held = ["--hold", "initial_shape.h0=5,clamp_shape.ellipticity=0.1"]
    words = [*MATERIAL, *held, "--refine", 1, "--pressure", "0.1", "--quiet"]
    assert run(*words, "--picture", tmp_path / "p.png") == 0
    ((nodes, _, displacement, _),) = drawn
    reach = np.hypot(nodes[:, 0] / 110.0, nodes[:, 1] / 90.0)
    assert reach.max() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(nodes[:, 2], 5.0 * (1.0 - reach**2), atol=1e-9)
    assert (nodes + displacement)[:, 2].max() > 5.0


def test_a_picture_that_fails_keeps_back_nothing_else(tmp_path, monkeypatch, capsys):
    def fails(*_, **__):
        raise BulgefitError("no OpenGL")

    monkeypatch.setattr("bulgefit.report.fields.plot_fields", fails)
    files = [tmp_path / "p.npz", tmp_path / "p.json"]
    words = ["--output", files[0], "--json", files[1], "--picture", tmp_path / "p.png"]
    assert run(*MATERIAL, "--refine", 1, "--pressure", "1", "--quiet", *words) == 2
    output = capsys.readouterr()
    assert "apex" in output.out
    assert output.err == "bulgefit simulate: error: no OpenGL\n"
    assert sorted(tmp_path.iterdir()) == sorted(files)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to read-only folders")
def test_read_only_folder(tmp_path, capsys):
    tmp_path.chmod(0o555)
    assert run(*MATERIAL, "--refine", 1, "--pressure", "1", "--output", tmp_path / "p.npz") == 2
    tmp_path.chmod(0o755)
    assert "cannot be written (Permission denied)" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("law", "elliptic"), [("hencky", [True, False]), ("svk", [True, True])])
def test_bands_of_shear_are_warned_of_where_the_law_is_not_elliptic(law, elliptic, capsys):
    """By `hencky` from 0.71 bar on (docs/verification.md), though the tangent stays definite."""
    words = [*MATERIAL, "--law", law, "--pressure", "0.69,0.73"]
    assert run(*words, "--json", "-") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["elliptic"] == elliptic
    assert found["stable"] is True
    assert run(*words) == 0
    warning = "not elliptic at 1 of 2 pressures, the lowest of them 0.73 bar"
    assert (warning in capsys.readouterr().out) is not all(elliptic)


def test_shapes_beside_a_singular_point_are_told_to_be_coarse(capsys):
    """Of a path that is unstable; 1.02552 bar lies beside a point where its tangent is singular."""
    soft = ["--E1", 30.1, "--E2", 119.74, "--G12", 0.66, "--nu12", 0.24, "--refine", 3]
    few = ",".join(f"{p:.4g}" for p in np.linspace(0.1, 0.5, 20))
    assert run(*soft, "--keep-mesh-error", "--pressure", f"{few},1.02552,1.1") == 0
    told = capsys.readouterr().out
    assert re.search(r"shapes may be off by \d+ µm: .* singular point", told)
    assert run(*soft, "--keep-mesh-error", "--pressure", few + ",0.55") == 0
    assert "singular point" not in capsys.readouterr().out
