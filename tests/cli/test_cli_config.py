"""Does a run that was saved come again, and is a file that cannot be meant refused?"""

from __future__ import annotations

import argparse
import importlib
import tomllib
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bulgefit.cli import main as cli
from bulgefit.cli.config import save_config, with_config

#: What the verb of these tests was told.
Seen = list[dict[str, Any]]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Seen:
    """A verb `fit` with an option of each kind, which keeps what it is told."""
    told: Seen = []

    def add(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("tests", nargs="+")
        parser.add_argument("--objective", default="e_w")
        parser.add_argument("--max-pressure", type=float)
        parser.add_argument("--starts", type=int, default=5)
        parser.add_argument("--hold", action="append")
        parser.add_argument("--force", action="store_true")
        parser.add_argument("--no-relaxation", dest="relaxation", action="store_false")

    def run(args: argparse.Namespace) -> int:
        # words and began are of this one run
        own = ("config", "save_config", "words", "began")
        told.append({k: v for k, v in vars(args).items() if k not in own})
        return 0

    verb = types.SimpleNamespace(HELP="h", add_arguments=add, run=run)
    monkeypatch.setattr(cli.importlib, "import_module", lambda name: verb)
    return told


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], str]:
    """The path of a file with this text."""

    def write(text: str) -> str:
        (tmp_path / "run.toml").write_text(text, encoding="utf-8")
        return str(tmp_path / "run.toml")

    return write


def test_a_saved_run_comes_again(seen: Seen, tmp_path: Path) -> None:
    saved = str(tmp_path / "run.toml")
    words = ["fit", "-1.npz", 'ä "b".npz', "--max-pressure", "-2.5", "--hold", "a=1"]
    words += ["--hold", "b=-2", "--no-relaxation"]
    assert cli.main([*words, "--save-config", saved]) == 0
    assert cli.main(["fit", "--config", saved]) == 0
    assert seen[0] == seen[1]
    assert seen[1]["tests"] == ["-1.npz", 'ä "b".npz']
    assert seen[1]["hold"] == ["a=1", "b=-2"]
    assert (seen[1]["max_pressure"], seen[1]["relaxation"]) == (-2.5, False)
    assert tomllib.loads(Path(saved).read_text(encoding="utf-8"))["starts"] == 5


@pytest.mark.parametrize("verb", list(cli.VERBS))
def test_every_verb_takes_what_it_saved(verb: str, tmp_path: Path) -> None:
    """With what must be given, and everything else as it is where nothing is said."""
    module = importlib.import_module(cli.VERBS[verb][0])
    parser = cli._verb_parser(verb, module)
    needed = [a for a in parser._actions if a.required]
    words = [word for a in needed for word in (*a.option_strings[:1], f"{a.dest}.x")]
    saved = tmp_path / "run.toml"
    first = parser.parse_args([*words, "--save-config", str(saved)])
    save_config(parser, first)
    assert "[]" not in saved.read_text(encoding="utf-8")
    again = cli._verb_parser(verb, module)
    second = again.parse_args(with_config(again, ["--config", str(saved)]))
    unlike = ("config", "save_config")
    assert {k: v for k, v in vars(second).items() if k not in unlike} == {
        k: v for k, v in vars(first).items() if k not in unlike
    }


def test_an_empty_list_is_none_given(seen: Seen, file: Callable[[str], str]) -> None:
    assert cli.main(["fit", "--config", file('tests = ["a.npz"]\nhold = []\n')]) == 0
    assert not seen[0]["hold"]
    assert cli.main(["fit", "--config", file("tests = []\n")]) == 2


def test_the_command_line_replaces_the_file(seen: Seen, file: Callable[[str], str]) -> None:
    run = file('tests = ["a.npz", "b.npz"]\nstarts = 3\nobjective = "e"\nforce = false\n')
    assert cli.main(["fit", "c.npz", "--starts", "4", "--config", run]) == 0
    assert cli.main(["fit", f"--config={run}", "--force"]) == 0
    found = [(told["tests"], told["starts"], told["objective"], told["force"]) for told in seen]
    assert found[0] == (["c.npz"], 4, "e", False)
    assert found[1] == (["a.npz", "b.npz"], 3, "e", True)


def test_tests_may_stand_on_both_sides_of_an_option(seen: Seen, file: Callable[[str], str]) -> None:
    """They were `unrecognized arguments` behind one, with --config as without."""
    words = ["fit", "a.npz", "--starts", "3", "b.npz"]
    assert cli.main(words) == 0
    assert cli.main([*words, "--config", file('tests = ["c.npz"]')]) == 0
    assert [(told["tests"], told["starts"]) for told in seen] == [(["a.npz", "b.npz"], 3)] * 2


@pytest.mark.parametrize("words", [["--hold", "a=2"], ["--hold=a=2"]])
def test_a_list_of_the_file_is_replaced_as_well(
    seen: Seen, file: Callable[[str], str], words: list[str]
) -> None:
    """Not added to: a value of each would be given twice."""
    run = file('tests = ["a.npz"]\nhold = ["a=1", "b=1"]\n')
    assert cli.main(["fit", "--config", run, *words]) == 0
    assert cli.main(["fit", "--config", run]) == 0
    assert [told["hold"] for told in seen] == [["a=2"], ["a=1", "b=1"]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("objectiv = 'e'", "objectiv is no option of bulgefit fit; did you mean objective?"),
        ("max_pressure = 1", "max_pressure is no option of bulgefit fit; did you mean max-p"),
        ("config = 'a'", "config is no option of bulgefit fit; see bulgefit fit --help"),
        ("starts = 'many'", "starts: 'many' is no whole number"),
        ("starts = 2.5", "starts: '2.5' is no whole number"),
        ("starts = [1, 2]", "starts: give a string or a number, not [1, 2]"),
        ("starts = true", "starts: give a string or a number, not True"),
        ("tests = []", "tests: give a string or a number, or a list of them, not []"),
        ("force = 1", "force: give true or false, not 1"),
        ("[fit]\nstarts = 3", "fit is no option of bulgefit fit; the file has options alone"),
        ("starts 3", "is no TOML ("),
    ],
)  # fmt: skip
def test_files_that_cannot_be_meant(
    text: str,
    said: str,
    seen: Seen,
    file: Callable[[str], str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = file(text)
    assert cli.main(["fit", "a.npz", "--config", run]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"bulgefit fit: error: {run}: ")
    assert said in line
    assert line.count("\n") == 1
    assert not seen


def test_files_that_are_not_there_or_no_text(
    seen: Seen, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    for name, said in (("none.toml", "No such file"), ("bytes.toml", "is no TOML"), (".", "Is a")):
        assert cli.main(["fit", "a.npz", "--config", str(tmp_path / name)]) == 2
        assert said in capsys.readouterr().err
    assert not seen


def test_saving_replaces_nothing_unasked(
    seen: Seen, file: Callable[[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    run = file("starts = 3")
    assert cli.main(["fit", "a.npz", "--save-config", run]) == 2
    assert "exists; use --force" in capsys.readouterr().err
    assert cli.main(["fit", run, "--save-config", run, "--force"]) == 2
    assert "would replace what is read" in capsys.readouterr().err
    assert not seen
    assert cli.main(["fit", "a.npz", "--save-config", run, "--force"]) == 0
    assert "starts = 5" in Path(run).read_text()


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_takes_them(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert "--config FILE.toml" in text
    assert "--save-config FILE.toml" in text
