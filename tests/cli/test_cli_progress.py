"""Is it shown what is tried and how long it takes, on one line that goes, or in lines?"""

from __future__ import annotations

import argparse
import io
import re
import sys
from pathlib import Path

import pytest

from bulgefit.cli import _common, progress
from bulgefit.cli.progress import Progress
from bulgefit.parallel.spread import spread

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal(io.StringIO):
    """A screen of 60 columns."""

    def isatty(self) -> bool:
        return True


def stderr_is_a_screen(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """To be called in the test itself, since pytest sets stderr anew when that begins."""
    found = Terminal()
    monkeypatch.setattr(sys, "stderr", found)
    for name, value in {"COLUMNS": "60", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)
    for name in ("NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    return found


def test_a_terminal_has_one_line_that_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = stderr_is_a_screen(monkeypatch)

    def work() -> None:
        with Progress(quiet=False) as shown:
            shown.say("clamp_slip [1 parameter]")
            shown.count(0, 4)
            shown.count(3, 4)
            shown._line.refresh()
            shown.say("reference_state " * 10)
            shown._line.refresh()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    text = screen.getvalue()
    lines = [line for line in re.split(r"[\r\n]", ESCAPE.sub("", text)) if line.strip()]
    assert any("step 1: clamp_slip [1 parameter]" in line and "3/4" in line for line in lines)
    assert max(map(len, lines)) <= 60
    # the line is erased, and the cursor stands where it was, to be seen
    assert text.endswith("\x1b[2K")
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")


def test_a_pipe_has_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    with Progress(quiet=False) as shown:
        clock[0] += 2
        shown.say("clamp_slip")
        for done in range(11):
            shown.count(done, 10)
            clock[0] += 16
    assert capsys.readouterr().err.splitlines() == [
        "   2 s, step 1: clamp_slip",
        *(f"{2 + 16 * n:4d} s, {n} of 10 done, about {16 * (10 - n)} s left" for n in (2, 4, 6, 8)),
    ]


def test_the_time_left_is_told_between_two_ends(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it goes by, to one digit; nothing once more has gone by than was told."""
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    with Progress(quiet=False) as shown:
        shown.say("all")
        shown.ahead(18.0, 134.0)
        for seconds in (2, 10, 70, 48, 50):
            shown.say("a step")
            clock[0] += seconds
    assert [line.partition(": ")[2] for line in capsys.readouterr().err.splitlines()] == [
        "all",
        "a step; 20 to 100 s left",
        "a step; 20 to 100 s left",
        "a step; 6 to 100 s left",
        "a step; up to 50 s left",
        "a step; up to 4 s left",
    ]


def test_a_terminal_tells_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = stderr_is_a_screen(monkeypatch)
    with Progress(quiet=False) as shown:
        shown.say("all")
        shown.ahead(20.0, 60.0)
        shown._line.refresh()
        assert "left 20 to 60 s" in ESCAPE.sub("", screen.getvalue())


def test_a_result_is_printed_in_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And goes to stdout, which may be a file, as it is."""
    screen = stderr_is_a_screen(monkeypatch)
    args = argparse.Namespace(workers=1, scheduler=None, quiet=False, json=None)
    with _common.executor_from(args) as executor:
        spread(executor, square, None, range(3))
        print("before", "-" * 70)
        _common.deliver(args, {}, "result " * 20)
        assert screen.getvalue().endswith("\x1b[2K")
        _common.step(args, "nothing more is shown")
    assert capsys.readouterr().out == f"before {'-' * 70}\n{'result ' * 20}\n"
    assert screen.getvalue().endswith("\x1b[2K")


def test_quiet_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = stderr_is_a_screen(monkeypatch)
    with Progress(quiet=True) as shown:
        shown.say("x")
        shown.count(0, 3)
    assert screen.getvalue() == ""


def square(shared: None, item: int) -> int:
    return item * item


@pytest.mark.parametrize("processes", [False, True])
def test_what_an_executor_does_is_counted(
    processes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[int, int]] = []
    monkeypatch.setattr(Progress, "count", lambda self, *numbers: told.append(numbers))
    args = argparse.Namespace(workers=2, scheduler=None, quiet=True)
    with _common.executor_from(args, processes=processes) as executor:
        assert spread(executor, square, None, range(3)) == [0, 1, 4]
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    with _common.executor_from(args) as executor:
        spread(executor, square, None, [])
    spread(executor, square, None, [])
    assert told[4:] == [(0, 0)]
