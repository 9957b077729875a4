"""Does the solver give the right numbers? Closed forms, independent solutions, ABAQUS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from axisymmetric import apex
from hencky_series import apex_coefficient
from scipy.interpolate import make_interp_spline

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, disc, rectangle
from bulgefit.fem.trace import trace

BAR = np.array([0.1, 0.5, 1.0, 2.0, 3.0])
#: Apex of the isotropic disc (mm), E = 250 MPa, nu = 0.24.
REFERENCE = {
    "svk": (11.411332379, 19.622875487, 24.848588654, 31.562022468, 36.378199299),
    "hencky": (11.519263059, 20.196730193, 26.065798682, 34.259333814, 40.836615051),
}
HENCKY_SERIES = {0.0: 0.718319238465, 0.24: 0.668173814130, 0.3: 0.653443344693,
                 0.5: 0.594879029969}  # fmt: skip


def isotropic(modulus: float, nu: float) -> np.ndarray:
    return orthotropic_stiffness(modulus, modulus, modulus / (2 * (1 + nu)), nu)


@pytest.fixture(scope="session")
def study_mesh(shared: Path) -> Mesh:
    with np.load(shared / "data/abaqus/mesh.npz") as data:
        return Mesh.from_arrays(data["nodes"], data["cells"])


@pytest.mark.parametrize("law", REFERENCE)
def test_boundary_value_problem_gives_the_published_apex(law: str) -> None:
    found = [apex(0.1 * p, law=law, modulus=250.0, nu=0.24) for p in BAR]
    np.testing.assert_allclose(found, REFERENCE[law], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("law", "modulus", "nu"), [("svk", 250, 0.24), ("hencky", 250, 0.24), ("hencky", 180, 0.4)]
)
def test_disc_converges_to_the_boundary_value_problem(law: str, modulus: float, nu: float) -> None:
    exact = np.array([apex(0.1 * p, law=law, modulus=modulus, nu=nu) for p in BAR])
    found = []
    for refine in (2, 4, 8):
        mesh = disc(100.0, refine)
        path = trace(Membrane(mesh, 0.81, law), isotropic(modulus, nu), tolerance=1e-5)
        found.append(path(0.1 * BAR)[:, mesh.apex, 2])
    error = np.abs(np.array(found) - exact)
    order = np.log2(error[:-1] / error[1:])
    assert order.min() >= 1.9
    extrapolated = found[2] + (found[2] - found[1]) / 3.0
    np.testing.assert_allclose(extrapolated, exact, rtol=1e-4)


@pytest.mark.parametrize(("nu", "coefficient"), HENCKY_SERIES.items())
def test_hencky_series(nu: float, coefficient: float) -> None:
    assert apex_coefficient(nu) == pytest.approx(coefficient, abs=1e-11)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_solver_at_vanishing_pressure_is_hencky_series(nu: float) -> None:
    pressure = 1e-10
    heights = []
    for refine in (2, 4, 8):
        mesh = disc(100.0, refine)
        path = trace(Membrane(mesh, 0.81), isotropic(250.0, nu), (pressure, pressure))
        heights.append(path.displacement[0, mesh.apex, 2])
    scale = 100.0 * np.cbrt(pressure * 100.0 / (250.0 * 0.81))
    extrapolated = (heights[2] + (heights[2] - heights[1]) / 3.0) / scale
    assert extrapolated == pytest.approx(HENCKY_SERIES[nu], rel=1e-4)
    error = np.abs(np.array(heights) / scale - HENCKY_SERIES[nu])
    assert np.log2(error[:-1] / error[1:]).min() >= 1.9


def strip(cells: int, angle: float, constants: tuple[float, ...], pressure: float) -> float:
    """Apex (mm) of a strip of half-width 100 mm, held along x = ±100, all u_y zero."""
    mesh = rectangle((-100.0, 100.0), (0.0, 200.0 / cells), cells, 1)
    fixed = np.zeros((len(mesh.nodes), 3), dtype=bool)
    fixed[:, 1] = True
    fixed[np.abs(np.abs(mesh.nodes[:, 0]) - 100.0) < 1e-9] = True
    membrane = Membrane(mesh, 0.81, "svk", angle=angle, fixed=fixed)
    path = trace(membrane, orthotropic_stiffness(*constants), (1e-4, pressure), tolerance=1e-5)
    middle = np.argmin(np.abs(mesh.nodes[:, 0]))
    return float(path(pressure)[0, middle, 2])


def strip_pressure(modulus: float, phi: float) -> float:
    """Pressure (MPa) that bends the strip to the half angle phi."""
    stretch = phi / np.sin(phi)
    return modulus * 0.81 / 100.0 * np.sin(phi) * stretch * (stretch**2 - 1) / 2


@pytest.mark.parametrize("angle", [0.0, 90.0, 45.0])
def test_strip_in_closed_form(angle: float) -> None:
    # Turned by 45°, unequal moduli would shear the strip across its free sides (Q16), which a
    # strip of one cell's width cannot pass on to a neighbour; equal ones still test G12.
    constants, phi = (250.0, 250.0 if angle == 45.0 else 240.0, 5.0, 0.24), 0.4
    d11, d22, d12, d33 = orthotropic_stiffness(*constants)
    modulus = {0.0: d11, 90.0: d22, 45.0: (d11 + d22 + 2 * d12 + 4 * d33) / 4}[angle]
    pressure = strip_pressure(modulus, phi)
    height = 100.0 * np.tan(phi / 2)
    if angle == 0.0:
        assert pressure == pytest.approx(0.023614969173, abs=1e-12)
        assert height == pytest.approx(20.271003550867, abs=1e-11)
    found = [strip(n, np.radians(angle), constants, pressure) for n in (16, 32, 64)]
    error = np.abs(np.array(found) - height)
    assert np.log2(error[:-1] / error[1:]).min() >= 1.9
    assert found[2] + (found[2] - found[1]) / 3 == pytest.approx(height, rel=1e-6)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ("hencky", (20.49514, 26.44803, 34.75211, 41.40784)),
        ("svk", (19.89363, 25.17823, 31.95835, 36.81727)),
    ],
)
def test_study_mesh(study_mesh: Mesh, law: str, expected: tuple[float, ...]) -> None:
    stiffness = orthotropic_stiffness(303.0, 229.0, 5.0, 0.24)
    path = trace(Membrane(study_mesh, 0.81, law), stiffness, tolerance=1e-5)
    found = path(np.array([0.05, 0.1, 0.2, 0.3]))[:, study_mesh.apex, 2]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


LEVELS = np.linspace(0.001, 3.0, 200) / 10  # MPa


def test_apex_objective_of_abaqus(study_mesh: Mesh, shared: Path) -> None:
    table = np.genfromtxt(shared / "data/abaqus/e_z.csv", delimiter=",", names=True)
    membrane = Membrane(study_mesh, 0.81)
    for row in table:
        with np.load(shared / f"data/dic/valmex_test{int(row['test'])}_apex.npz") as data:
            measured, pressure = data["displacement"][:, 0, 2], data["pressure"]
        constants = (row["E1_MPa"], row["E2_MPa"], row["G12_MPa"], row["nu12"])
        path = trace(membrane, orthotropic_stiffness(*constants))
        heights = path(LEVELS)[:, study_mesh.apex, 2]
        heights[0] = 1.857  # the artefact of ABAQUS's stabilisation
        found = np.abs(np.interp(pressure, LEVELS, heights) - measured).mean()
        assert found == pytest.approx(row["e_z_mm"], abs=5e-4)


def test_curves_of_abaqus(study_mesh: Mesh, shared: Path) -> None:
    with np.load(shared / "data/abaqus/profiles.npz") as data:
        curves = {key: data[key] for key in ("parameters", "pressure", "axis", "curves")}
    nodes = study_mesh.nodes
    distance = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    line = np.linspace(-99.0, 99.0, 400)
    membrane = Membrane(study_mesh, 0.81)
    worst = {"dz": 0.0, "in plane": 0.0}
    for constants in np.unique(curves["parameters"], axis=0):
        path = trace(membrane, orthotropic_stiffness(*constants, 0.24))
        chosen = np.flatnonzero((curves["parameters"] == constants).all(axis=1))
        # the study's curves are linear between its levels
        shapes = make_interp_spline(LEVELS, path(LEVELS), k=1)(curves["pressure"][chosen])
        for index, shape in zip(chosen, shapes, strict=True):
            axis = int(curves["axis"][index])
            points = np.zeros((len(line), 2))
            points[:, axis] = line
            kernel = np.linalg.norm(points[:, None] - nodes[None], axis=2)
            field = kernel @ np.linalg.solve(distance, shape)
            where = line + field[:, axis]
            at, dz, at_too, inplane = curves["curves"][index]
            for name, position, value, component in (
                ("dz", at, dz, 2), ("in plane", at_too, inplane, axis),
            ):  # fmt: skip
                known = np.isfinite(position) & np.isfinite(value) & (np.abs(position) < 90)
                ours = np.interp(position[known], where, field[:, component])
                worst[name] = max(worst[name], np.abs(ours - value[known]).max())
    assert worst["dz"] < 3e-3
    assert worst["in plane"] < 3e-3
