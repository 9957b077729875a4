"""Does what was typed, or edited by hand, get an answer that says what to do?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import read_test

EXAMPLE = Path(__file__).parents[2] / "data" / "example_slip.npz"
MODULI = ["--E1", "330", "--E2", "240", "--G12", "30"]
BOM = "\ufeff"
#: Of a fit, by hand.
FIT: dict[str, Any] = {
    "format": 2,
    "starts": [],
    "material": "orthotropic",
    "settings": {"law": "hencky"},
    "parameters": {
        "E1": {"value": 330.0, "unit": "MPa"},
        "E2": {"value": 240.0, "unit": "MPa"},
        "G12": {"value": 30.0, "unit": "MPa"},
        "nu12": {"value": 0.24, "unit": "1"},
    },
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The line of an error."""
    assert main([*words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["info", "x", "--presure", "p"], "--presure p; did you mean --pressure?"),
        (["info", "x.csv", "y.csv"], "y.csv; quote a pattern that names the frames of one test"),
        (["fti", "x"], "unknown verb 'fti'; did you mean fit?"),
        (["simulate", "--thickness", "0,81"], "'0,81' is no number, whose decimal sign is a point"),
        (["fit", "x", "--starts", "1.5"], "argument --starts: '1.5' is no whole number"),
        (["fit", "x", "--config", "a", "--config", "b"], "2 files are named; put their options"),
        (["convert", "", "o.npz"], "the name of a test is empty"),
        (["evaluate", str(EXAMPLE), *MODULI, "--json", ""], "a file to write is empty"),
        (["evaluate", str(EXAMPLE), *MODULI, "--json", "o.npz"], "o.npz: is named as a test is"),
        (["report", ""], "the name of the JSON is empty"),
    ],
)  # fmt: skip
def test_words(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said in answer(capsys, *words)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# bulgefit simulate, version 1\nE1 = 3\n", "the file was written by bulgefit simulate"),
        ("[fit]\nstarts = 3\n", "fit is no option of bulgefit fit; the file has options alone"),
        ("strats = 3\n", "did you mean starts?"),
        ("zzzz = 3\n", "zzzz is no option of bulgefit fit; see bulgefit fit --help"),
        (BOM + 'starts = "three"\n', "starts: 'three' is no whole number"),
    ],
)
def test_options_of_a_file(text: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("c.toml").write_text(text, encoding="utf-8")
    assert said in answer(capsys, "fit", "x", "--config", "c.toml")


def edited(**parameters: Any) -> dict[str, Any]:
    return FIT | {"parameters": FIT["parameters"] | parameters}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (FIT | {"format": 99}, "its layout (format) is 99"),
        (edited(E1={"value": 0.33, "unit": "GPa"}), "parameters.E1 is in 'GPa'; give it in 'MPa'"),
        (edited(E1={"value": "330"}), "parameters.E1.value is '330'; a number is needed, MPa"),
        (edited(E1={"value": None}), "parameters.E1.value is None; a number is needed, MPa"),
        (edited(E1=330), "parameters.E1 is 330; a number is needed, MPa"),
        (edited(E7={"value": 1.0}), "E7 is no parameter of a material"),
        (
            edited(**{"clamp_slip.compliance": {"value": 1, "unit": "m"}}),
            "clamp_slip.compliance is in 'm'; give it in 'mm per N/mm'",
        ),
        ({k: v for k, v in FIT.items() if k != "parameters"}, "it has no 'parameters'"),
    ],
)
def test_json_that_was_edited(
    content: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("f.json").write_text(json.dumps(content))
    assert said in answer(capsys, "simulate", "--from", "f.json", "--pressure", "1")


def test_json_with_a_byte_order_mark(capsys: pytest.CaptureFixture[str]) -> None:
    Path("f.json").write_text(BOM + json.dumps(FIT), encoding="utf-8")
    assert main(["simulate", "--from", "f.json", "--pressure", "1", "--refine", "1"]) == 0
    assert "E1 = 330 MPa" in capsys.readouterr().out
    assert "damaged, not as bulgefit fit writes it (it has no" in answer(capsys, "report", "f.json")


def test_what_of_a_diagnosis_is_not_taken(capsys: pytest.CaptureFixture[str]) -> None:
    cause = {"effect": "clamp_slip", "probability": 0.6}
    moduli = {name: FIT["parameters"][name] for name in ("E1", "E2", "G12")}
    gap = {
        "causes": [cause | {"parameters": {"compliance": {"value": 0.01, "unit": "mm per N/mm"}}}],
        "fields": [{"field": "law_curve"}, {"field": "slip_field"}, {"field": "slip_field"}],
        "parameters": {"corrected": moduli},
    }
    Path("g.json").write_text(json.dumps(gap))
    assert main(["simulate", "--from", "g.json", "--pressure", "1", "--refine", "1"]) == 0
    said = capsys.readouterr()
    assert "with clamp_slip: compliance = 0.01" in said.out
    assert "not sure are its causes clamp_slip; they are taken" in said.err
    assert "fields are not taken (law_curve, slip_field)" in said.err


def test_lengths_of_csv_frames_in_the_unit_of_their_header() -> None:
    test = read_test(EXAMPLE)
    points, moved = test.frame(10)
    head = ",".join(f"{name} [{unit}]" for name, unit in NAMES)
    rows = np.hstack([points, moved]) * [1e-3, 1e-3, 1e-3, 1e-1, 1e-1, 1]
    Path("a.csv").write_text("\n".join([head, *(",".join(map(repr, r)) for r in rows.tolist())]))
    Path("pressure.csv").write_text("file,pressure_bar\na.csv,1\n")
    named = {name: f"{name} [{unit}]" for name, unit in NAMES}
    found = read_test(".", columns=named, radius=100, thickness=0.81).frame(0)
    np.testing.assert_allclose(found[0], points, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found[1], moved, rtol=1e-5, atol=1e-5)


NAMES = (("x", "m"), ("y", "m"), ("z", "m"), ("dx", "cm"), ("dy", "cm"), ("dz", "mm"))


def test_what_convert_writes_is_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["convert", str(EXAMPLE), "o.npz", "--from-positions"]) == 0
    assert "warning: example_slip: dx changes by -1.00 mm per mm" in capsys.readouterr().err


def test_bounds_in_another_unit(capsys: pytest.CaptureFixture[str]) -> None:
    bounds = "E1=0.2:0.5,E2=0.15:0.4,G12=0.01:0.06"
    assert main(["fit", str(EXAMPLE), "--bounds", bounds, "--starts", "1", "--refine", "1"]) == 2
    said = capsys.readouterr().err
    assert "warning: --bounds: E1 t is 0.405 N/mm, which no fabric has" in said


def test_a_test_that_is_left_out_has_nothing_of_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = Path("other.npz")
    assert main(["convert", str(EXAMPLE), str(other), "--rotate", "180"]) == 0
    words = ["--with", "clamp_slip", "--starts", "1", "--refine", "1", "--json", "-"]
    assert main(["crossval", str(EXAMPLE), str(other), *words]) == 0
    said = capsys.readouterr()
    assert "each test has its own clamp_slip: the test left out is judged without" in said.err
    assert [one["name"] for one in json.loads(said.out)["sources"]] == ["example_slip", "other"]
