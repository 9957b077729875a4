"""Does `bulgefit` choose verbs, stay light, and end every failure in one line?"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
import types

import numba
import numpy
import pytest
import scipy

import bulgefit
from bulgefit.cli import main as cli
from bulgefit.cli.stopping import Told
from bulgefit.errors import InputError, SolveError

HEAVY = ("numpy", "scipy", "numba", "pyvista", "matplotlib", "h5py")


def python(code, **kwargs):
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, **kwargs
    )


@pytest.fixture
def verb(monkeypatch):
    """A verb `simulate` that does what the test wants."""

    def install(run, add_arguments=lambda parser: None):
        module = types.SimpleNamespace(HELP="h", add_arguments=add_arguments, run=run)
        monkeypatch.setattr(cli.importlib, "import_module", lambda name: module)

    return install


@pytest.mark.parametrize("words", [["--help"], ["simulate", "--help"], ["--version"], ["nonsense"]])
def test_help_imports_nothing_heavy(words):
    done = python(
        "import sys; from bulgefit.cli.main import main\n"
        f"main({words!r})\n"
        f"print('heavy:', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    assert done.stdout.splitlines()[-1] == "heavy: []", done.stderr


def test_importing_bulgefit_is_light():
    done = python(f"import sys, bulgefit; print([n for n in {HEAVY!r} if n in sys.modules])")
    assert done.stdout.strip() == "[]"


def test_help_names_every_verb(capsys):
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    for name, (_, line) in cli.VERBS.items():
        assert name in text
        assert line in text
    for word in ("MPa", "bar", "mm", "examples:"):
        assert word in text


def help_of(verb, capsys):
    """In one line."""
    assert cli.main([verb, "--help"]) == 0
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "verb",
    [
        "convert",
        "align",
        "info",
        "measure",
        "show",
        "evaluate",
        "fit",
        "batch",
        "crossval",
        "diagnose",
    ],
)
def test_help_says_that_exports_are_read(verb, capsys):
    told = help_of(verb, capsys)
    assert "export of a DIC system, of which a quoted 'pattern*' picks some; bulgefit form" in told


@pytest.mark.parametrize("verb", ["evaluate", "fit", "batch", "crossval"])
def test_help_says_what_leaves_the_meshs_error_in(verb, capsys):
    told = help_of(verb, capsys)
    assert "all but smooth leave the mesh's error in" in told
    assert "study leaves the mesh's error in" in told
    assert "and any by --interpolation study or an --evaluation that is not smooth" in told


def test_help_says_what_a_page_shows(capsys):
    """Maps are of tests that were measured: a trial has none, nor has a cross-validation."""
    told = {verb: help_of(verb, capsys) for verb in ("fit", "diagnose", "crossval", "trial")}
    assert all("opens offline, from a mail, on a phone" in text for text in told.values())
    assert [verb for verb, text in told.items() if "maps by pressure" in text] == [
        "fit", "diagnose",
    ]  # fmt: skip
    # --output must be given
    assert "--output with .part added)" in told["trial"]
    assert "--json with .part added, none without --json)" in told["fit"]


def test_help_of_simulate_teaches(capsys):
    assert cli.main(["simulate", "--help"]) == 0
    text = capsys.readouterr().out
    assert "examples:" in text
    assert text.count("default:") >= 8
    assert "--quiet" in text


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    lines = dict(line.split(" ", 1) for line in capsys.readouterr().out.splitlines())
    assert lines == {
        "bulgefit": bulgefit.__version__,
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "platform": platform.platform(),
    }


def test_python_m_bulgefit():
    done = subprocess.run(
        [sys.executable, "-m", "bulgefit", "fly"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("bulgefit: error: unknown verb 'fly'; choose from simulate,")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("words", [[], ["--quiet"], ["--loud", "simulate"], ["simulat"]])
def test_no_known_verb(words, capsys):
    assert cli.main(words) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("bulgefit: error: ")
    assert output.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "quiet"),
    [(["simulate"], False), (["--quiet", "simulate"], True), (["simulate", "--quiet"], True)],
)
def test_quiet_before_and_after_the_verb(verb, words, quiet):
    seen = []
    verb(lambda args: seen.append(args.quiet) or 0)
    assert cli.main(words) == 0
    assert seen == [quiet]


def test_options_are_exact_and_values_may_be_negative(verb, capsys):
    seen = []

    def add(parser):
        parser.add_argument("--pressure")
        parser.add_argument("--E1", type=float)

    verb(lambda args: seen.append((args.pressure, args.E1)) or 0, add)
    assert cli.main(["simulate", "--pressure", "-1,2", "--E1", "-1e3"]) == 0
    assert seen == [("-1,2", -1000.0)]
    assert cli.main(["simulate", "--press", "1"]) == 2
    assert cli.main(["simulate", "--E1", "many"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[1].startswith("bulgefit simulate: error: argument --E1: 'many' is no number")


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("a.npz: bad,\n  very bad"), 2, "error: a.npz: bad, very bad"),
        (
            SolveError(
                "no equilibrium", pressure=0.2, reached=0.15, iteration=3, residual_norm=1.0,
                parameters={"E1": 9.0, "nu12": 0.2},
            ),
            2,
            "error: no equilibrium at 2 bar (equilibrium was reached up to 1.5 bar; iteration 3, "
            "residual 1 N; E1 = 9 MPa, nu12 = 0.2)",
        ),
        (OSError(28, "No space left"), 2, "error: No space left"),
        (PermissionError(13, "Permission denied", "a"), 2, "error: a: Permission denied"),
        (MemoryError(), 2, "error: not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (Told(signal.SIGTERM), 143, "terminated"),
    ],
)  # fmt: skip
def test_failures_are_one_line(verb, capsys, error, status, line):
    def run(args: argparse.Namespace) -> int:
        raise error

    verb(run)
    assert cli.main(["--quiet", "simulate"]) == status
    assert capsys.readouterr().err == f"bulgefit simulate: {line}\n"


def test_programming_errors_are_not_hidden(verb):
    def run(args: argparse.Namespace) -> int:
        raise ZeroDivisionError

    verb(run)
    with pytest.raises(ZeroDivisionError):
        cli.main(["simulate"])


@pytest.fixture(params=["", "1"])
def unbuffered(request):
    return {**os.environ, "PYTHONUNBUFFERED": request.param}


def test_reader_that_leaves(unbuffered):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        done = subprocess.run(
            [sys.executable, "-m", "bulgefit", "--help"], stdout=gone, stderr=subprocess.PIPE,
            text=True, check=False, env=unbuffered,
        )  # fmt: skip
    assert done.returncode == 141
    assert done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_behind_stdout(unbuffered):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bulgefit", "--help"], stdout=full, stderr=subprocess.PIPE,
            text=True, check=False, env=unbuffered,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "No space left on device" in done.stderr


def bulgefit_in_shell(command, **environment):
    return subprocess.run(
        ["sh", "-c", f"{sys.executable} -m bulgefit {command}"],
        capture_output=True, check=False, env={**os.environ, **environment},
    )  # fmt: skip


def few_points(folder):
    """A folder of one frame with four points."""
    folder.mkdir()
    rows = [f"{x},{y},0,0,0,1" for x in (-9, 9) for y in (-9, 9)]
    (folder / "a.csv").write_text("\n".join(["x,y,z,dx,dy,dz", *rows]))
    (folder / "pressure.csv").write_text("file,pressure_bar\na.csv,1\n")
    return folder


def test_letters_that_a_terminal_does_not_know():
    done = bulgefit_in_shell("fit --help", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"57 N\\xb2 cells" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="needs file names of any bytes")
def test_file_names_of_another_encoding(tmp_path):
    """A Latin-1 name is shown with an escape, on stdout as on stderr."""
    frames = few_points(tmp_path / os.fsdecode(b"caf\xe9"))
    words = [sys.executable, "-m", "bulgefit", "info", frames, "--radius", "100"]
    done = subprocess.run(
        [*words, "--thickness", "1", "--json", tmp_path / "i.json"],
        capture_output=True, check=False, env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"caf\udce9" in done.stdout
    assert json.loads((tmp_path / "i.json").read_text())["name"] == "caf\udce9"
    done = subprocess.run(words, capture_output=True, check=False)
    assert done.returncode == 2
    assert rb"caf\udce9: does not say its thickness" in done.stderr


def test_a_notebook_s_backend_does_not_stop_figures(tmp_path):
    frames = few_points(tmp_path / "frames")
    words = f"{frames} --radius 100 --thickness 1 --refine 1 --starts 1 --material isotropic"
    done = bulgefit_in_shell(
        f"fit {words} --bounds E=10:10000 --plots {tmp_path / 'figures'}",
        MPLBACKEND="notebook-of-another-environment",
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "figures").iterdir())) == 2


@pytest.mark.parametrize(("closed", "shown"), [(">&-", 0), ("2>&-", 1), (">&- 2>&-", 0)])
def test_streams_that_are_closed(closed, shown, tmp_path):
    command = f"simulate --E 250 --pressure 1 --refine 1 --json {tmp_path / 'r.json'} {closed}"
    done = bulgefit_in_shell(command)
    assert done.returncode == 0
    assert b"Error" not in done.stderr
    assert json.loads((tmp_path / "r.json").read_text())["apex_mm"]
    assert (b"apex" in done.stdout) == shown


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_behind_stderr(tmp_path):
    """What cannot be said is lost, and nothing else."""
    assert bulgefit_in_shell("fly 2>/dev/full").returncode == 2
    frames = few_points(tmp_path / "frames")
    words = f"convert {frames} {tmp_path / 't.npz'} --radius 100 --thickness 1"
    assert bulgefit_in_shell(f"{words} 2>/dev/full").returncode == 0
    assert b"4 points" in bulgefit_in_shell(f"{words} --force").stderr
    assert bulgefit_in_shell(f"{words} 2>/dev/full").returncode == 2


@pytest.mark.parametrize("name", ["read_test", "write_test", "BulgeTest", "simulate", "Mesh",
                                  "plot_profiles", "plot_residuals", "plot_fields"])  # fmt: skip
def test_public_names(name):
    assert getattr(bulgefit, name).__name__ == name
    assert name in dir(bulgefit)
    assert name in bulgefit.__all__


def test_unknown_public_name():
    with pytest.raises(AttributeError, match="no attribute 'telepathy'"):
        _ = bulgefit.telepathy
