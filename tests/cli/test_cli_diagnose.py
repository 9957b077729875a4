"""Does `bulgefit diagnose` keep its promises to scripts, say what it does, and refuse in a line?"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.gap.effects import CATALOGUE
from bulgefit.gap.specimen import Specimen
from bulgefit.parallel.journal import Journal

TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 40.0}
EFFECTS = ["--effects", "rigid_motion,pressure_gain"]


def arrays(frames=6, spacing=10.0):
    """A made test whose camera has moved by 0.2 mm."""
    axis = np.arange(-90, 91, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 92
    points = np.column_stack([x[inside], y[inside]])
    pressure = np.linspace(0.02, 0.22, frames)
    place = np.column_stack([points, np.zeros(len(points))])
    blank = BulgeTest.from_arrays(place, np.zeros((frames, len(points), 3)), pressure)
    fine, finer = (Specimen(blank, refine=n).predict(TRUTH).displacement for n in (6, 9))
    seen = finer + (finer - fine) / ((9 / 6) ** 2 - 1)  # free of mesh error to second order
    seen += np.array([0.2, 0.0, 0.0])
    seen += np.random.default_rng(1).normal(0, [0.006, 0.006, 0.013], seen.shape)
    return {
        "reference": np.column_stack([points, np.zeros(len(points))]),
        "displacement": seen,
        "pressure": pressure,
        "radius": np.float64(100.0),
        "thickness": np.float64(0.81),
        "poisson_ratio": np.float64(0.24),
    }


@pytest.fixture(scope="module")
def moved():
    return arrays()


@pytest.fixture
def folder(moved, tmp_path, monkeypatch):
    """The working folder, with good.npz."""
    monkeypatch.chdir(tmp_path)
    np.savez("good.npz", **moved)
    return tmp_path


@pytest.fixture
def untouched(monkeypatch):
    """Fails where a diagnosis starts although it should have been refused before."""
    import bulgefit.gap.diagnose

    def started(*_, **__):
        raise AssertionError("the work began")

    monkeypatch.setattr(bulgefit.gap.diagnose, "diagnose", started)


def refused(capsys, message, *words):
    before = sorted(Path().rglob("*"))
    assert main(["diagnose", *words, "--quiet"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("bulgefit diagnose: error: ")
    assert output.err.count("\n") == 1
    assert message in output.err
    assert sorted(Path().rglob("*")) == before


def test_a_diagnosis_to_read_to_draw_and_for_scripts(folder, capsys):
    words = ["diagnose", "good.npz", *EFFECTS, "--workers", "1", "--seed", "3"]
    assert main([*words, "--json", "gap.json", "--report", "new/report"]) == 0
    output = capsys.readouterr()
    for text in ("verdict: named", "rigid_motion", "shift_x", "±", "mm", "noise alone", "G12"):
        assert text in output.out
    lines = output.err.splitlines()
    assert any("baseline: the moduli alone" in line for line in lines)
    # what is tried, and how long it will still take where that is told
    assert any(re.search(r": rigid_motion(; .+ left)?$", line) for line in lines)
    assert "open new/report/summary.html" in lines[-1]
    assert "\r" not in output.err
    found = json.loads((folder / "gap.json").read_text())
    assert found["verdict"] == "named"
    (cause,) = found["causes"]
    assert cause["effect"] == "rigid_motion"
    assert cause["parameters"]["shift_x"]["value"] == pytest.approx(0.2, abs=0.005)
    assert found["meta"]["seed"] == 3
    assert (
        "bulgefit diagnose good.npz --effects" in (folder / "new/report/summary.html").read_text()
    )

    # the JSON alone on stdout; nothing on stderr
    assert main([*words, "--json", "-", "--quiet"]) == 0
    output = capsys.readouterr()
    again = json.loads(output.out)
    assert again["causes"] == found["causes"]
    assert output.err == ""


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("'clamp_slop' is unknown; did you mean clamp_slip", ["--effects", "creep,clamp_slop"]),
        ("--effects: give one or more names", ["--effects", ","]),
        ("--seed -1: give 0 or more", ["--seed", "-1"]),
        ("--workers 0: give 1 or more", ["--workers", "0"]),
        ("every frame of good lies above it", ["--max-pressure", "0.01"]),
        ("good.npz: exists; use --force", ["--json", "good.npz"]),
        ("good.npz: would replace what is read", ["--json", "good.npz", "--force"]),
        ("nowhere does not exist", ["--json", "nowhere/gap.json"]),
        ("good.npz is a file; name a folder", ["--report", "good.npz"]),
        ("--holdout good.npz: is among the tests", ["--holdout", "good.npz"]),
        ("other.npz", ["--holdout", "other.npz"]),
    ],
)
def test_refused_before_the_work(folder, untouched, capsys, message, words):
    refused(capsys, message, "good.npz", *words)


def test_json_that_is_a_file_of_the_report(folder, untouched, capsys):
    (folder / "report").mkdir()
    words = ["good.npz", "--report", "report", "--json", "report/summary.html"]
    refused(capsys, "two outputs have this name", *words)


@pytest.mark.parametrize("name", ["./good.npz", "link.npz", "copy.npz"])
def test_a_held_out_test_that_is_fitted(name, folder, untouched, capsys):
    Path("link.npz").symlink_to("good.npz")
    Path("copy.npz").write_bytes(Path("good.npz").read_bytes())
    message = f"--holdout {name}: is among the tests diagnosed (as good.npz); name it once"
    refused(capsys, message, "good.npz", "--holdout", name)
    refused(capsys, f"good.npz and {Path(name)}: hold the same data", "good.npz", name)


def test_an_older_report_is_kept(folder, untouched, capsys):
    (folder / "report").mkdir()
    (folder / "report" / "good_modes.png").write_text("older")
    refused(capsys, "report/good_modes.png: exists; use --force", "good.npz", "--report", "report")


def test_every_known_effect_is_listed(folder, untouched, capsys):
    assert main(["diagnose", "good.npz", "--effects", "gravity"]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in CATALOGUE)


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("few: 3 usable frames are too few to judge a gap; 5 or more", {"frames": 3}),
        ("points are too few to judge a gap; 60 or more", {"spacing": 30.0}),
    ],
)
def test_too_little_to_judge(folder, capsys, message, options):
    np.savez("few.npz", **arrays(**options))
    refused(capsys, message, "few.npz")


def test_a_held_out_test_is_met(folder, capsys):
    np.savez("other.npz", **{**arrays(), "displacement": arrays()["displacement"] + [0.3, 0, 0]})
    words = ["diagnose", "good.npz", *EFFECTS, "--workers", "1", "--holdout", "other.npz"]
    assert main([*words, "--json", "gap.json", "--quiet"]) == 0
    assert "other took no part" in " ".join(capsys.readouterr().out.split())
    kept = json.loads((folder / "gap.json").read_text())["holdout"]
    assert kept["parameters"]["rigid_motion.shift_x"]["value"] == pytest.approx(0.5, abs=0.01)
    assert kept["explained"]["e_w"] < 0.1 * kept["baseline"]["e_w"]


def test_what_was_kept_out_is_told_by_its_checksum(folder):
    """In the JSON and on the page, also of one that has the name of the other."""
    (folder / "kept").mkdir()
    name = "kept/good.npz"
    np.savez(name, **{**arrays(), "displacement": arrays()["displacement"] + [0.3, 0, 0]})
    words = ["diagnose", "good.npz", *EFFECTS, "--workers", "1", "--holdout", name]
    assert main([*words, "--json", "gap.json", "--report", "gap.html", "--quiet"]) == 0
    record = json.loads((folder / "gap.json").read_text())
    ours, kept = (hashlib.sha256(Path(p).read_bytes()).hexdigest() for p in ("good.npz", name))
    assert record["meta"]["checksums"] == {"good": ours, "kept/good": kept}
    assert [test["sha256"] for test in record["report"]["tests"]] == [ours]
    assert record["report"]["kept_out"]["sha256"] == kept
    assert main(["report", "gap.json", "--output", "again.html"]) == 0
    for page in ("gap.html", "again.html"):
        text = (folder / page).read_text()
        assert "SHA-256 of kept/good (kept/good.npz)" in text
        assert kept in text


def test_a_held_out_test_that_is_too_small_is_refused_at_once(folder, capsys, monkeypatch):
    import bulgefit.gap.diagnose

    few = arrays(frames=3)
    np.savez("few.npz", **few)
    monkeypatch.setattr(bulgefit.gap.diagnose, "explain", lambda *_, **__: pytest.fail("began"))
    refused(capsys, "few: 3 usable frames are too few", "good.npz", "--holdout", "few.npz")


def test_unknown_law(folder, capsys):
    refused(
        capsys, "law: 'hook' is unknown; choose from hencky, svk, yarn", "good.npz", "--law", "hook"
    )


def test_no_test(capsys):
    assert main(["diagnose"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_an_interrupted_diagnosis_goes_on(folder, capsys, monkeypatch):
    """After everything was freed at once, and after the first model that was weighed."""
    words = ["diagnose", "good.npz", *EFFECTS, "--workers", "1", "--quiet"]
    assert main([*words, "--json", "whole.json"]) == 0
    keep, pieces = Journal.keep, []

    def interrupted(self, *piece):
        keep(self, *piece)
        pieces.append(piece[:2])  # its call, and its place in that
        if len(pieces) in (1, 2):
            raise KeyboardInterrupt

    monkeypatch.setattr(Journal, "keep", interrupted)
    assert main([*words, "--json", "parts.json"]) == 130
    assert main([*words, "--json", "parts.json", "--resume"]) == 130
    assert main([*words, "--json", "parts.json", "--resume"]) == 0
    assert len(pieces) == len(set(pieces)) > 2
    whole, parts = (json.loads((folder / f"{n}.json").read_text()) for n in ("whole", "parts"))
    for found in (whole, parts):
        found["meta"].pop("seconds")
        found.pop("run")  # the command and its date
    assert parts == whole
    assert sorted(path.name for path in folder.glob("parts*")) == ["parts.json"]
