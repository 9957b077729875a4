"""Does every result draw itself, by what it knows, and refuse in a line what it has not?"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import bulgefit
from bulgefit.errors import InputError
from bulgefit.fitting.answers import CrossValidation
from bulgefit.fitting.bootstrap import Bootstrap
from bulgefit.gap.residual.locate import Growth
from bulgefit.report.words.names import mode_label
from bulgefit.shown import Drawn
from bulgefit.trial.answer import TrialAnswer
from bulgefit.trial.score import score

MODULI = {"E1": 330.0, "E2": 230.0, "G12": 40.0}
OBJECTIVES = {"e": 0.1, "e_w": 0.03, "e_z": None}


@pytest.fixture(scope="module")
def folds():
    """Three folds, as a cross-validation tells them."""
    return CrossValidation(
        objective="e_w", judged_by="e_w", unit="mm", mean=0.03, standard_deviation=0.001,
        folds=[
            {
                "left_out": f"<{i}>", "parameters": {"E1": 300.0 + i, "nu12": 0.24},
                "at_bound": [], "training": {"objective": "e_w", "value": 0.02},
                "left_out_objectives": {**OBJECTIVES, "e_w": 0.03 + 0.001 * i},
            }
            for i in range(3)
        ],
    )  # fmt: skip


@pytest.fixture(scope="module")
def predicted(plate):
    return bulgefit.predict(plate, MODULI)


@pytest.fixture(scope="module")
def evaluation(plate, plain):
    """Of two tests, one that has lost its heights, so that it has no e_z."""
    (block,) = plain.blocks
    seen = np.where([True, True, False], block.displacement, np.nan)
    flat = replace(plain, blocks=(replace(block, displacement=seen),))
    return bulgefit.evaluate([plate, flat], MODULI)


@pytest.fixture(scope="module")
def batch(fit_found):
    """Of two specimens; one does not tell G12."""
    silent = replace(
        fit_found,
        uncertainty=replace(
            fit_found.uncertainty, stderr={**fit_found.uncertainty.stderr, "G12": None}
        ),
    )
    return bulgefit.batch_of([fit_found, silent])


@pytest.fixture(scope="module")
def simulated():
    return bulgefit.simulate({**MODULI, "nu12": 0.24}, [0.2, 0.1], refine=2)


@pytest.fixture(scope="module")
def refits(fit_found):
    """As a bootstrap tells them."""
    rng = np.random.default_rng(4)
    values = rng.normal(100.0, 1.0, (50, len(fit_found.free)))
    return Bootstrap(fit_found.free, values, failures=0, level=0.9, block=1, seed=0)


@pytest.fixture(scope="module")
def measured(plate):
    return bulgefit.measure(plate, window=30.0)


#: Kinds of each fixture's result, and what they need.
KINDS = {
    "fit_found": ("parameters",),
    "plate": ("profiles",),
    "folds": ("folds",),
    "evaluation": ("objectives",),
    "batch": ("parameters",),
    "refits": ("parameters",),
    "simulated": ("shapes",),
    "predicted": ("profiles", "residuals"),
    "measured": ("apex", "rings", "fields"),
    "trial_answer": ("shares", "sizes", "reliability"),
    "found": ("budget", "cosines", "where", "modes", "signatures", "dx", "dy", "dz"),
}


@pytest.mark.parametrize("of", KINDS)
def test_each_kind_is_a_figure_of_its_own(of, request, tmp_path):
    result = request.getfixturevalue(of)
    assert isinstance(result, Drawn)
    files = set()
    for kind in KINDS[of]:
        path = tmp_path / f"{kind}.png"
        figure = result.plot(kind, path=path)
        assert isinstance(figure, Figure)
        files.add(path.read_bytes())
    assert len(files) == len(KINDS[of])
    first = result.plot(path=tmp_path / "first.png")
    assert isinstance(first, Figure)
    assert (tmp_path / "first.png").read_bytes() == (tmp_path / f"{KINDS[of][0]}.png").read_bytes()
    with pytest.raises(InputError, match=r"exists; use --force"):
        result.plot(path=tmp_path / "first.png")
    result.plot(path=tmp_path / "first.png", force=True)
    with pytest.raises(InputError, match=f"choose from {', '.join(KINDS[of])}"):
        result.plot("pie")
    with pytest.raises(InputError, match="takes no colour, but path, force"):
        bulgefit.plot(result, colour="red")


def test_a_fit_beside_a_test(fit_found, plain):
    figure = fit_found.plot("profiles", test=plain)
    assert "e_w fit (lines)" in figure.get_suptitle()
    seen = bulgefit.predict(plain, fit_found.material, setup=fit_found.setup)
    for ours, theirs in zip(figure.axes, seen.plot("profiles").axes, strict=True):
        for a, b in zip(ours.lines, theirs.lines, strict=True):
            np.testing.assert_array_equal(a.get_ydata(), b.get_ydata())
    with pytest.raises(InputError, match="give the one that is to be drawn"):
        fit_found.plot("residuals")


def test_a_batch_says_what_its_marks_are(batch):
    figure = batch.plot()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "value and 95 % interval", "mean over specimens", "one standard deviation",
    ]  # fmt: skip
    told = [[text.get_text() for text in panel.texts] for panel in figure.axes]
    assert told == [[], [], ["not determined"]]
    value, mean = figure.axes[0].lines[0], figure.axes[0].lines[-1]
    fit = batch.fits[0]
    assert value.get_xdata()[1] == fit.material.values["E1"]
    assert [*value.get_xdata()[[0, 2]]] == [*fit.uncertainty.interval95["E1"]]
    assert mean.get_xdata()[0] == batch.spreads["E1"].mean


def test_pairs_are_framed_by_what_their_cells_read(found, monkeypatch):
    alike = np.array([[1.0, 0.897, 0.894], [0.897, 1.0, 0.9], [0.894, 0.9, 1.0]])
    monkeypatch.setattr(
        "bulgefit.report._diagnosis_charts.cosine_matrix", lambda _: (["a", "b", "c"], alike)
    )
    panel = found.plot("cosines").axes[0]
    framed = {(round(p.get_x() + 0.46), round(p.get_y() + 0.46)) for p in panel.patches}
    read = {tuple(map(int, t.get_position())) for t in panel.texts if t.get_text() == "0.90"}
    assert framed == read == {(0, 1), (1, 0), (1, 2), (2, 1)}


def test_legends_of_modes_say_how_they_go_with_pressure():
    labels = [mode_label(2, growth) for growth in (Growth.CUBE_ROOT, Growth.LINEAR, Growth.NONE)]
    assert labels == ["m = 2: p^(1/3)", "m = 2: in proportion to p", "m = 2: within noise"]


def test_folds_stand_where_their_numbers_are(folds):
    first, second, last = folds.plot().axes
    dots, line = first.lines
    assert dots.get_xdata().tolist() == [300.0, 301.0, 302.0]
    assert line.get_xdata()[0] == 301.0
    assert [t.get_text() for t in first.get_yticklabels()] == [f"without <{i}>" for i in range(3)]
    assert (first.get_xlabel(), second.get_xlabel()) == ("E1 (MPa)", "nu12")
    for panel in (first, second, last):
        assert len(panel.get_xticks()) <= 7
    values = [float(v) for line in last.lines for v in line.get_xdata()]
    assert values == pytest.approx([0.02, 0.03, 0.02, 0.031, 0.02, 0.032])
    # a likelihood is no length
    likely = CrossValidation(folds, objective="likelihood")
    values = [float(v) for line in likely.plot().axes[-1].lines for v in line.get_xdata()]
    assert values == pytest.approx([0.03, 0.031, 0.032])


def test_what_is_of_a_test(found):
    before, after = (found.plot("where", after=a).get_suptitle() for a in (False, True))
    assert "moduli alone" in before
    assert "with rigid_motion" in after
    with pytest.raises(InputError, match="no test 1; give 0 to 0"):
        found.plot("dz", test=1)


def test_a_trial_draws_its_shares(trial_answer):
    """One of two found: the interval is Wilson's (1927), by his formula."""
    (panel,) = trial_answer.plot("shares").axes
    words = [label.get_text() for label in panel.get_yticklabels()]
    assert words[0] == "effects named, or in a set of at most two"
    assert [text.get_text() for text in panel.texts][:1] == ["1 of 2"]
    z, n = 1.959963984540054, 2
    half = z / (1 + z**2 / n) * np.sqrt(0.25 / n + z**2 / (4 * n**2))
    interval, dot = panel.lines[:2]
    np.testing.assert_allclose(interval.get_xdata(), [50 - 100 * half, 50 + 100 * half])
    assert dot.get_xdata().tolist() == [50.0]
    # what was stated with 99.9 % is true
    (panel,) = trial_answer.plot("reliability").axes
    assert (panel.lines[-1].get_xdata(), panel.lines[-1].get_ydata()) == ([99.9], [100.0])
    (panel,) = trial_answer.plot("sizes").axes
    noise = np.sqrt(2 * 0.006**2 + 0.013**2)
    assert 3.0 < 0.05 / noise < 10.0
    assert panel.get_yticklabels()[0].get_text() == "3 to 10 times the noise"
    nothing = TrialAnswer({**trial_answer, "scores": score([])})
    for kind in ("shares", "sizes", "reliability"):
        with pytest.raises(InputError, match=f"nothing to draw for '{kind}'"):
            nothing.plot(kind)


