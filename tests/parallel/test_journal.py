"""Does a run go on from its journal with the same results, and from no other?"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from bulgefit.errors import InputError
from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.problem import Evaluation
from bulgefit.parallel.journal import journaled, kept
from bulgefit.parallel.spread import spread

ASKED = {"verb": "fit", "option": {"starts": 3, "bounds": "E1=1:2"}, "checksum of": {"a": "0f"}}


class Tasks:
    """Tasks that count what they do, and one of which ends the run."""

    def __init__(self, last: int | None = None) -> None:
        self.done: list[int] = []
        self.last = last

    def __call__(self, shared: object, item: int) -> object:
        if self.last is not None and item >= self.last:
            raise KeyboardInterrupt
        self.done.append(item)
        return np.full(3, 0.1 * item), Descent({"E1": 0.1 + item}, Evaluation({}, float(item)))


def run(path: Path, tasks: Tasks, **options: object) -> list[object]:
    with journaled(path, ASKED, **options), ThreadPoolExecutor(1) as pool:
        first = spread(pool, tasks, None, [0, 1, 2])
        middle = kept(lambda: tasks(None, 3))
        return [*first, middle, *spread(pool, tasks, None, [4, 5])]


def bits(results: list[object]) -> list[object]:
    return [(array.tobytes(), vars(descent.best), descent.start) for array, descent in results]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "fit.json.part"


@pytest.fixture
def begun(path: Path) -> Path:
    """The journal of a run that ended at the begin of its third call."""
    with pytest.raises(KeyboardInterrupt):
        run(path, Tasks(last=4))
    assert path.is_file()
    return path


@pytest.mark.parametrize("last", range(6))
def test_only_what_is_left_is_done(path: Path, last: int) -> None:
    whole = run(path, Tasks())
    assert not path.exists()
    with pytest.raises(KeyboardInterrupt):
        run(path, Tasks(last=last))
    rest = Tasks()
    assert bits(run(path, rest, resume=True)) == bits(whole)
    # calls that were done; of the one that was interrupted, threads may have done more than is kept
    kept_for_sure = next(first for first in (4, 3, 0) if first <= last)
    assert {*range(last, 6)} <= {*rest.done} <= {*range(kept_for_sure, 6)}
    assert not path.exists()


def test_nothing_done_leaves_no_journal(path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(path, Tasks(last=0))
    assert not path.exists()


def test_what_does_not_fit_its_checksum_is_done_again(begun: Path) -> None:
    content = begun.read_bytes()
    for damaged in (content[:-1], content[:-200], content[:-1] + b"x"):
        begun.write_bytes(damaged)
        rest = Tasks()
        run(begun, rest, resume=True)
        assert rest.done == [3, 4, 5]


@pytest.mark.parametrize("written", [0, 20, 500])
def test_what_was_killed_while_it_was_written_is_done_again(begun: Path, written: int) -> None:
    """Its head is written last: what stands there until then is the head of nothing."""
    whole = run(begun.with_name("whole"), Tasks())
    with begun.open("ab") as file:
        file.write(bytes(56) + b"x" * written)
    rest = Tasks()
    assert bits(run(begun, rest, resume=True)) == bits(whole)
    assert rest.done == [4, 5]


def test_a_result_goes_to_the_disk_without_a_copy_of_it(path: Path) -> None:
    result = [np.ones(300_000) for _ in range(4)]
    with journaled(path, ASKED) as journal:
        tracemalloc.start()
        try:
            kept(lambda: result)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        ((_, again),) = journal.known(1)
    np.testing.assert_array_equal(again, result)
    assert most < 0.1 * sum(array.nbytes for array in result)


def test_a_journal_is_not_begun_anew_unasked(begun: Path) -> None:
    content = begun.read_bytes()
    with pytest.raises(InputError, match="holds what an interrupted run had done; go on from it"):
        run(begun, Tasks())
    assert begun.read_bytes() == content
    rest = Tasks()
    run(begun, rest, force=True)
    assert rest.done == [*range(6)]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"verb": "crossval"}, 'verb "fit", not "crossval"'),
        ({"option": {"starts": 4, "bounds": "E1=1:2"}}, "option starts 3, not 4"),
        ({"option": {"starts": 3}}, 'option bounds "E1=1:2", not null'),
        ({"checksum of": {"a": "0e"}}, 'checksum of a "0f", not "0e"'),
    ],
)
def test_a_journal_of_another_run_is_refused(begun: Path, other: dict, message: str) -> None:
    content = begun.read_bytes()
    with (
        pytest.raises(InputError, match=f"is of another run, with {message}; give what"),
        journaled(begun, {**ASKED, **other}, resume=True),
    ):
        raise AssertionError
    assert begun.read_bytes() == content


def test_a_journal_that_is_refused_stays(begun: Path) -> None:
    content = begun.read_bytes()
    damaged = content[:60] + b"x" + content[61:]
    begun.write_bytes(damaged)
    with pytest.raises(InputError, match="damaged at its beginning; begin anew with --force"):
        run(begun, Tasks(), resume=True)
    assert begun.read_bytes() == damaged


@pytest.mark.parametrize("options", [{"resume": True}, {"force": True}])
def test_what_is_no_journal_stays(path: Path, options: dict) -> None:
    path.write_bytes(b"bulgefit,1,2\n" * 100)
    with pytest.raises(InputError, match="is no journal of bulgefit"):
        run(path, Tasks(), **options)
    assert path.read_bytes() == b"bulgefit,1,2\n" * 100


def test_one_run_at_a_time(begun: Path) -> None:
    pytest.importorskip("fcntl")
    with journaled(begun, ASKED, resume=True):
        for options in ({"resume": True}, {"force": True}):
            with (
                pytest.raises(InputError, match="another run is at it"),
                journaled(begun, ASKED, **options),
            ):
                raise AssertionError


class Code:
    """Unpickled carelessly, it makes a folder."""

    def __reduce__(self):
        return os.mkdir, ("was_run",)


def test_nothing_is_run_that_a_journal_names(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert pickle.loads(pickle.dumps(Code())) is None
    Path("was_run").rmdir()
    with suppress(KeyboardInterrupt), journaled(path, ASKED):
        kept(Code)
        raise KeyboardInterrupt
    with (
        pytest.raises(InputError, match=r"asks for posix\.mkdir, which is no result"),
        journaled(path, ASKED, resume=True),
    ):
        kept(Code)
    assert not Path("was_run").exists()


def test_a_full_disk_does_not_end_the_run(path: Path) -> None:
    """The limit is on the size of any file of this process: writing fails as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    heeded = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    said: list[str] = []
    tasks = Tasks(last=4)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1400, before[1]))
        with pytest.raises(KeyboardInterrupt):
            run(path, tasks, tell=said.append)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, heeded)
    assert len(said) == 1
    assert said[0].startswith(f"{path}: cannot be written (File too large); the run goes on")
    assert tasks.done == [0, 1, 2, 3]
    # what was whole by then still counts
    rest = Tasks()
    run(path, rest, resume=True)
    assert 0 < len(rest.done) < 6


