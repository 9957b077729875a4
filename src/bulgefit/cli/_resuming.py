"""How does an interrupted run go on? By a journal beside its output, or where --journal says."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest

__all__ = ["add_resume_arguments", "ready", "resumable"]

#: Options that change nothing in what is computed.
_BESIDE = (
    *("config", "save_config", "json", "force", "quiet", "workers", "scheduler", "resume"),
    *("journal", "plots", "plot", "csv", "report", "output", "words", "began", "begun"),
)
#: Options that name what is written beside the journal.
_WRITTEN = ("json", "csv", "plot", "plots", "report", "output", "save_config")
#: Options whose files are read beside the tests.
_READ_BESIDE = ("mesh", "from_file")


def add_resume_arguments(parser: argparse.ArgumentParser, output: str) -> None:
    """Add --resume and --journal FILE.

    Parameters
    ----------
    output : str
        The option beside whose file or folder the journal stands.
    """
    required = any(
        action.required and output in action.option_strings for action in parser._actions
    )
    group = parser.add_argument_group("going on after an interruption")
    group.add_argument(
        "--resume",
        action="store_true",
        help="go on from the journal of a run that was interrupted or killed, where there is one; "
        "the result is the same to the last bit (default: begin, and refuse to replace a journal)",
    )
    group.add_argument(
        "--journal",
        metavar="FILE",
        help=f"keep what is done here until the run ends well (default: {output} with .part added"
        + ("" if required else f", none without {output}")
        + ")",
    )
    parser.set_defaults(journal_beside=output.removeprefix("--"))


def ready(args: argparse.Namespace) -> None:
    """Let a run that goes on replace what the interrupted one named; before outputs are checked.

    Raises
    ------
    InputError
        --resume without a place for a journal, or one that is an output's.
    """
    from bulgefit.files import check_apart
    from bulgefit.parallel.journal import outputs_of

    place = _place(args)
    if args.resume and place is None:
        raise InputError(f"--resume: name --journal FILE, or --{args.journal_beside}")
    if place is None:
        return
    check_apart([*_written(args), place])
    if args.resume and place.is_file():
        args.begun = outputs_of(place)


@contextmanager
def resumable(
    args: argparse.Namespace, verb: str, tests: Sequence[BulgeTest] = ()
) -> Iterator[bool]:
    """Keep what is done in the block in a journal, and take what was done before.

    Parameters
    ----------
    args : Namespace
    verb : str
    tests : sequence of BulgeTest
        All that were read.

    Yields
    ------
    bool
        Whether there is a run that this one goes on with.

    Raises
    ------
    InputError
        See `bulgefit.parallel.journal.journaled`.
    """
    from bulgefit.cli import _common
    from bulgefit.cli.stopping import keeps
    from bulgefit.parallel.journal import journaled

    place = _place(args)
    if place is None:
        yield False
        return
    resumed = args.resume and place.is_file()
    keeps(place)
    with journaled(
        place,
        _asked(args, verb, tests),
        resume=args.resume,
        force=getattr(args, "force", False),
        outputs=map(os.path.realpath, _written(args)),
        tell=lambda line: _common.progress(args, f"warning: {line}"),
    ):
        yield resumed


def _place(args: argparse.Namespace) -> Path | None:
    """Where the journal stands, or None."""
    if args.journal is not None:
        return Path(args.journal)
    output = getattr(args, args.journal_beside)
    if output is None or output == "-":
        return None
    # what a link names, as the output itself
    return Path(os.path.realpath(output) + ".part")


def _written(args: argparse.Namespace) -> list[str]:
    """What is written beside the journal, as its options name it."""
    named = [getattr(args, option, None) for option in _WRITTEN]
    return [name for name in named if name not in (None, "-")]


def _asked(args: argparse.Namespace, verb: str, tests: Sequence[BulgeTest]) -> Mapping[str, Any]:
    """All that the result depends on."""
    from bulgefit.cli._common import versions
    from bulgefit.files import checksum_of, open_regular

    beside = {}
    for option in _READ_BESIDE:
        if (name := getattr(args, option, None)) is not None:
            with open_regular(name) as file:
                beside[name] = checksum_of(file)
    return {
        "verb": verb,
        "versions": {**versions(), **_added()},
        "option": {
            name.replace("_", "-"): value
            for name, value in sorted(vars(args).items())
            if name not in _BESIDE and name != "journal_beside"
        },
        "checksum of": {**{test.source: test.checksum for test in tests}, **beside},
    }


def _added() -> dict[str, str]:
    """Versions of installed packages that add effects, laws or readers, by their names."""
    from importlib.metadata import entry_points

    from bulgefit.dic.formats import plugins
    from bulgefit.effects import registry as effects
    from bulgefit.fem.laws import registry as laws

    points = [p for room in (effects, laws, plugins) for p in entry_points(group=room.GROUP)]
    found = {point.dist.name: point.dist.version for point in points if point.dist}
    return dict(sorted(found.items()))
