"""Effects on the command line: --with, --hold, --from, --prior, and what they say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import read_test, write_test

#: E1 352.1, E2 181.4, G12 12.4 MPa, and a clamp that slips by 0.0321 mm per N/mm.
SLIP = str(Path(__file__).resolve().parents[2] / "data" / "example_slip.npz")
TRUTH = {"E1": 352.1, "E2": 181.4, "G12": 12.4, "clamp_slip.compliance": 0.0321}
MODULI = ["--E1", "352.1", "--E2", "181.4", "--G12", "12.4"]
HOLD = ["--hold", "clamp_slip.compliance=0.0321"]
#: As JSON tells moduli.
FOUND = {name: {"value": TRUTH[name]} for name in ("E1", "E2", "G12")}


def told(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """What `--json -` prints."""
    assert main([*words, "--json", "-", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


def test_fit_with_an_effect_finds_it(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "fit", SLIP, "--with", "clamp_slip", "--starts", "1")
    for name, truth in TRUTH.items():
        entry = found["parameters"][name]
        assert abs(entry["value"] - truth) < 4.0 * entry["stderr"], name
        low, high = entry["interval95"]
        assert low < entry["value"] < high
        assert entry["free"]
        assert not entry["at_bound"]
    entry = found["parameters"]["clamp_slip.compliance"]
    assert entry["unit"] == "mm per N/mm"
    assert entry["stderr"] < 0.02 * entry["value"]
    quality = found["quality"]
    keys = {"misfit_over_noise", "explained_share", "structured_share", "mesh_error_mm", "warnings"}
    assert keys <= quality.keys()
    assert quality["misfit_over_noise"] == pytest.approx(1.0, abs=0.1)
    assert quality["structured_share"] < 0.1
    assert quality["explained_share"] > 0.99
    assert max(quality["mesh_error_mm"]) < 0.005
    assert found["format"] == 2
    assert found["settings"]["effects"] == ["clamp_slip"]


def test_without_it_the_fit_says_that_something_is_amiss(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["fit", SLIP, "--starts", "1", "--quiet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("warning: the model is stable up to ")  # so soft a shear
    first = next(line for line in lines if not line.startswith("WARNING"))
    misfit = float(first.split()[1])
    assert first.startswith("misfit ")
    assert "times the noise" in first
    assert "of the measured displacement explained" in first
    assert "1 of 1 starts agree" in first
    assert misfit > 2.0


def test_fit_holds_what_it_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "fit", SLIP, *HOLD, "--starts", "1", "--uncertainty", "thickness=0.02")
    entry = found["parameters"]["clamp_slip.compliance"]
    assert (entry["value"], entry["free"]) == (0.0321, False)
    for name in ("E1", "E2"):
        assert found["parameters"][name]["value"] == pytest.approx(TRUTH[name], rel=3e-3)
        parts = found["parameters"][name]["stderr_parts"]
        assert parts["thickness"] == pytest.approx(0.02 * TRUTH[name], rel=0.05)
    assert found["settings"]["held"] == {"clamp_slip.compliance": 0.0321}


def test_evaluate_and_from_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    without = told(capsys, "evaluate", SLIP, *MODULI)
    held = told(capsys, "evaluate", SLIP, *MODULI, *HOLD)
    assert held["e_w"] < 0.5 * without["e_w"]
    gap = tmp_path / "gap.json"
    causes = [{"effect": "clamp_slip", "parameters": {"compliance": {"value": 0.0321}}}]
    gap.write_text(json.dumps({"causes": causes, "parameters": {"corrected": FOUND}}))
    taken = told(capsys, "evaluate", SLIP, "--from", str(gap))
    assert taken["e_w"] == pytest.approx(held["e_w"], rel=1e-12)
    assert taken["effects"] == {"clamp_slip.compliance": 0.0321}
    # what is held by hand goes before
    other = told(
        capsys, "evaluate", SLIP, "--from", str(gap), "--hold", "clamp_slip.compliance=0.01"
    )
    assert other["effects"] == {"clamp_slip.compliance": 0.01}


def test_what_is_each_tests_own_is_met_by_the_test_not_by_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy, gap = tmp_path / "other.npz", tmp_path / "gap.json"
    write_test(read_test(SLIP).select(frames=range(8)), copy)
    causes = [
        {"effect": "clamp_slip", "parameters": {f"compliance@{place}": {"value": value}}}
        for place, value in enumerate((0.0321, 0.01))
    ]
    found = {"causes": causes, "parameters": {"corrected": FOUND}, "report": {}}

    def taken(tests: list[Any], *files: Any) -> Any:
        gap.write_text(json.dumps(found | {"report": {"tests": tests}}))
        words = ["evaluate", *map(str, files), "--from", str(gap)]
        return told(capsys, *words)["effects"]

    sources = [{"name": t.name, "sha256": t.checksum} for t in map(read_test, (SLIP, copy))]
    by_order = {"clamp_slip.compliance@0": 0.0321, "clamp_slip.compliance@1": 0.01}
    assert taken(sources, SLIP, copy) == by_order
    assert taken(sources, copy, SLIP) == dict(zip(by_order, [0.01, 0.0321], strict=True))
    assert taken(sources, copy) == {"clamp_slip.compliance": 0.01}
    # written anew it is known by its name
    renewed = [{**source, "sha256": "0"} for source in sources]
    assert taken(renewed, copy, SLIP) == dict(zip(by_order, [0.01, 0.0321], strict=True))
    renewed[0]["name"] = "third"
    gap.write_text(json.dumps(found | {"report": {"tests": renewed}}))
    assert main(["evaluate", SLIP, str(copy), "--from", str(gap)]) == 2
    said = capsys.readouterr().err
    assert "which of its tests (third, other) is example_slip? It tells values" in said
    for damaged in ([], "none", {"tests": 5}, {"tests": ["a"]}):
        gap.write_text(json.dumps(found | {"report": damaged}))
        assert main(["evaluate", SLIP, "--from", str(gap)]) == 2
        assert f"--from {gap}: it" in capsys.readouterr().err


@pytest.mark.parametrize(
    "beside",
    [
        {"starts": [], "settings": {"law": "svk"}, "material": "orthotropic", "parameters": FOUND},
        {"causes": [], "report": {"law": "svk"}, "parameters": {"corrected": FOUND}},
    ],
)
def test_the_law_is_that_of_from(
    beside: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = tmp_path / "found.json"
    found.write_text(json.dumps(beside))
    given = ["--from", str(found)]
    simulated = ["simulate", "--pressure", "2", "--refine", "2"]
    evaluated = ["evaluate", SLIP, "--refine", "2"]
    for words, key in ((simulated, "apex_mm"), (evaluated, "e_w")):
        taken = told(capsys, *words, *given)[key]
        by_law = {
            law: told(capsys, *words, *MODULI, "--law", law)[key] for law in ("hencky", "svk")
        }
        assert taken == pytest.approx(by_law["svk"], rel=1e-12)
        assert taken != pytest.approx(by_law["hencky"], rel=1e-3)
        # what is given by hand goes before
        other = told(capsys, *words, *given, "--law", "hencky")[key]
        assert other == pytest.approx(by_law["hencky"], rel=1e-12)


def test_a_prior_beyond_doubt(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "fit", SLIP, *HOLD, "--starts", "1", "--prior", "E1=352+-0.001")
    assert found["parameters"]["E1"]["value"] == pytest.approx(352.0, abs=0.05)
    assert found["settings"]["priors"] == {"E1": {"mean": 352.0, "deviation": 0.001}}


def test_simulate_holds_it_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / name for name in ("plain.npz", "slip.npz")]
    for file, more in zip(files, ([], HOLD), strict=True):
        words = ["simulate", *MODULI, "--pressure", "2", "--refine", "2", "--output", str(file)]
        assert main([*words, *more, "--quiet"]) == 0
    capsys.readouterr()
    plain, slip = (np.load(file)["displacement"] for file in files)
    # the rim moves inwards and the dome rises further
    assert slip[..., 2].max() > 1.005 * plain[..., 2].max()


BAD = {
    "no form": (["--hold", "clamp_slip.compliance"], "is not of the form NAME=VALUE"),
    "no number": (["--hold", "clamp_slip.compliance=much"], "'much' is no finite number"),
    "not finite": (["--hold", "clamp_slip.compliance=nan"], "'nan' is no finite number"),
    "twice": (["--hold", "a.b=1,a.b=2"], "--hold: a.b is given twice; give it once"),
    "a modulus": (["--hold", "E1=300"], "name an effect's parameter as EFFECT.PARAMETER"),
    "unknown": (["--hold", "clamp_slap.x=1"], "effect 'clamp_slap' is unknown; did you mean"),
    "no file": (["--from", "nowhere.json"], "--from nowhere.json: cannot be read"),
    "no diagnosis": (
        ["--from", SLIP],
        f"error: --from {SLIP}: no JSON of bulgefit diagnose or fit\n",
    ),
}
BAD_FITS = {
    "with what": (["--with", "clamp_slap"], "effect 'clamp_slap' is unknown; did you mean"),
    "with and hold": (["--with", "clamp_slip", *HOLD], "is fitted; hold it or fit it"),
    "no deviation": (["--prior", "E1=300"], "--prior E1=300: give NAME=VALUE+-SD, as E1=300+-60"),
    "no width": (["--prior", "E1=300+-0"], "prior of E1: give a finite mean and a deviation above"),
    "prior of what": (["--prior", "E9=300+-1"], "prior: E9 is not fitted"),
    "uncertain what": (["--uncertainty", "colour=0.1"], "uncertainty of 'colour' is not known"),
}


def refused(capsys: pytest.CaptureFixture[str], said: str, *words: str) -> None:
    assert main([*words, "--quiet"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert said in output.err


@pytest.mark.parametrize("verb", ["fit", "evaluate", "measure"])
def test_what_needs_times_is_not_held_without_any(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "without.npz")
    with np.load(SLIP) as arrays:
        np.savez(file, **{key: arrays[key] for key in arrays.files if key != "time"})
    words = ["--hold", "creep.rate=0.1", *([] if verb == "fit" else MODULI)]
    refused(capsys, "creep needs the time of its frames", verb, file, *words)


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("verb", ["fit", "evaluate"])
def test_what_cannot_be_held(verb: str, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    words, said = BAD[case]
    refused(capsys, said, verb, SLIP, *(MODULI if verb == "evaluate" else []), *words)


@pytest.mark.parametrize("case", BAD_FITS)
def test_what_cannot_be_fitted(case: str, capsys: pytest.CaptureFixture[str]) -> None:
    words, said = BAD_FITS[case]
    refused(capsys, said, "fit", SLIP, *words, "--starts", "1")