KILLED = """
import os, signal, sys
from bulgefit.parallel.journal import journaled, kept
from bulgefit.files import atomic_path

def work(item):
    if item == 2 and sys.argv[2] == "die":
        with atomic_path("out.txt") as temporary:
            temporary.write_text("half of it")
            os.kill(os.getpid(), signal.SIGKILL)
    print(item, flush=True)
    return item / 7

with journaled(sys.argv[1], {}, resume=True):
    print([kept(lambda: work(item)) for item in range(4)])
with atomic_path("out.txt") as temporary:
    temporary.write_text("all of it")
"""


@pytest.mark.skipif(os.name != "posix", reason="kills by SIGKILL")
def test_after_a_kill_the_run_goes_on_and_nothing_half_written_stays(
    path: Path, tmp_path: Path
) -> None:
    def started(how: str) -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-c", KILLED, str(path), how]
        return subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)

    killed = started("die")
    assert killed.returncode == -signal.SIGKILL
    assert killed.stdout == "0\n1\n"
    assert sorted(p.name[:5] for p in tmp_path.iterdir()) == [".out.", "fit.j"]
    rest = started("live")
    assert rest.stdout == f"2\n3\n{[item / 7 for item in range(4)]}\n", rest.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["out.txt"]
    assert (tmp_path / "out.txt").read_text() == "all of it"
