"""What is tried, and how long does it take? A line on a terminal, else lines; all on stderr."""

from __future__ import annotations

import sys
import time
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
        self._line: Any = None

    def __enter__(self) -> Progress:
        if not self._quiet and sys.stderr.isatty():
            self._line = _line()
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
            say(f"{time.monotonic() - self._began:4.0f} s, {text}\n")

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


def _line() -> Any:
    """A line of rich that goes when the work is done."""
    from rich import progress
    from rich.console import Console
    from rich.table import Column

    # what is tried may hold brackets, and gives way to the numbers on a narrow terminal
    what = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    return progress.Progress(
        progress.TimeElapsedColumn(table_column=Column(min_width=7)),
        progress.TextColumn("{task.description}", markup=False, table_column=what),
        progress.MofNCompleteColumn(),
        progress.TextColumn("left"),
        progress.TimeRemainingColumn(),
        console=Console(stderr=True),
        redirect_stdout=False,  # it may be a file
        transient=True,
        refresh_per_second=4,
        expand=True,
    )