@pytest.mark.parametrize("thing", [None, 3, {"E1": 1}, "fit"])
def test_what_has_no_figure(thing):
    with pytest.raises(InputError, match="is no result that has figures"):
        bulgefit.plot(thing)


def test_tables(folds, predicted, plate, found, trial_answer):
    pytest.importorskip("pandas")
    table = folds.to_dataframe()
    assert table.E1.tolist() == [300.0, 301.0, 302.0]
    assert table.loc["<2>", "e_w"] == pytest.approx(0.032)
    beside = predicted.to_dataframe()
    left = plate.blocks[0].displacement - predicted.displacement
    ours = beside.dz_mm - beside.model_dz_mm
    np.testing.assert_array_equal(ours, left[np.isfinite(left).all(axis=2)][:, 2])
    causes = found.to_dataframe()
    assert causes.loc["E1", "value"] == found.to_dict()["parameters"]["corrected"]["E1"]["value"]
    (cause,) = found.causes
    assert causes.loc["rigid_motion.shift_x", "probability"] == cause.probability
    shift = cause.parameters["shift_x"]
    assert causes.loc["rigid_motion.shift_x", "stderr"] == shift["stderr"]
    told = trial_answer.to_dataframe()
    assert told.index.tolist() == ["test_0.npz", "test_1.npz"]
    assert told.right.tolist() == [True, False]
    assert told.loc["test_0.npz", "causes"] == [["clamp_slip"]]
    evaluation = bulgefit.evaluate(plate, MODULI)
    assert evaluation.to_dataframe().loc["plate 1/a", "r_dz"] == evaluation["tests"][0]["dz"]


