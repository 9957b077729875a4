"""Does the README tell the truth? And is the shipped example what its script makes?"""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest

import bulgefit
from bulgefit.cli import main as cli
from bulgefit.dic import describe, read_test

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "data" / "example_bulge.npz"

#: Every `bulgefit VERB ...` of the README's shell blocks and tables.
COMMANDS = sorted(set(re.findall(rf"\bbulgefit (?:{'|'.join(cli.VERBS)}) [^`\n]+", README)))


def blocks(language: str) -> list[str]:
    """Code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)


def test_python_runs(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (code,) = blocks("python")
    space: dict = {}
    exec(compile(code, "README.md", "exec"), space)
    found = space["result"].material.values
    # what was put in, within what mesh and noise leave
    assert found["E1"] == pytest.approx(330, rel=0.01)
    assert found["E2"] == pytest.approx(240, rel=0.01)
    assert found["G12"] == pytest.approx(30, rel=0.05)
    assert space["result"].failures == 0
    assert capsys.readouterr().out.startswith("e_w = ")


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_exist(command):
    words = shlex.split(command)
    if "--picture" in words[2:3]:
        words = words[:2]  # prose about one option
    module = importlib.import_module(cli.VERBS[words[1]][0])
    if len(words) > 2 and words[2] != "--help":
        cli._verb_parser(words[1], module).parse_args(words[2:])


def test_all_verbs_are_told():
    for verb in cli.VERBS:
        assert any(command.split()[1] == verb for command in COMMANDS)


def test_the_two_commands():
    """One installs and runs the main job, one passes the tests; .ci/run finds both."""
    marked = re.findall(r"^<!-- ci: (\w+) -->\n```sh\n([^\n]+)\n```$", README, flags=re.MULTILINE)
    commands = dict(marked)
    assert commands.keys() == {"main", "tests"}
    assert "pip install . && bulgefit fit data/example_bulge.npz" in commands["main"]
    assert commands["tests"].endswith("python -m pytest")
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for name in commands:
        assert f"readme_command {name}" in run


@pytest.mark.parametrize("page", ["README.md", "data/README.md", "docs/house.md", "CHANGELOG.md"])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
        if not target.startswith("https://"):
            assert (ROOT / page).parent.joinpath(target).exists(), target


def test_version_has_an_entry():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert bulgefit.__version__ in text


def test_example_is_what_its_script_makes():
    script = runpy.run_path(str(ROOT / "data" / "make_example.py"))
    made = script["make"]()
    with np.load(EXAMPLE, allow_pickle=False) as shipped:
        assert shipped.files == list(made)
        for key, array in made.items():
            assert shipped[key].dtype == array.dtype
            if array.dtype.kind == "f":
                # another machine may round the last bit otherwise
                np.testing.assert_allclose(shipped[key], array, rtol=1e-5, atol=1e-4)
            else:
                assert shipped[key] == array
        assert str(shipped["made"]).startswith("MADE, not measured")
    assert EXAMPLE.stat().st_size < 300_000


def test_example_looks_right():
    info = describe(read_test(EXAMPLE))
    assert not info.warnings
    assert info.n_frames == 15
    assert info.n_static == 4
    assert 900 < info.n_points < 1100
    assert info.largest_radius < 95


def test_example_can_be_written_elsewhere(tmp_path, monkeypatch, capsys):
    """The same bytes each time."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.npz", "b.npz"):
        monkeypatch.setattr("sys.argv", ["make_example.py", "--output", name])
        runpy.run_path(str(ROOT / "data" / "make_example.py"), run_name="__main__")
    assert Path("a.npz").read_bytes() == Path("b.npz").read_bytes()
    assert "bytes" in capsys.readouterr().out
