"""Do worker processes end with the process that started them, whatever ends it?"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from bulgefit.errors import InputError
from bulgefit.parallel.memory import give_back
from bulgefit.parallel.parcels import sent
from bulgefit.parallel.processes import Processes
from bulgefit.parallel.spread import spread

PARENT = Path(__file__).with_name("parent.py")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="ends processes by POSIX signals")


def _heeds_interrupts() -> None:
    """What a shell starts in the background ignores SIGINT, and so do its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def parent(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process with three workers: one in a kernel, one asleep, one idle."""
    words = [sys.executable, str(PARENT), str(tmp_path)]
    (tmp_path / "sent").mkdir()
    # in a session of its own, as a terminal's: a signal can be sent to all of it
    started = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "TMPDIR": str(tmp_path / "sent")}, preexec_fn=_heeds_interrupts,
    )  # fmt: skip
    marks = [tmp_path / f"worker{item}" for item in range(3)]
    while not all(mark.exists() and mark.read_text() for mark in marks):
        assert started.poll() is None, started.communicate()
        time.sleep(0.05)
    yield started
    started.kill()
    for mark in marks:
        with suppress(ProcessLookupError):
            os.kill(int(mark.read_text()), signal.SIGKILL)
    started.communicate()


def everybody_ends(parent: subprocess.Popen[str], seconds: float) -> str:
    """What was said on stderr until the last process that could say something had ended."""
    return parent.communicate(timeout=seconds)[1]


def test_workers_end_with_a_parent_that_is_killed(
    parent: subprocess.Popen[str], tmp_path: Path
) -> None:
    """So do the files by which it sent them data."""
    assert len([*(tmp_path / "sent").iterdir()]) == 2
    parent.kill()
    everybody_ends(parent, 10.0)
    assert parent.returncode == -signal.SIGKILL
    assert not [*(tmp_path / "sent").iterdir()]


def test_what_is_left_of_a_parent_that_is_killed_with_its_workers_goes_later(
    parent: subprocess.Popen[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody was left to remove it: whoever writes there next does; nothing else goes."""
    left, folder = [*(tmp_path / "sent").iterdir()], tmp_path / "sent"
    os.killpg(parent.pid, signal.SIGKILL)
    everybody_ends(parent, 10.0)
    assert [*folder.iterdir()] == left
    # of a process that lives, of another machine, and no data of ours
    others = [
        left[0].with_name(left[0].name.replace(f"-{parent.pid}-", f"-{os.getppid()}-")),
        left[0].with_name("bulgefit-01234567-1-01234567.pickle"),
        left[0].with_name("bulgefit-notes.pickle"),
    ]
    for other in others:
        other.touch()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    with Processes(1) as pool, sent(pool, "data") as handles:
        pickle.dumps(handles)
        assert len([*folder.iterdir()]) == len(others) + 1
    assert sorted(folder.iterdir()) == sorted(others)


@contextmanager
def no_file_is_longer(than: int) -> Iterator[None]:
    """Writing more fails in this process as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (than, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_where_data_for_workers_go_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    refused = pytest.raises(InputError, match="name another folder in TMPDIR")
    with Processes(1) as pool, no_file_is_longer(1000), refused as caught:
        spread(pool, max, b"x" * 2000, [b"y"])
    assert "\n" not in str(caught.value)
    assert not [*tmp_path.iterdir()]


def test_ctrl_c_ends_workers_without_a_word_of_theirs(
    parent: subprocess.Popen[str], tmp_path: Path
) -> None:
    """A terminal sends it to all of them; the parent alone says so."""
    os.killpg(parent.pid, signal.SIGINT)
    said = everybody_ends(parent, 10.0)
    assert not [*(tmp_path / "sent").iterdir()]
    assert said.count("Traceback") == 1
    assert said.splitlines()[-1] == "KeyboardInterrupt"


def _keep_the_queue() -> int:
    """Take the lock by which processes fetch work, as one does that is killed while it fetches."""
    frame = sys._getframe()
    while "call_queue" not in frame.f_locals:
        assert frame.f_back is not None
        frame = frame.f_back
    frame.f_locals["call_queue"]._rlock.acquire()
    return os.getpid()


def test_processes_that_cannot_be_asked_end_all_the_same() -> None:
    pool = Processes(2)
    held = pool.submit(_keep_the_queue).result(timeout=60)
    closing = threading.Thread(target=pool.shutdown, daemon=True)
    closing.start()
    closing.join(20)
    assert not closing.is_alive()
    with pytest.raises(ProcessLookupError):
        os.kill(held, 0)


def test_processes_that_have_nothing_to_do_give_all_back_and_others_begin() -> None:
    """What they were last sent may be a third of a gigabyte each."""
    pool = Processes(2)
    before = spread(pool, _who, None, range(4))
    give_back(pool)
    for pid in {*before}:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    after = spread(pool, _who, None, range(4))
    assert not {*before} & {*after}
    pool.shutdown()


def _who(shared: None, item: int) -> int:
    return os.getpid()
