"""Does the program end within a second of being told to, whatever it is at?"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"

#: Shear so soft that tracing it takes half a minute.
SOFT = ["--bounds", "E1=300:400,E2=200:300,G12=0.5:1", "--method", "Nelder-Mead"]

#: Seconds; one, and another for a machine that is busy with other things.
WITHIN = 2.0

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")

Starter = Callable[..., subprocess.Popen[str]]


def _heeds_interrupts() -> None:
    """What a shell starts in the background ignores SIGINT, and so do its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def start() -> Iterator[Starter]:
    """Run Python in a session of its own, as a terminal's; ended after the test."""
    started = []

    def run(*words: str | Path) -> subprocess.Popen[str]:
        started.append(
            subprocess.Popen(
                [sys.executable, *map(str, words)],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                preexec_fn=_heeds_interrupts,
            )
        )  # fmt: skip
        return started[-1]

    yield run
    for program in started:
        if program.poll() is None:
            os.killpg(program.pid, signal.SIGKILL)
            program.communicate()


def told(program: subprocess.Popen[str], number: int) -> tuple[float, str]:
    """Seconds until the last process that could say something has ended; what was said."""
    began = time.monotonic()
    os.killpg(program.pid, number)
    said = program.communicate(timeout=60)[1]
    return time.monotonic() - began, said


def begun(program: subprocess.Popen[str], word: str) -> None:
    """Wait until a program says so on stderr, and computes."""
    assert program.stderr is not None
    while word not in (line := program.stderr.readline()):
        assert line, f"never said {word}"
    time.sleep(1.5)
    assert program.poll() is None


@pytest.mark.parametrize(
    ("workers", "number", "status", "word"),
    [(1, signal.SIGINT, 130, "interrupted"), (2, signal.SIGTERM, 143, "terminated")],
)
def test_while_soft_shear_is_traced_by_threads(
    workers: int, number: int, status: int, word: str, start: Starter, tmp_path: Path
) -> None:
    words = ["-m", "bulgefit", "fit", EXAMPLE, *SOFT, "--workers", f"{workers}"]
    program = start(*words, "--json", tmp_path / "fit.json")
    begun(program, "fitting 1 test,")
    seconds, said = told(program, number)
    assert program.returncode == status
    assert said == f"bulgefit fit: {word}\n"
    assert seconds < WITHIN
    assert not [*tmp_path.iterdir()]


def test_while_processes_refit(
    start: Starter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was found by then is given, and what --resume goes on from; nothing else is left."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    easy = ["--bounds", "E1=300:400,E2=200:300,G12=20:40", "--refine", "2", "--starts", "1"]
    words = ["-m", "bulgefit", "fit", EXAMPLE, *easy, "--workers", "2"]
    program = start(*words, "--bootstrap", "100000", "--json", tmp_path / "fit.json")
    begun(program, "refitting")
    seconds, said = told(program, signal.SIGINT)
    assert program.returncode == 130
    kept = tmp_path / "fit.json.part"
    assert said == (
        f"bulgefit fit: interrupted; {kept} keeps what is done, --resume goes on from it\n"
    )
    assert seconds < WITHIN
    assert sorted(file.name for file in tmp_path.iterdir()) == ["fit.json", "fit.json.part"]


def test_while_the_first_test_of_a_trial_is_made(start: Starter, tmp_path: Path) -> None:
    """The folder is there before the journal has anything, and a new run would refuse it."""
    folder = tmp_path / "trial"
    program = start("-m", "bulgefit", "trial", "--number", "30", "--output", folder)
    while not (folder / "trial.json").is_file():
        assert program.poll() is None
        time.sleep(0.05)
    seconds, said = told(program, signal.SIGINT)
    assert program.returncode == 130
    kept = f"bulgefit trial: interrupted; {folder} keeps what is done, --resume goes on from it\n"
    assert kept in said
    assert seconds < WITHIN


#: A verb that writes half a file, and then computes for ever without a look at any signal.
DEAF = """
import sys, types
from numba import njit
from bulgefit.cli import main
from bulgefit.files import atomic_path

@njit(nogil=True)
def compute(count):
    total = 0.0
    for i in range(count):
        total += 1.0 / (1.0 + i * total)
    return total

def run(args):
    compute(10)
    with atomic_path(args.output) as temporary:
        temporary.write_text("half of it")
        print("writing", file=sys.stderr, flush=True)
        compute(10**13)

def add_arguments(parser):
    parser.add_argument("output")

sys.modules["deaf"] = types.SimpleNamespace(HELP="h", add_arguments=add_arguments, run=run)
main.VERBS["info"] = ("deaf", "")
sys.argv = ["bulgefit", "info", sys.argv[1]]
main.main()
"""


def test_in_the_midst_of_something_deaf(start: Starter, tmp_path: Path) -> None:
    program = start("-c", DEAF, tmp_path / "out.txt")
    begun(program, "writing")
    assert len([*tmp_path.iterdir()]) == 1
    seconds, said = told(program, signal.SIGTERM)
    assert program.returncode == 143
    assert said == "bulgefit info: terminated\n"
    assert seconds < WITHIN
    assert not [*tmp_path.iterdir()]
