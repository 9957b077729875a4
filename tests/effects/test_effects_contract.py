"""What every effect of the catalogue keeps: asked of the registry, so a new one is asked too."""

from __future__ import annotations

import ast
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bulgefit.effects.base import PLACES, Effect
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Clamping, Cloth, Load, Scene
from bulgefit.effects.registry import catalogue, effect_named, fields, own_values, scatter
from bulgefit.model.virtual_test import VirtualTest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "bulgefit"

MODULI = {"E1": 330.0, "E2": 200.0, "G12": 20.0}
EFFECTS = [*catalogue().values(), *scatter().values()]
IDS = [effect.id for effect in EFFECTS]

#: Place, and unit of each parameter, as the design of the model has them; "*" stands for the rest.
DESIGNED: dict[str, tuple[str, dict[str, str]]] = {
    "initial_shape": ("shape", {"*": "mm"}),
    "clamp_shape": ("shape", {"ellipticity": "1", "radius_error": "1"}),
    "clamp_lobes": ("shape", {"c3": "1", "s3": "1"}),
    "prestrain": ("clamp", {"slack_x": "1", "slack_y": "1"}),
    "clamp_slip": ("clamp", {"compliance": "mm per N/mm"}),
    "rim_lift": ("clamp", {"amplitude": "mm/bar", "direction": "degree", "shape": "1/bar"}),
    "axis_misalignment": ("material", {"angle": "degree"}),
    "poisson_ratio": ("material", {"nu12": "1"}),
    "nonlinear_material": ("material", {"*": "1"}),
    "specimen_factor": ("material", {"warp": "1", "fill": "1"}),
    "stiffness_gradient": ("material", {"g_x": "1", "g_y": "1"}),
    "creep": ("material", {"rate": "1 per decade"}),
    "pressure_offset": ("load", {"offset": "bar"}),
    "pressure_gain": ("load", {"gain": "1"}),
    "rigid_motion": (
        "camera",
        {f"rotation_{a}": "degree" for a in "xyz"} | {f"shift_{a}": "mm" for a in "xyz"},
    ),
    "fixture_motion": (
        "camera",
        {f"rotation_{a}": "degree/bar" for a in "xyz"}
        | {f"shift_{a}": "mm/bar" for a in "xyz"}
        | {"shape": "1/bar"},
    ),
    "frame_misalignment": ("camera", {f"rotation_{a}": "degree" for a in "xyz"}),
    "reference_state": ("camera", {"flattening": "bar", "*": "mm"}),
    "registration": ("camera", {"x0": "mm", "y0": "mm"}),
    "dic_scale": ("camera", {"scale": "1"}),
    "depth_scale": ("camera", {"scale_z": "1"}),
    "lens_distortion": ("camera", {"k1": "1"}),
    "surface_offset": ("camera", {"share": "1"}),
    "dic_smoothing": ("camera", {"window": "mm"}),
}

#: Rooms that know effects, and may ask for none by name. Those below cannot import them (a test's
#: own `poisson_ratio` is another thing), and `trial` makes tests with effects of its own.
ROOMS = ("effects", "model", "fitting", "gap", "report", "cli")


