"""Do worker processes end with the process that started them, whatever ends it?"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bulgefit.parallel.processes import Processes

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
