"""Does an interrupted verb go on with --resume, to the same bits, and never by mistake?"""

from __future__ import annotations

import csv
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.fem.mesh import disc
from bulgefit.model.observation import operators
from bulgefit.model.simulation import simulate
from bulgefit.parallel.journal import Journal

SEARCH = [
    *("--bounds", "E1=200:500,E2=150:400,G12=10:60", "--refine", "2", "--starts", "2"),
    *("--max-evaluations", "4", "--workers", "1"),
]
COMMANDS = {
    "fit": ["fit", "good.npz", "--cross-table"],
    "crossval": ["crossval", "good.npz", "other.npz"],
}


@pytest.fixture(scope="module")
def arrays() -> dict[str, Any]:
    """A made test: 4 frames of some 130 points."""
    rng = np.random.default_rng(6)
    points = rng.uniform(-90, 90, (200, 2))
    points = points[np.hypot(*points.T) < 90]
    pressure = np.array([0.02, 0.06, 0.12, 0.2])
    mesh = disc(100.0, 2)
    truth = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
    seen = operators(mesh, points, "smooth")(simulate(truth, pressure, mesh=mesh).displacement)
    return {
        "reference": np.column_stack([points, np.zeros(len(points))]),
        "displacement": seen + rng.normal(0, [0.005, 0.005, 0.012], seen.shape),
        "pressure": pressure,
        "radius": np.float64(100.0),
        "thickness": np.float64(0.81),
        "poisson_ratio": np.float64(0.24),
    }


@pytest.fixture
def folder(arrays: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with good.npz and other.npz."""
    monkeypatch.chdir(tmp_path)
    np.savez("good.npz", **arrays)
    np.savez("other.npz", **{**arrays, "displacement": arrays["displacement"] * 1.01})
    return tmp_path


def run(*words: str) -> int:
    return main([*words, "--quiet"])


def answer(file: str) -> dict[str, Any]:
    """A result, but for the time it took, and its command and date."""
    found = json.loads(Path(file).read_text())
    found.pop("seconds", None)
    found.pop("run")
    return dict(found)


@pytest.fixture
def interrupt(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Lets Ctrl-C come once so many pieces are on the disk."""

    def after(pieces: int) -> None:
        left = [pieces]
        keep = Journal.keep

        def count(self: Journal, *piece: Any) -> None:
            keep(self, *piece)
            left[0] -= 1
            if left[0] == 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(Journal, "keep", count)

    return after


@pytest.mark.parametrize("verb", COMMANDS)
def test_the_result_is_the_same(verb: str, folder: Path, interrupt: Any, capsys: Any) -> None:
    words = [*COMMANDS[verb], *SEARCH]
    assert run(*words, "--json", "whole.json") == 0
    interrupt(3)
    capsys.readouterr()
    assert run(*words, "--json", "parts.json") == 130
    assert Path("parts.json.part").is_file()
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"bulgefit {verb}: interrupted; ")
    assert said.endswith("parts.json.part keeps what is done, --resume goes on from it")
    # a Ctrl-C during the cross table gives the fit, which the resumed run replaces
    assert Path("parts.json").exists() is (verb == "fit")
    assert run(*words, "--json", "parts.json", "--resume") == 0
    assert answer("parts.json") == answer("whole.json")
    assert not Path("parts.json.part").exists()
    capsys.readouterr()
    # done: there is nothing to go on from, and what is there stays
    assert run(*words, "--json", "parts.json", "--resume") == 2
    assert "parts.json: exists; use --force to replace it" in capsys.readouterr().err


def test_only_what_the_interrupted_run_named_is_replaced(
    folder: Path, interrupt: Any, capsys: Any
) -> None:
    words = [*COMMANDS["fit"], *SEARCH, "--journal", "done"]
    interrupt(3)
    assert run(*words, "--json", "a.json") == 130
    assert Path("a.json").exists()
    for option, name in (("--json", "b.json"), ("--report", "b.html"), ("--plots", "figures")):
        place = Path(name, "good_profiles.png") if name == "figures" else Path(name)
        place.parent.mkdir(exist_ok=True)
        place.write_text("mine")
        capsys.readouterr()
        assert run(*words, "--resume", option, name) == 2
        assert f"{place}: exists; use --force to replace it" in capsys.readouterr().err
        assert place.read_text() == "mine"
    # and what the run that went on named, where it was interrupted as well
    interrupt(1)
    assert run(*words, "--resume", "--json", "c.json") == 130
    assert Path("c.json").exists()
    assert run(*words, "--resume", "--json", "c.json") == 0


