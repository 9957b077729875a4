"""Does what is told of a measurement stand beside the same of its model, as a file names it?"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bulgefit
from bulgefit.cli.main import main
from bulgefit.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"
MODULI = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
WINDOW = ("--window", "40", "--quiet")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Three frames of the example, which was made with these moduli and noise."""
    path = tmp_path_factory.mktemp("beside") / "t.npz"
    bulgefit.write_test(bulgefit.read_test(EXAMPLE).select(frames=slice(None, None, 7)), path)
    return path


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """What a fit writes, as far as a model follows from it."""
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    values = {**MODULI, "nu12": 0.24, "clamp_slip.compliance": 0.01}
    told = {
        "starts": [], "material": "orthotropic", "settings": {"law": "svk"},
        "parameters": {name: {"value": value} for name, value in values.items()},
    }  # fmt: skip
    path.write_text(json.dumps(told))
    return path


def options(**moduli):
    return [word for name, value in moduli.items() for word in (f"--{name}", str(value))]


def test_a_model_of_the_truth_differs_by_noise(file, tmp_path, capsys):
    out = tmp_path / "m.json"
    words = ["--csv", str(tmp_path / "tables"), "--plots", str(tmp_path / "figures")]
    words += [*options(**MODULI), "--json", str(out)]
    assert main(["measure", str(file), *WINDOW, *words]) == 0
    told = json.loads(out.read_text())
    assert told["model"].keys() == {"apex", "rings", "rim"}
    for column in ("strain_xx_1", "strain_yy_1"):
        off = np.subtract(told["apex"][column], told["model"]["apex"][column])
        assert (np.abs(off) < 4 * np.array(told["apex"][f"{column[:-2]}_noise_1"])).all(), column
    assert not any("noise" in name for name in told["model"]["apex"])
    tables = {path.stem for path in (tmp_path / "tables").iterdir()}
    assert tables == {"apex", "rings", "fields", "rim"} | {
        "model_apex", "model_rings", "model_fields", "model_rim",
    }  # fmt: skip
    figures = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert figures == {"apex", "rings", "fields", "model_fields"}
    stiffer = tmp_path / "s.json"
    stiff = options(**{**MODULI, "E1": 400.0})
    assert main(["measure", str(file), *WINDOW, *stiff, "--json", str(stiffer)]) == 0
    told = json.loads(stiffer.read_text())
    off = np.subtract(told["apex"]["strain_xx_1"], told["model"]["apex"]["strain_xx_1"])
    assert (off > 10 * np.array(told["apex"]["strain_xx_noise_1"])).all()
    assert "at the apex of the model" in capsys.readouterr().out


def test_figures_hold_both(file):
    found = bulgefit.measure(file, window=40.0)
    predicted = bulgefit.predict(file, MODULI)
    model = bulgefit.measure(predicted.as_test(), window=40.0)
    left, right = found.plot("apex", model=model).axes
    (along_x, _) = (line for line in left.lines if line.get_linestyle() == "-")
    order = np.argsort(model.pressure)
    np.testing.assert_allclose(along_x.get_xdata(), 100 * model.apex.strain[order, 0, 0])
    assert "model (lines)" in right.figure.get_suptitle()
    assert len(found.plot("rings", model=model).axes) == 4
    with pytest.raises(InputError, match="another window"):
        found.plot("apex", model=bulgefit.measure(predicted.as_test(), window=45.0))


def test_the_test_of_a_model_lacks_what_was_not_measured(file):
    test = bulgefit.read_test(file)
    block = test.blocks[0]
    moved = block.displacement.copy()
    moved[1, 5] = np.nan
    moved[2, 7, 0] = np.nan
    holed = bulgefit.BulgeTest.from_arrays(block.reference, moved, test.pressure)
    predicted = bulgefit.predict(holed, MODULI)
    made = predicted.as_test().blocks[0].displacement
    np.testing.assert_array_equal(np.isnan(made), np.isnan(moved))
    known = np.isfinite(moved)
    np.testing.assert_array_equal(made[known], predicted.displacement[known])


def test_a_model_from_a_fit(file, fitted, tmp_path, capsys):
    """Its moduli, Poisson's ratio, effects and law."""
    out = tmp_path / "m.json"
    assert main(["measure", str(file), *WINDOW, "--from", str(fitted), "--json", str(out)]) == 0
    told = json.loads(out.read_text())["model"]["apex"]
    predicted = bulgefit.predict(
        file,
        {**MODULI, "nu12": 0.24},
        effects={"clamp_slip.compliance": 0.01},
        setup=bulgefit.Setup(law="svk"),
    )
    same = bulgefit.measure(predicted.as_test(), window=40.0).tables()["apex"]
    np.testing.assert_allclose(told["strain_xx_1"], same["strain_xx_1"])
    capsys.readouterr()
    assert main(["evaluate", str(file), "--from", str(fitted), "--json", "-", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["parameters"] == {**MODULI, "nu12": 0.24}
    assert told["effects"] == {"clamp_slip.compliance": 0.01}


def test_what_a_diagnosis_held_is_held_as_well(file, tmp_path, capsys):
    path = tmp_path / "gap.json"
    moduli = {name: {"value": value} for name, value in MODULI.items()}
    told = {
        "causes": [{"effect": "clamp_slip", "parameters": {"compliance": {"value": 0.01}}}],
        "held": {"surface_offset.share": 0.5},
        "parameters": {"corrected": moduli},
    }
    path.write_text(json.dumps(told))
    assert main(["evaluate", str(file), "--from", str(path), "--json", "-", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)["effects"]
    assert found == {"clamp_slip.compliance": 0.01, "surface_offset.share": 0.5}


def test_an_isotropic_fit(file, tmp_path, capsys):
    path = tmp_path / "fit.json"
    values = {"E": 300.0, "G": 120.0, "nu": 0.25}
    told = {
        "starts": [], "material": "isotropic-EG",
        "parameters": {name: {"value": value} for name, value in values.items()},
    }  # fmt: skip
    path.write_text(json.dumps(told))
    assert main(["evaluate", str(file), "--from", str(path), "--json", "-", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert (found["E"], found["G"]) == (300.0, 120.0)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"folds": []}, "no JSON of bulgefit diagnose or fit"),
        ({"starts": [], "parameters": []}, "has no 'material'"),
        (
            {"starts": [], "parameters": {"E1": 3}, "material": "orthotropic"},
            "parameters.E1 is 3; a number is needed, MPa",
        ),
    ],
)
def test_what_is_no_fit(file, tmp_path, capsys, told, message):
    path = tmp_path / "x.json"
    path.write_text(json.dumps(told))
    assert main(["measure", str(file), *WINDOW, "--from", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