def test_the_design_knows_every_effect() -> None:
    assert set(DESIGNED) == set(IDS)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_place_and_units(effect: Effect) -> None:
    place, units = DESIGNED[effect.id]
    assert effect.place == place
    assert place in PLACES
    for parameter in effect.parameters:
        assert parameter.unit == units.get(parameter.name, units.get("*"))


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_it_is_documented(effect: Effect) -> None:
    assert (type(effect).__doc__ or "").strip()
    assert type(effect).__doc__ != Effect.__doc__
    assert effect.meaning
    assert effect.remedy
    assert f"`{effect.id}`" in (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    for parameter in effect.parameters:
        assert parameter.reason, parameter.name
        assert 0.0 < parameter.prior < math.inf
        assert parameter.lower < parameter.upper
        assert parameter.step > 0.0
        if parameter.null is not None:
            assert parameter.lower <= parameter.null <= parameter.upper
        if parameter.start is not None:
            assert parameter.lower <= parameter.start <= parameter.upper


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_its_forms_grow_out_of_its_parameters(effect: Effect) -> None:
    known = {p.name for p in effect.parameters}
    for form in effect.forms:
        assert set(form) <= known
    assert {name for group in effect.groups() for name in group} <= set(effect.names)
    assert {name for told in effect.told for name in told.names} <= known
    assert all(told.error > 0.0 for told in effect.told)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_it_can_be_sent_to_a_worker(effect: Effect) -> None:
    copy = pickle.loads(pickle.dumps(effect))
    assert (copy.id, copy.parameters) == (effect.id, effect.parameters)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_its_name_stands_in_one_file(effect: Effect, strings: dict[str, set[str]]) -> None:
    """Code that asks for one effect by name stands in its file alone.

    Examples within longer texts, such as help, ask for nothing.
    """
    found = {
        path
        for path, texts in strings.items()
        if any(text == effect.id or text.startswith(f"{effect.id}.") for text in texts)
    }
    assert found == {f"effects/{effect.id}.py"}


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_its_file_is_imported_by_the_registry_alone(effect: Effect) -> None:
    home = f"bulgefit.effects.{effect.id}"
    assert [p for p in SOURCE.rglob("*.py") if home in p.read_text(encoding="utf-8")] == []


def test_rooms_that_cannot_know_effects_import_none() -> None:
    for path in SOURCE.rglob("*.py"):
        room = path.relative_to(SOURCE).parts[0].removesuffix(".py")
        if room not in (*ROOMS, "__init__", "__main__"):
            assert "bulgefit.effects" not in path.read_text(encoding="utf-8"), path


@pytest.fixture(scope="module")
def strings() -> dict[str, set[str]]:
    """Every string of each file of the rooms that know effects."""
    found = {}
    for path in (p for room in ROOMS for p in (SOURCE / room).rglob("*.py")):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        found[path.relative_to(SOURCE).as_posix()] = {
            node.value
            for node in nodes
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
    return found


# the null


def nulls_of(effect: Effect, specimen: VirtualTest) -> dict[str, float]:
    own = own_values(effect, {}, specimen.nulls())
    return {f"{effect.id}.{name}": value for name, value in own.items()}


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_its_null_changes_nothing(effect: Effect, specimen: VirtualTest) -> None:
    without = specimen.predict(MODULI).displacement
    at_null = specimen.predict({**MODULI, **nulls_of(effect, specimen)}).displacement
    np.testing.assert_allclose(at_null, without, rtol=0.0, atol=1e-12)


GOVERNED = [(e, p) for e in EFFECTS for p in e.parameters if p.governor is not None]


@pytest.mark.parametrize(
    ("effect", "parameter"), GOVERNED, ids=lambda one: getattr(one, "name", "")
)
def test_what_is_governed_changes_nothing_without_its_governor(
    effect: Effect, parameter: Parameter, specimen: VirtualTest
) -> None:
    """The others are as they would be with the effect there, and so is the governor of others."""
    assert parameter.governor in {p.name for p in effect.parameters}
    own = {
        p.name: 0.5 * (p.lower + p.upper)
        for p in effect.parameters
        if parameter.governor not in (p.name, p.governor)
    }
    seen = []
    for value in (parameter.lower, 0.3 * parameter.lower + 0.7 * parameter.upper):
        values = {f"{effect.id}.{name}": at for name, at in {**own, parameter.name: value}.items()}
        seen.append(specimen.predict({**MODULI, **values}).displacement)
    np.testing.assert_allclose(seen[0], seen[1], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("effect", [*EFFECTS, *fields().values()], ids=lambda e: e.id)
def test_its_hooks_change_nothing_at_the_null(effect: Effect, specimen: VirtualTest) -> None:
    """The model leaves out effects at their null: here the hooks are asked themselves."""
    own = own_values(effect, {}, specimen.nulls())
    unit = specimen.mesh.nodes / 100.0
    np.testing.assert_allclose(effect.outline(own, unit), unit, rtol=0.0, atol=1e-15)
    assert not effect.height(own, unit).any()
    cloth = Cloth(**MODULI, nu12=specimen.test.poisson_ratio, points=np.zeros((1, 4, 2)))
    changed = effect.material(own, cloth)
    for name in (
        "E1",
        "E2",
        "G12",
        "nu12",
        "angle",
        "slack",
        "gain",
        "bend",
        "knee",
        "curve",
        "thickness",
    ):
        assert getattr(changed, name) == getattr(cloth, name), name
    load = Load(specimen.recorded, specimen.clock, specimen.recorded)
    np.testing.assert_array_equal(effect.load(own, load).balanced, load.balanced)
    clamping = Clamping(np.linspace(0.0, 6.0, 24), specimen.recorded)
    held = effect.clamp(own, clamping)
    assert held.compliance is None
    assert held.lift is None
    seen = specimen.test.blocks[0].reference[:, :2]
    np.testing.assert_array_equal(effect.locate(own, seen, 100.0), seen)
    assert effect.centre(own) == (0.0, 0.0)
    assert effect.window(own) == 0.0
    reference = np.asarray(specimen.test.blocks[0].reference)
    highest = float(specimen.recorded.max())
    scene = Scene(reference, seen, reference, specimen.recorded, highest, 100.0)
    moved = np.random.default_rng(0).normal(size=(3, len(reference), 3))
    np.testing.assert_array_equal(effect.see(own, scene, moved), moved)
    np.testing.assert_array_equal(effect.see_height(own, moved[0, :, 2]), moved[0, :, 2])
    for of_frame in effect.motion(own, scene):
        assert not of_frame.any()


# derivatives


def state(seed: int, specimen: VirtualTest) -> dict[str, float]:
    """Every parameter off its null by a tenth to a quarter of its prior, drawn from a seed."""
    rng = np.random.default_rng(seed)
    out = dict(MODULI)
    for effect in EFFECTS:
        for p in effect.parameters:
            null = specimen.nulls().get(f"{effect.id}.{p.name}", p.null)
            size = rng.uniform(0.1, 0.25) * (-1.0 if rng.random() < 0.5 else 1.0) * p.prior
            size = abs(size) if null == p.lower else size
            out[f"{effect.id}.{p.name}"] = float(np.clip(null + size, p.lower, p.upper))
    # a window of a micrometre's square is nothing to take a difference about
    out["dic_smoothing.window"] = float(rng.uniform(3.0, 5.0))
    return out


@pytest.fixture(scope="module", params=[1, 2], ids=["first state", "second state"])
def exact(
    request: pytest.FixtureRequest, specimen: VirtualTest
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """A state with every effect on, and the derivative by every parameter there."""
    values = state(request.param, specimen)
    found = specimen.predict(values, list(values))
    return values, dict(zip(values, found.derivative, strict=True))


#: Part of the largest derivative by which it may miss the difference, where that is above 1e-5.
TOLERANCES = {
    # the neighbours of the splines change on the way, and the field jumps by less than a micrometre
    "registration": 2e-4,
    # what a window averages turns where it touches the rim: differences miss by how near that is
    "dic_smoothing": 5e-4,
    "dic_scale": 1e-4,
    "clamp_shape": 1e-4,
    "clamp_lobes": 1e-4,
    "lens_distortion": 1e-4,
    # together with a slipping rim: its balance under follower pressure has no symmetric tangent
    "rim_lift": 1e-3,
}


def ends_of(name: str, value: float) -> tuple[tuple[float, float], float]:
    """Values about one, a step of another size than the model's apart, and what they span."""
    if name in MODULI:
        step = 1e-3 * value
    else:
        effect, _, parameter = name.partition(".")
        p = effect_named(effect).parameter(parameter)
        if p.coordinate == "square":
            return (math.sqrt(value**2 - 3e-3), math.sqrt(value**2 + 3e-3)), 6e-3
        # where the parameter is steep, as the knee is, a part of itself
        step = 3.0 * p.step if p.step < 1e-2 * p.prior else 1e-3 * p.prior
        if effect == "clamp_slip":
            step = 3e-3 * value
    return (value - step, value + step), 2.0 * step


@pytest.mark.parametrize("name", ["E1", "E2", "G12", *(n for e in EFFECTS for n in e.names)])
def test_derivative_is_that_of_differences(
    name: str,
    specimen: VirtualTest,
    exact: tuple[dict[str, float], dict[str, np.ndarray]],
    near: dict[int, object],
) -> None:
    values, derivatives = exact
    shapes = near.setdefault(id(values), specimen.shapes(values))
    (low, high), span = ends_of(name, values[name])
    below, above = (
        specimen.predict({**values, name: v}, near=shapes).displacement  # type: ignore[arg-type]
        for v in (low, high)
    )
    difference = (above - below) / span
    size = np.abs(difference).max()
    assert size > 0
    miss = np.abs(derivatives[name] - difference).max(axis=(0, 2)) / size
    assert miss.max() < TOLERANCES.get(name.partition(".")[0], 1e-5)


#: Of the cameras' effects, those that leave the points where they are.
SEEING = [e for e in EFFECTS if e.uses("see", "motion") and not e.uses("locate")]


@pytest.mark.parametrize("effect", SEEING, ids=lambda e: e.id)
def test_derivative_of_an_absent_effect_goes_through_those_that_see_after_it(
    effect: Effect, specimen: VirtualTest, exact: tuple[dict[str, float], object]
) -> None:
    """The others being on; shapes are as they were."""
    nulls = nulls_of(effect, specimen)
    values = {name: v for name, v in exact[0].items() if name not in nulls}
    names = [n for n in nulls if not effect.parameter(n.partition(".")[2]).begins_at_null]
    shapes = specimen.shapes(values)
    found = specimen.observe(shapes, names).derivative
    for name, derivative in zip(names, found, strict=True):
        step = 3.0 * effect.parameter(name.partition(".")[2]).step
        below, above = (
            specimen.observe(replace(shapes, values={**shapes.values, name: v})).displacement
            for v in (nulls[name] - step, nulls[name] + step)
        )
        difference = (above - below) / (2.0 * step)
        size = np.abs(difference).max()
        assert size > 0
        tolerance = TOLERANCES.get(effect.id, 1e-5)
        np.testing.assert_allclose(derivative, difference, rtol=0, atol=tolerance * size)


@pytest.fixture(scope="module")
def near() -> dict[int, object]:
    """Shapes of the states, to start from."""
    return {}


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_coordinates_go_there_and_back(effect: Effect) -> None:
    """And beyond them lies no stiffness that is nothing: the logarithm of what multiplies one."""
    for p in effect.parameters:
        for value in np.linspace(p.lower, p.upper, 7)[1:-1]:
            at = p.to_coordinate(value)
            assert p.from_coordinate(at) == pytest.approx(value, rel=1e-12, abs=1e-15)
            if p.coordinate == "log":
                slope = (p.from_coordinate(at + 1e-5) - p.from_coordinate(at - 1e-5)) / 2e-5
                assert p.slope(value) == pytest.approx(slope, rel=1e-8)
        if p.origin is not None:
            assert p.from_coordinate(-40.0) == pytest.approx(p.origin, abs=1e-15)