def test_what_is_done_is_not_done_again(
    folder: Path, interrupt: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bulgefit.fitting import multistart

    words = [*COMMANDS["crossval"], *SEARCH, "--json", "out.json"]
    interrupt(3)
    assert run(*words) == 130
    for thread in threading.enumerate():  # a Ctrl-C does not wait for a descent that is begun
        if thread.name.startswith("ThreadPoolExecutor"):
            thread.join()
    begun = []
    descend = multistart.descend
    monkeypatch.setattr(multistart, "descend", lambda *a: begun.append(a) or descend(*a))
    assert run(*words, "--resume") == 0
    assert len(begun) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (["--starts", "3"], "with option starts 2, not 3"),
        (["--nu12", "0.3"], "with option nu12 null, not 0.3"),
        (["--resume", "--journal", "good.npz"], "good.npz: is no journal of bulgefit"),
        (["--journal", "good.npz", "--force"], "good.npz: is no journal of bulgefit"),
        (["--journal", "out.json"], "two outputs have this name"),
    ],
)
def test_another_run_does_not_go_on(
    change: list[str], message: str, folder: Path, interrupt: Any, capsys: Any
) -> None:
    words = [*COMMANDS["crossval"], *SEARCH, "--json", "out.json"]
    interrupt(2)
    assert run(*words) == 130
    capsys.readouterr()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    resumed = [] if "--journal" in change else ["--resume"]
    assert run(*words, *resumed, *change) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert message in said.err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_another_measurement_does_not_go_on(
    folder: Path, arrays: dict[str, Any], interrupt: Any, capsys: Any
) -> None:
    words = [*COMMANDS["crossval"], *SEARCH, "--json", "out.json"]
    interrupt(2)
    assert run(*words) == 130
    np.savez("other.npz", **{**arrays, "displacement": arrays["displacement"] * 1.02})
    assert run(*words, "--resume") == 2
    assert "is of another run, with checksum of other.npz" in capsys.readouterr().err
    assert run(*words) == 2
    assert "holds what an interrupted run had done; go on" in capsys.readouterr().err
    assert run(*words, "--force") == 0


@pytest.fixture
def lab(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that adds a law is installed: what it says of itself."""
    place = tmp_path_factory.mktemp("site")
    monkeypatch.syspath_prepend(place)
    return says(place / "lab-1.0.dist-info", "1.0")


def says(place: Path, version: str) -> Path:
    place.mkdir(exist_ok=True)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: lab\nVersion: {version}\n")
    (place / "entry_points.txt").write_text("[bulgefit.laws]\nfung = bulge_lab.fung:FUNG\n")
    return place


def test_another_version_of_a_package_that_adds_does_not_go_on(
    folder: Path, lab: Path, interrupt: Any, capsys: Any
) -> None:
    words = [*COMMANDS["crossval"], *SEARCH, "--json", "out.json"]
    interrupt(2)
    assert run(*words) == 130
    says(lab, "1.1")
    assert run(*words, "--resume") == 2
    assert 'is of another run, with versions lab "1.0", not "1.1"' in capsys.readouterr().err
    (lab / "entry_points.txt").unlink()
    assert run(*words, "--resume") == 2
    assert 'is of another run, with versions lab "1.0", not null' in capsys.readouterr().err
    says(lab, "1.0")
    assert run(*words, "--resume") == 0


def test_resume_needs_a_place(folder: Path, capsys: Any) -> None:
    assert run(*COMMANDS["fit"], *SEARCH, "--resume") == 2
    assert "--resume: name --journal FILE, or --json" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["fit", "--report", "r.html", "--journal", "r.html"],
        ["fit", "--plots", "figures", "--journal", "./figures"],
        ["fit", "--save-config", "out.part", "--json", "out"],
        ["batch", "--csv", "out.csv.part", "--json", "out.csv"],
        ["batch", "--plot", "out.png", "--journal", "out.png"],
    ],
)
def test_a_journal_is_no_other_output(words: list[str], folder: Path, capsys: Any) -> None:
    before = [*folder.iterdir()]
    assert run(*words, *SEARCH, "good.npz", "other.npz") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "two outputs have this name" in said
    assert [*folder.iterdir()] == before


def test_a_journal_where_it_is_asked_for(folder: Path, interrupt: Any, capsys: Any) -> None:
    words = [*COMMANDS["crossval"], *SEARCH, "--journal", "done"]
    interrupt(1)
    assert run(*words) == 130
    capsys.readouterr()
    assert run(*words, "--resume") == 0
    assert "mean" in capsys.readouterr().out
    assert not Path("done").exists()


def test_a_batch_shows_how_specimens_differ(folder: Path, capsys: Any) -> None:
    """The second one's displacements are 1 % larger."""
    words = ["batch", "good.npz", "other.npz", *SEARCH, "--max-evaluations", "20"]
    outputs = ["--json", "b.json", "--csv", "b.csv", "--plot", "b.png"]
    assert run(*words, *outputs) == 0
    said = capsys.readouterr().out
    found = json.loads(Path("b.json").read_text())
    one, other = (s["parameters"]["E1"]["value"] for s in found["specimens"])
    assert one > 1.01 * other
    spread = found["spread"]["E1"]
    assert spread["mean"] == pytest.approx(0.5 * (one + other))
    assert spread["standard_deviation"] == pytest.approx((one - other) / np.sqrt(2.0))
    assert "E1: the specimens differ by more than their standard errors" in said
    rows = [line.split(",") for line in Path("b.csv").read_text().splitlines()]
    assert rows[0][:3] == ["specimen", "E1_MPa", "E1_stderr_MPa"]
    assert [row[0] for row in rows[1:]] == [
        "good",
        "other",
        "mean",
        "standard_deviation",
        "scatter",
    ]
    assert [float(row[1]) for row in rows[1:3]] == [one, other]
    assert Path("b.png").read_bytes()[:4] == b"\x89PNG"
    assert rows[0][-1] == "not_fitted"
    assert run("batch", "good.npz", *SEARCH) == 2
    assert "a batch needs two tests or more" in capsys.readouterr().err
    assert run(*words, "--csv", "good.npz", "--force") == 2
    assert "good.npz: would replace what is read" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["fit", "crossval"])