#: Of each table: what its rows are, and the unit of a column that has one.
TABLES = {
    "fit_found": ("parameter", None),
    "batch": ("specimen", ("G12_stderr", "MPa")),
    "refits": ("refit", ("E1", "MPa")),
    "folds": ("left_out", ("e_w", "mm")),
    "evaluation": ("test", ("r_dz", "mm")),
    "trial_answer": ("file", None),
}


@pytest.mark.parametrize("of", TABLES)
def test_tables_for_xarray_are_those_for_pandas(of, request, tmp_path):
    pytest.importorskip("pandas")
    xarray = pytest.importorskip("xarray")
    result, (each, unit) = request.getfixturevalue(of), TABLES[of]
    table, data = result.to_dataframe(), result.to_xarray()
    assert list(data.data_vars) == list(table.columns)
    assert dict(data.sizes)[each] == len(table)
    for name in table.columns:
        ours = data[name]
        assert ours.dims[0] == each
        if ours.dtype.kind in "fib" and ours.ndim == 1:
            np.testing.assert_array_equal(ours, table[name].astype(float))
    if of != "refits":
        assert data[each].values.tolist() == table.index.tolist()
    if unit is not None:
        assert data[unit[0]].attrs == {"units": unit[1]}
    # a file can hold it
    data.to_netcdf(tmp_path / "table.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "table.nc", engine="scipy") as read:
        xarray.testing.assert_equal(read.load(), data)


def test_what_a_row_lacks(fit_found, batch, evaluation, trial_answer):
    pytest.importorskip("xarray")
    data = fit_found.to_xarray()
    held = data.sel(parameter="nu12")
    assert np.isnan(held.interval95).all()
    assert held.unit == "1"
    low, high = fit_found.uncertainty.interval95["E1"]
    assert data.interval95.sel(parameter="E1").values.tolist() == [low, high]
    assert data.interval95.dims == ("parameter", "end")
    assert np.isfinite(batch.to_xarray().E1).all()
    assert np.isnan(batch.to_xarray().G12).values.tolist() == [False, True]
    assert np.isnan(evaluation.to_xarray().e_z).values.tolist() == [False, True]
    told = TrialAnswer(
        trial_answer, tests=[{**trial_answer["tests"][0], "causes": [["creep"], ["a", "b"]]}]
    ).to_xarray()
    assert told.causes.values.tolist() == ["creep, a or b"]
    assert told.struck.values.tolist() == [""]
    assert told.right.values.tolist() == [True]


def test_every_public_result_shows_itself_in_all_ways():
    results = {
        name for name in bulgefit.__all__
        if isinstance(thing := getattr(bulgefit, name), type) and hasattr(thing, "to_dict")
    }  # fmt: skip
    assert results == {
        "Batch", "Bootstrap", "BulgeTest", "CrossValidation", "Diagnosis", "Evaluation",
        "FitResult", "Measured", "Predicted", "Simulation", "TrialAnswer",
    }  # fmt: skip
    for name in results:
        result = getattr(bulgefit, name)
        assert issubclass(result, Drawn)
        assert "__repr__" in vars(result)
        assert {"plot", "to_dict", "to_dataframe", "to_xarray", "_repr_html_"} <= {*dir(result)}


def test_objectives_stand_where_their_numbers_are(evaluation):
    left, right = evaluation.plot().axes
    assert [label.get_text() for label in left.get_yticklabels()] == [
        "plate 1/a", "plain", "mean over tests",
    ]  # fmt: skip
    first, second = evaluation["tests"]
    assert [line.get_label() for line in left.lines] == ["dx", "dy", "dz"]
    assert left.lines[0].get_xdata().tolist() == [first["dx"], second["dx"]]
    assert left.lines[2].get_xdata().tolist() == [first["dz"]]
    e, _, e_z = right.lines
    assert e.get_xdata().tolist() == [first["e"], second["e"], evaluation["e"]]
    assert e.get_ydata().tolist() == [0, 1, 2]
    assert 1 not in e_z.get_ydata()
    assert e_z.get_xdata()[0] == first["e_z"]


def test_a_test_draws_what_was_measured(plate):
    figure = plate.plot("profiles")
    assert figure.get_suptitle().startswith("plate 1/a: measured\n")
    block = plate.blocks[0]
    on = np.abs(block.reference[:, 1]) < 1.0
    (line, *others) = figure.axes[0].lines
    assert len(others) == 4
    assert line.get_label() == "2.5 bar"
    order = np.argsort(block.reference[on, 0])
    np.testing.assert_array_equal(line.get_ydata(), block.displacement[-1, on, 2][order])


def test_refits_stand_beside_their_interval(refits):
    for panel, values in zip(refits.plot().axes, refits.values.T, strict=True):
        *bars, band = panel.patches
        assert sum(bar.get_height() for bar in bars) == len(values)
        ends = [band.get_x(), band.get_x() + band.get_width()]
        np.testing.assert_allclose(ends, np.quantile(values, [0.05, 0.95]))
    pytest.importorskip("pandas")
    np.testing.assert_array_equal(refits.to_dataframe().to_numpy(), refits.values)


def test_shapes_rise_with_pressure(simulated):
    left, right = simulated.plot().axes
    np.testing.assert_array_equal(left.lines[0].get_xdata(), [1.0, 2.0])
    np.testing.assert_array_equal(left.lines[0].get_ydata(), simulated.apex[::-1])
    for line, index in zip(right.lines, (1, 0), strict=True):
        assert line.get_xdata()[[0, -1]] == pytest.approx([-100.0, 100.0])
        assert line.get_ydata().max() == pytest.approx(simulated.apex[index])
        # at the clamp stands what is left of the mesh's error
        assert abs(line.get_ydata()[[0, -1]]).max() < simulated.mesh_error
    assert json.loads(json.dumps(simulated.to_dict()))["apex_mm"] == simulated.apex.tolist()
    assert simulated._repr_html_().startswith("<pre>Simulation(2 shapes")


def test_shapes_stand_where_the_opening_is():
    wide = {"clamp_shape.radius_error": 0.1}
    made = bulgefit.simulate({**MODULI, "nu12": 0.24}, [0.1], refine=2, effects=wide)
    (line,) = made.plot().axes[1].lines
    assert line.get_xdata()[[0, -1]] == pytest.approx([-110.0, 110.0])


def test_fields_for_xarray(simulated, predicted, measured, found):
    pytest.importorskip("xarray")
    shapes = simulated.to_xarray().sel(component="dz")
    np.testing.assert_array_equal(shapes.max("node"), simulated.displacement[..., 2].max(axis=1))
    assert shapes.pressure_bar.values.tolist() == [2.0, 1.0]
    seen = predicted.to_xarray()
    np.testing.assert_array_equal(seen, predicted.displacement)
    assert seen.dims == ("frame", "point", "component")
    assert json.loads(json.dumps(predicted.to_dict()))["stable"] == [True] * len(seen)
    bent = measured.to_xarray("curvature_xx_1_per_mm")
    np.testing.assert_array_equal(bent, measured.surface.curvature[..., 0])
    assert bent.attrs["units"] == "1/mm"
    np.testing.assert_array_equal(measured.to_xarray(), measured.surface.stress)
    with pytest.raises(InputError, match="field 'x_mm' is unknown; choose from strain_xx_1"):
        measured.to_xarray("x_mm")
    left = found.to_xarray()
    (data,) = [p.data for p in found.prepared]
    fit = found.explanation.final.predictions[0].displacement
    expected = np.where(data.used, data.specimen.measured - fit, np.nan)
    np.testing.assert_array_equal(left.sel(model="with causes"), expected)
    spread = np.sqrt((left**2).mean(("frame", "point", "component")))
    assert spread.sel(model="with causes") < 0.2 * spread.sel(model="moduli alone")
    with pytest.raises(InputError, match="no test 1; give 0 to 0"):
        found.to_xarray(1)


def test_text_of_results_is_a_screen_and_escaped(folds, fit_found, plate, trial_answer):
    batch = bulgefit.batch_of([fit_found])
    for result in (folds, fit_found, batch, trial_answer, bulgefit.evaluate(plate, MODULI)):
        assert len(repr(result).splitlines()) < 30
        assert max(len(line) for line in repr(result).splitlines()) < 140
        assert result._repr_html_().startswith("<pre>")
    assert "&lt;1&gt;" in folds._repr_html_()
    assert "0.031" in repr(folds)
    assert f"{fit_found.material.values['E1']:.5g}" in repr(batch)


def test_they_are_json_still(folds, plate, trial_answer):
    for result in (folds, trial_answer):
        assert json.loads(json.dumps(result)) == result == result.to_dict()
    evaluation = bulgefit.evaluate(plate, MODULI)
    assert json.loads(json.dumps(evaluation)) == evaluation
