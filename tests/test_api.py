"""Do the public functions take what their users mean, and refuse the rest in one line?"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import bulgefit
from bulgefit.errors import InputError

EXAMPLE = Path(__file__).parents[1] / "data" / "example_bulge.npz"
MODULI = {"E1": 330, "E2": 240, "G12": 30}


@pytest.fixture(scope="module")
def test():
    return bulgefit.read_test(EXAMPLE).select(frames=slice(None, None, 7), points=None)


#: Public functions of one argument that is a test, or tests.
OF_TESTS = {
    "fit": lambda given: bulgefit.fit(given),
    "evaluate": lambda given: bulgefit.evaluate(given, MODULI),
    "predict": lambda given: bulgefit.predict(given, MODULI),
    "crossval": lambda given: bulgefit.crossval(given),
    "diagnose": lambda given: bulgefit.diagnose(given),
    "measure": lambda given: bulgefit.measure(given),
    "show": lambda given: bulgefit.show(given),
}
NO_TESTS = (None, 3, 2.5, b"x.npz", object(), {"E1": 1}, np.zeros((3, 3)), "missing.npz", [None])


@pytest.mark.parametrize("given", NO_TESTS, ids=lambda given: type(given).__name__)
@pytest.mark.parametrize("name", OF_TESTS)
def test_what_is_no_test(name, given):
    with pytest.raises(InputError) as caught:
        OF_TESTS[name](given)
    assert len(str(caught.value).splitlines()) == 1


#: Functions of something else, with what they take beside it.
OF_OTHERS = {
    "batch_of": lambda given: bulgefit.batch_of(given),
    "batch_of several": lambda given: bulgefit.batch_of([given]),
    "plot": lambda given: bulgefit.plot(given),
    "plot_apex": lambda given: bulgefit.plot_apex(given),
    "plot_fields": lambda given: bulgefit.plot_fields(given, given, given, "none.png"),
    "plot_folds": lambda given: bulgefit.plot_folds(given),
    "plot_measured": lambda given: bulgefit.plot_measured(given),
    "plot_profiles": lambda given: bulgefit.plot_profiles(given, ()),
    "plot_residuals": lambda given: bulgefit.plot_residuals(given, ()),
    "plot_rings": lambda given: bulgefit.plot_rings(given),
    "plot_spreads": lambda given: bulgefit.plot_spreads(given),
    "material": lambda given: bulgefit.material(given, E=300.0, nu=0.2),
    "read_test": lambda given: bulgefit.read_test(given),
    "write_paraview": lambda given: bulgefit.write_paraview(given, "none.pvd"),
    "write_test": lambda given: bulgefit.write_test(given, "none.npz"),
    "write_test_paraview": lambda given: bulgefit.write_test_paraview(given, "none.pvd"),
}


@pytest.mark.parametrize("given", NO_TESTS, ids=lambda given: type(given).__name__)
@pytest.mark.parametrize("name", OF_OTHERS)
def test_what_is_of_another_kind(name, given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        OF_OTHERS[name](given)
    assert len(str(caught.value).splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "path", [None, 3, b"x.npz", [], object()], ids=lambda path: type(path).__name__
)
def test_what_names_no_file(path, test):
    for write in (bulgefit.write_test, bulgefit.write_test_paraview, bulgefit.animate):
        with pytest.raises(InputError, match="name of a file is needed, not"):
            write(test, path)
    if path is not None:  # which is no file on purpose
        with pytest.raises(InputError, match="name of a file is needed, not"):
            bulgefit.show(test, path)
        with pytest.raises(InputError, match="name of a file is needed, not"):
            bulgefit.plot_profiles(test, tuple(b.displacement for b in test.blocks), path)


@pytest.mark.parametrize(
    "given", [3, object(), ((1.0, 2.0),)], ids=lambda given: type(given).__name__
)
def test_what_is_no_prediction(given, test):
    for draw in (bulgefit.plot_profiles, bulgefit.plot_residuals):
        with pytest.raises(InputError):
            draw(test, given)


def test_arrays_of_no_mesh():
    nodes, cells = np.zeros((4, 2)), np.arange(4)[None]
    for wrong in (
        (nodes, cells, np.zeros((4, 2))), (nodes, cells + 1, np.zeros((4, 3))),
        (nodes, cells[:0], np.zeros((4, 3))), (nodes[:, :1], cells, np.zeros((4, 3))),
    ):  # fmt: skip
        with pytest.raises(InputError):
            bulgefit.plot_fields(*wrong, "none.png")


WRONG_MATERIALS = (
    None, "E1", 300, ["E1", 300], {}, {"E1": 300}, {"E1": "stiff", "E2": 240, "G12": 30},
    {"E1": None, "E2": 240, "G12": 30}, {"E1": True, "E2": 240, "G12": 30}, {1: 300},
    {"E": 300, "E9": 3}, {"E1": float("nan"), "E2": 240, "G12": 30},
    {"E1": -5, "E2": 240, "G12": 30},
)  # fmt: skip


@pytest.mark.parametrize("given", WRONG_MATERIALS, ids=str)
@pytest.mark.parametrize("name", ["evaluate", "predict", "simulate"])
def test_what_is_no_material(name, given, test):
    function = getattr(bulgefit, name)
    with pytest.raises(InputError):
        function(given, [0.1]) if name == "simulate" else function(test, given)


WRONG_EFFECTS = (
    "clamp_slip", ["clamp_slip"], {"clamp_slip.compliance": "x"}, {"clamp_slip": 0.1}, {3: 4},
    {"creep.speed": 1.0},
)  # fmt: skip


@pytest.mark.parametrize("effects", WRONG_EFFECTS, ids=str)
@pytest.mark.parametrize("name", ["evaluate", "predict", "simulate"])
def test_what_is_no_effect(name, effects, test):
    what = ({**MODULI, "nu12": 0.24}, [0.1]) if name == "simulate" else (test, MODULI)
    with pytest.raises(InputError):
        getattr(bulgefit, name)(*what, effects=effects)


@pytest.mark.parametrize(
    "options",
    [
        {"objective": 3},
        {"objective": "mse"},
        {"material": "wood"},
        {"material": 5},
        {"bounds": "E1"},
        {"bounds": 5},
        {"bounds": {"E1": 5}},
        {"bounds": {"E1": "ab"}},
        {"held": "nu12"},
        {"held": {"nu12": "x"}},
        {"free": 5},
        {"free": "nu13"},
        {"effects": 5},
        {"effects": "slip"},
        {"priors": {"E1": 3}},
        {"uncertainty": "thickness"},
        {"weight": "much"},
        {"average": "medians"},
        {"setup": "fine"},
        {"starts": "many"},
        {"starts": 0},
        {"seed": "x"},
        {"method": 7},
        {"method": "guess"},
        {"limits": 5},
        {"options": "quick"},
        {"boundaries": {}},
    ],
    ids=str,
)
def test_what_is_no_option(options, test):
    with pytest.raises(InputError):
        bulgefit.fit(test, **options)


@pytest.mark.parametrize("pressure", ["much", None, [], [[0.1]], [0.0], [np.nan], {"a": 1}])
def test_what_is_no_pressure(pressure):
    with pytest.raises(InputError):
        bulgefit.simulate({**MODULI, "nu12": 0.24}, pressure)


@pytest.mark.parametrize("effects", ["slip", 5, ["slip"], [5]])
def test_what_is_no_candidate(effects, test):
    with pytest.raises(InputError):
        bulgefit.diagnose(test, effects=effects)


def test_paths_stand_for_their_tests():
    moduli = {**MODULI, "nu12": 0.24}
    test = bulgefit.read_test(EXAMPLE)
    by_path = bulgefit.evaluate(str(EXAMPLE), moduli)
    assert by_path["e_w"] == bulgefit.evaluate([test], moduli)["e_w"]
    assert by_path["sources"][0]["sha256"] == test.checksum


def test_representations_are_short(test):
    for shown in (test, bulgefit.measure(test, window=40.0), bulgefit.predict(test, MODULI)):
        assert len(repr(shown)) < 400
        assert "array" not in repr(shown)
    assert "<pre>BulgeTest(&#x27;example_bulge&#x27;: 3 frames" in test._repr_html_()


def test_tables_for_pandas_and_xarray(test):
    pytest.importorskip("pandas")
    table = test.to_dataframe()
    assert len(table) == test.n_measured
    last = table[table.frame == 2]
    np.testing.assert_array_equal(last.dz_mm, test.frame(2)[1][:, 2])
    apex = bulgefit.measure(test, window=40.0).to_dataframe()
    assert apex.pressure_bar.tolist() == pytest.approx((10 * test.pressure).tolist())
    assert (apex.stress_MPa > 0).all()
    pytest.importorskip("xarray")
    array = test.to_xarray()
    assert array.dims == ("frame", "point", "component")
    assert array.attrs["units"] == "mm"
    seen = array.sel(frame=1, component="dz").to_numpy()
    np.testing.assert_array_equal(seen, test.blocks[0].displacement[1, :, 2])


def test_the_page_of_what_is_public_has_all_of_it():
    page = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    told = re.findall(r"^\.\. auto\w+:: bulgefit\.(\w+)$", page, flags=re.MULTILINE)
    assert sorted(told) == sorted(bulgefit.__all__)
    assert all(getattr(bulgefit, name).__doc__ for name in told)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bulgefit.read_test(EXAMPLE, radius="a"), "radius: give a number, not 'a'"),
        (lambda: bulgefit.read_test(EXAMPLE, warp_angle=True), "warp_angle: give a number"),
        (lambda: bulgefit.read_test(EXAMPLE, at_rest=1.5), "at_rest: give a whole number"),
        (lambda: bulgefit.read_test(EXAMPLE, semi_axes=3), "semi_axes: give two lengths"),
        (lambda: bulgefit.read_test(EXAMPLE, semi_axes=(1, "b")), "semi_axes along y: give a num"),
        (lambda: bulgefit.fit(EXAMPLE, workers=0), "workers: give a whole number of 1 or more"),
        (lambda: bulgefit.diagnose(EXAMPLE, workers=-1), "workers: give a whole number"),
        (lambda: bulgefit.diagnose(EXAMPLE, priors={"E1": 3}), r"prior of E1: give a Prior\(mean"),
    ],
)
def test_options_that_cannot_be(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_missing_extras_are_named(test, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(InputError, match=r"pip install \"bulgefit\[pandas\]\""):
        test.to_dataframe()


def test_slack_cloth_is_simulated_between_the_levels_of_its_path() -> None:
    """Folds come and go there: no step along the path led to its shape at 0.1 bar."""
    slack = {"prestrain.slack_x": 0.008, "prestrain.slack_y": 0.02}
    moduli = {"E1": 800.0, "E2": 3600.0, "G12": 35.0, "nu12": 0.25}
    shapes = bulgefit.simulate(moduli, [0.002, 0.01, 0.025], effects=slack, correct_mesh=False)
    assert shapes.stable
    assert (np.diff(shapes.apex) > 0.0).all()
    assert 11.0 < shapes.apex[0] < shapes.apex[-1] < 17.0
