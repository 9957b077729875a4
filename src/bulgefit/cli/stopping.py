"""How does the program end when it is told to, by Ctrl-C or by SIGTERM? Within a second."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from pathlib import Path
from typing import Any, NoReturn

from bulgefit.cli.streams import say
from bulgefit.files import drop_unfinished

__all__ = ["Told", "keeps", "last_words", "leave", "listen", "what_is_left"]

#: Seconds that the program has to clean up after itself; then it ends as it stands.
GRACE = 0.7

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

#: For a terminal on which a line of progress may have hidden it.
_SHOW_CURSOR = "\x1b[?25h"

_saying = threading.Lock()

#: What the run keeps, the first that is there first: its journal, its folder.
_kept: list[Path] = []


class Told(KeyboardInterrupt):
    """The program was told to end.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__()
        self.status = 128 + number
        self.word = _WORDS[signal.Signals(number)]


def keeps(place: Path | None) -> None:
    """Note a file, or a folder, where the run keeps what it has done; None: a run begins."""
    _kept[:] = [] if place is None else [*_kept, place]


def last_words(told: Told) -> str:
    """What ended the program, and what of its work is left to go on from."""
    return told.word + what_is_left()


def what_is_left() -> str:
    """A clause that names what a run that did not end well has kept; empty if that is nothing."""
    left = [place for place in _kept if place.is_file() or any(place.glob("*"))]
    return "".join(f"; {p} keeps what is done, --resume goes on from it" for p in left[:1])


def listen(name: str) -> None:
    """End the program within a second of SIGINT or SIGTERM.

    Each raises `Told`, which leaves every block in order. But an interpreter that is in the midst
    of compiling or reading does not look at signals, and an exception that is raised in a callback
    is lost: a thread that the system wakes sees to the end where `GRACE` was not enough.

    Parameters
    ----------
    name : str
        Who says so.
    """
    ours, told = socket.socketpair()
    told.setblocking(False)
    signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    for number in _WORDS:
        # what whoever started us has switched off, such as Ctrl-C of a job in the background
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise)
    threading.Thread(target=_watch, args=(ours, told, name), daemon=True).start()


def _raise(number: int, _: Any) -> NoReturn:
    # once is enough: a second one would disturb the first one's cleaning up
    for each in _WORDS:
        signal.signal(each, signal.SIG_IGN)
    raise Told(number)


def _watch(ours: socket.socket, told: socket.socket, name: str) -> None:
    """`told` is held here, so that it is not closed."""
    number = ours.recv(1)[0]
    time.sleep(GRACE)
    drop_unfinished()
    if os.isatty(2):
        say(_SHOW_CURSOR)
    leave(name, Told(number))


def leave(name: str, told: Told) -> NoReturn:
    """Say so, and end without waiting for threads that compute.

    Parameters
    ----------
    name : str
        Who says so.
    told : Told
    """
    if _saying.acquire(blocking=False):  # once, whoever is first
        say(f"{name}: {last_words(told)}\n")
    os._exit(told.status)