def test_what_has_no_equilibrium_leaves_no_journal(
    verb: str, folder: Path, arrays: dict[str, Any], capsys: Any
) -> None:
    """The next run had been refused for it, and the same run again would end so again."""
    np.savez("burst.npz", **{**arrays, "pressure": arrays["pressure"] * 10.0})
    tests = ["burst.npz"] if verb == "fit" else ["burst.npz", "good.npz"]
    assert run(verb, *tests, *SEARCH, "--json", "b.json") == 2
    assert "no start found an equilibrium" in capsys.readouterr().err
    assert not [*folder.glob("b.json*")]


def test_a_run_that_lacks_memory_says_what_it_leaves(
    folder: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = Journal.keep

    def lacks(self: Journal, *piece: Any) -> None:
        keep(self, *piece)
        raise MemoryError

    monkeypatch.setattr(Journal, "keep", lacks)
    assert run("fit", "good.npz", *SEARCH, "--json", "f.json") == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("bulgefit fit: error: not enough memory; ")
    assert said.endswith("f.json.part keeps what is done, --resume goes on from it")


def test_a_batch_tells_the_rest_where_one_cannot_be_fitted(
    folder: Path, arrays: dict[str, Any], capsys: Any
) -> None:
    """At 2 MPa no cloth within the bounds has an equilibrium."""
    np.savez("burst.npz", **{**arrays, "pressure": arrays["pressure"] * 10.0})
    worse = {"pressure": arrays["pressure"] * 12.0, "displacement": arrays["displacement"] * 1.1}
    np.savez("worse.npz", **{**arrays, **worse})
    words = ["batch", "good.npz", "burst.npz", "other.npz", *SEARCH]
    assert run(*words, "--json", "b.json", "--csv", "b.csv") == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert said.err.startswith("bulgefit batch: error: not fitted: burst: no start found an equi")
    assert "burst: not fitted: no start found an equilibrium" in said.out
    found = json.loads(Path("b.json").read_text())
    assert [specimen["name"] for specimen in found["specimens"]] == ["good", "other"]
    (missing,) = found["not_fitted"]
    assert missing["name"] == "burst"
    assert missing["reason"].startswith("no start found an equilibrium")
    with open("b.csv", newline="") as file:
        rows = {row["specimen"]: row for row in csv.DictReader(file)}
    assert rows["burst"]["not_fitted"] == missing["reason"]
    assert rows["burst"]["E1_MPa"] == ""
    assert rows["good"]["not_fitted"] == ""
    assert float(rows["other"]["E1_MPa"]) > 0.0
    assert not Path("b.json.part").exists()
    assert run("batch", "burst.npz", "worse.npz", *SEARCH, "--json", "n.json") == 2
    assert not [*folder.glob("n.json*")]
