"""Does a real shell complete verbs, options and files?"""

from __future__ import annotations

import argparse
import importlib
import shutil
import subprocess
import sys

import pytest

from bulgefit.cli._values import _NAMES, offer_values
from bulgefit.cli.main import VERBS, main

pytest.importorskip("argcomplete", reason="completion needs argcomplete, which is not installed")

BASH = shutil.which("bash")

#: What bash does at the tab, with what it would offer on stdout.
_TAB = """
eval "$(bulgefit --completion bash)"
COMP_LINE="$1" COMP_POINT=${#1} COMP_TYPE=9
read -ra COMP_WORDS <<< "$1"
case "$1" in *" ") COMP_WORDS+=("") ;; esac
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
_python_argcomplete bulgefit
printf "%s\n" "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def offered(tmp_path_factory):
    """What is offered at the end of a line."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "bulgefit"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m bulgefit "$@"\n')
    program.chmod(0o755)
    (folder / "plate.npz").touch()

    def at(line):
        done = subprocess.run(
            [BASH, "-c", f'PATH="{folder}:$PATH"; cd "{folder}"\n{_TAB}', "bash", line],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
        assert done.stderr == ""
        return [word.strip() for word in done.stdout.splitlines()]

    return at


@pytest.mark.skipif(BASH is None, reason="no bash here")
@pytest.mark.parametrize(
    ("line", "some"),
    [
        ("bulgefit ", set(VERBS)),
        ("bulgefit --ver", {"--version"}),
        ("bulgefit cross", {"crossval"}),
        ("bulgefit --quiet fit --star", {"--starts"}),
        ("bulgefit convert --centre ", {"rim", "apex"}),
        ("bulgefit info pla", {"plate.npz"}),
        ("bulgefit --completion ", {"bash", "zsh", "fish"}),
        ("bulgefit fit plate.npz --objective ", {"e", "e_w", "e_z", "likelihood"}),
        ("bulgefit crossval --method ", {"gauss-newton", "SLSQP"}),
        ("bulgefit fit --with clamp_slip,pre", {"clamp_slip,prestrain"}),
        ("bulgefit evaluate --hold clamp_sl", {"clamp_slip.compliance="}),
        ("bulgefit trial --effects dic_sm", {"dic_smoothing"}),
        ("bulgefit show --field residual_d", {"residual_dx", "residual_dy", "residual_dz"}),
        ("bulgefit info --format vic3d", {"vic3d"}),
    ],
)
def test_what_bash_offers(offered, line, some):
    found = set(offered(line))
    assert found >= some
    typed = line.rpartition(" ")[2]
    assert all(word.startswith(typed) for word in found)


@pytest.mark.parametrize(("verb", "option"), _NAMES)
def test_names_are_offered_for_options_that_there_are(verb, option):
    homes = [verb] if verb else list(VERBS)
    found = []
    for one in homes:
        parser = argparse.ArgumentParser()
        importlib.import_module(VERBS[one][0]).add_arguments(parser)
        offer_values(parser, one)
        found += [a.completer for a in parser._actions if option in a.option_strings]
    assert found
    names = found[0](prefix="")
    assert names
    assert len(set(names)) == len(names)
    assert all(isinstance(name, str) and name for name in names)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_has_its_own(shell, capsys):
    assert main(["--completion", shell]) == 0
    text = capsys.readouterr().out
    assert {"bash": "complete -o", "zsh": "compdef", "fish": "complete --command"}[shell] in text
    assert "bulgefit" in text


def test_without_argcomplete(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    assert main(["--completion", "bash"]) == 2
    assert capsys.readouterr().err == (
        "bulgefit: error: --completion: argcomplete is not installed; pip install "
        '"bulgefit[completion]" brings it\n'
    )
    assert main(["--completion", "tcsh"]) == 2
    assert "choose from" in capsys.readouterr().err
    assert main(["--completion"]) == 2
