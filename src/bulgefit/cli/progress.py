"""What is tried, and how long does it take? A line on a terminal, else lines; all on stderr."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from bulgefit.cli.streams import say

__all__ = ["Progress"]

#: Seconds between the lines that tell a file or a pipe how far the work has come.
EVERY = 30.0


class Progress:
    """Shows what is tried, how much of it is done, and the time left, until the block ends.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    """

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._began = self._counted = self._told = time.monotonic()
        self._steps = 0
        self._ends: tuple[float, float] | None = None
        self._line: Any = None

    def __enter__(self) -> Progress:
        if not self._quiet and sys.stderr.isatty():
            self._line = _line(self._left)
            self._line.start()
            self._line.add_task("", total=None)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()

    def end(self) -> None:
        """Take the line away, so that a result may be printed in its place."""
        if self._line is not None:
            self._line.stop()
        self._line, self._quiet = None, True

    def say(self, what: str) -> None:
        """Show one step."""
        self._steps += 1
        text = f"step {self._steps}: {what}"
        if self._line is not None:
            self._line.update(self._line.task_ids[0], description=text)
        elif not self._quiet:
            left = self._left()
            ahead = f"; {left} left" if left else ""
            say(f"{time.monotonic() - self._began:4.0f} s, {text}{ahead}\n")

    def ahead(self, least: float, most: float) -> None:
        """Show from now on that so many seconds are left, at least and at most."""
        now = time.monotonic()
        self._ends = now + least, now + most

    def count(self, done: int, total: int) -> None:
        """Show that so many parts of the step are done; 0 begins another count."""
        if self._line is not None:
            (task,) = self._line.task_ids
            if done == 0:
                self._line.reset(task, total=total)
            self._line.update(task, completed=done)
        elif done == 0:
            self._counted = self._told = time.monotonic()
        elif not self._quiet and done < total and time.monotonic() - self._told >= EVERY:
            self._told = now = time.monotonic()
            left = (now - self._counted) / done * (total - done)
            say(f"{now - self._began:4.0f} s, {done} of {total} done, about {left:.0f} s left\n")

    def _left(self) -> str:
        """The time left as it was told; "" where nothing was, and once that is over."""
        now = time.monotonic()
        if self._ends is None or self._ends[1] <= now:
            return ""
        least, most = (_rounded(max(end - now, 0.0)) for end in self._ends)
        if least == most:
            return f"about {most} s"
        return f"{least} to {most} s" if least else f"up to {most} s"


def _rounded(seconds: float) -> int:
    """To one digit, which is more than is known of what is to come; at least a second."""
    if seconds == 0.0:
        return 0
    digit = 10 ** max(math.floor(math.log10(max(seconds, 1.0))), 0)
    return max(round(seconds / digit), 1) * digit


def _line(left: Callable[[], str]) -> Any:
    """A line of rich that goes when the work is done.

    Parameters
    ----------
    left : callable
        What is left of the whole, in words; else of what is counted.
    """
    from rich import progress
    from rich.console import Console
    from rich.table import Column
    from rich.text import Text

    class Left(progress.TimeRemainingColumn):
        """The time left, told as soon as it is known."""

        max_refresh = 0.0

        def render(self, task: progress.Task) -> Text:
            told = left()
            return Text(told, style="progress.remaining") if told else super().render(task)

    # what is tried may hold brackets, and gives way to the numbers on a narrow terminal
    what = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    return progress.Progress(
        progress.TimeElapsedColumn(table_column=Column(min_width=7)),
        progress.TextColumn("{task.description}", markup=False, table_column=what),
        progress.MofNCompleteColumn(),
        progress.TextColumn("left"),
        Left(),
        console=Console(stderr=True),
        redirect_stdout=False,  # it may be a file
        transient=True,
        refresh_per_second=4,
        expand=True,
    )
