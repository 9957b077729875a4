"""bulgefit VERB: which verb runs? The module of the chosen verb is imported, no other."""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from typing import Any, NoReturn

from bulgefit.cli._values import offer_values
from bulgefit.cli.completion import SHELLS, Completion, complete, is_asked
from bulgefit.cli.config import add_config_arguments, check_config, save_config, with_config
from bulgefit.cli.stopping import Told, keeps, last_words, leave, listen, what_is_left
from bulgefit.cli.streams import drop, prepare, say
from bulgefit.errors import BulgefitError, InputError

__all__ = ["VERBS", "main"]

#: Verb: its module (with HELP, add_arguments(parser), run(args) -> int) and what it does. The
#: line stands here so that --help need not import the modules.
VERBS = {
    "simulate": ("bulgefit.cli.simulate", "inflate a membrane of known material"),
    "formats": ("bulgefit.cli.formats", "list the files that are read, with a line of each"),
    "convert": ("bulgefit.cli.convert", "bring a measured test into bulgefit's own files"),
    "align": ("bulgefit.cli.align", "lay a raw cloud of points into the clamp's frame"),
    "info": ("bulgefit.cli.info", "show what a test holds and what looks wrong"),
    "measure": ("bulgefit.cli.measure", "strain and stress as measured, without a model"),
    "show": ("bulgefit.cli.show", "picture, animation or ParaView files of a test"),
    "evaluate": ("bulgefit.cli.evaluate", "compare tests with a material: e, e_w, e_z"),
    "fit": ("bulgefit.cli.fit", "find the material parameters that fit tests best"),
    "batch": ("bulgefit.cli.batch", "fit each of several specimens, and show their spread"),
    "crossval": ("bulgefit.cli.crossval", "fit with each test left out in turn"),
    "diagnose": ("bulgefit.cli.diagnose", "find where and why the model misses tests"),
    "trial": ("bulgefit.cli.trial", "check the diagnosis on made tests, their effect withheld"),
    "report": ("bulgefit.cli.report", "draw the page of a result again from its JSON"),
}

BAD_INPUT, BROKEN_PIPE = 2, 141

_DESCRIPTION = """\
bulgefit finds material parameters of fabrics and membranes from bulge inflation tests filmed by
3D DIC, on its own membrane solver. Lengths are in mm, moduli in MPa, pressures in bar; x is warp,
y is fill, z is the direction of inflation."""

_EPILOG = """\
verbs:
{verbs}

examples:
  bulgefit info test.npz
  bulgefit fit test.npz --objective e_w --json fit.json
  bulgefit simulate --E1 303 --E2 229 --G12 30 --nu12 0.24 --pressure 0.5,1,2,3

`bulgefit VERB --help` tells what a verb takes. Exit status: 0 done, 2 bad input or no solution
(one line on stderr says which), 130 interrupted, 143 terminated."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; the exit status is returned."""
    words = list(sys.argv[1:] if argv is None else argv)
    prepare()
    keeps(None)
    if argv is None:  # the program itself, whose signals and environment are its own
        listen(_name(words))
        # a notebook's names a module that may not be here; figures are drawn without any
        os.environ.pop("MPLBACKEND", None)
    try:
        try:
            status = _dispatch(words)
        except SystemExit as stop:  # argparse, after --help or an error
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt as interrupt:
        told = interrupt if isinstance(interrupt, Told) else Told()
        if argv is None:
            with suppress(OSError, ValueError):
                sys.stdout.flush()
            leave(_name(words), told)
        say(f"{_name(words)}: {last_words(told)}\n")
        return told.status
    except BrokenPipeError:  # whoever read our output has left; say nothing
        drop(sys.stdout)
        return BROKEN_PIPE
    except InputError as error:
        message = str(error)
    except BulgefitError as error:
        message = f"{error}{what_is_left()}"
    except OSError as error:  # such as a full disk behind stdout
        drop(sys.stdout)
        where = f"{error.filename}: " if error.filename else ""
        message = f"{where}{error.strerror or error}{what_is_left()}"
    except MemoryError:
        message = f"not enough memory{what_is_left()}"
    say(f"{_name(words)}: error: {' '.join(message.split())}\n")
    return BAD_INPUT


def _dispatch(words: list[str]) -> int:
    top = _top_parser()
    if is_asked():
        complete(top, _add_verbs)
    at = _verb_at(words)
    before = top.parse_args(words[:at])
    if at == len(words):
        top.error(f"which verb? choose from {', '.join(VERBS)}")
    verb = words[at]
    if verb not in VERBS:
        near = get_close_matches(verb, VERBS, n=1)
        meant = f"did you mean {near[0]}?" if near else f"choose from {', '.join(VERBS)}"
        top.error(f"unknown verb {verb!r}; {meant}")
    module = importlib.import_module(VERBS[verb][0])
    parser = _verb_parser(verb, module)
    # what stands without an option may stand on both sides of one: `fit a.npz --starts 3 b.npz`
    args = parser.parse_intermixed_args(with_config(parser, words[at + 1 :]))
    args.quiet = args.quiet or before.quiet
    check_config(args)
    args.words, args.began = words, _now()  # for the page of a report: how it was made
    asked = argparse.Namespace(**vars(args))  # a verb may fill in what it finds out
    status = int(module.run(args))
    save_config(parser, asked)
    return status


def _verb_at(words: Sequence[str]) -> int:
    """The first word without a dash, but that which --completion takes."""
    taken = {i + 1 for i, word in enumerate(words) if word == "--completion"}
    return next(
        (i for i, word in enumerate(words) if i not in taken and not word.startswith("-")),
        len(words),
    )


def _add_verbs(verbs: Any, chosen: str) -> None:
    """All by name, and the options of one."""
    for verb, (home, line) in VERBS.items():
        parser = verbs.add_parser(verb, help=line)
        if verb == chosen:
            _fill(parser, importlib.import_module(home))
            offer_values(parser, verb)


class _Parser(argparse.ArgumentParser):
    """Errors are one line, exact option names are asked for, and values may begin with a minus."""

    def __init__(self, **kwargs: Any) -> None:
        kwargs.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(allow_abbrev=False, **kwargs)
        # argparse takes -5 for a number but -5,1 and -1e3 for options
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    def print_help(self, file: Any = None) -> None:
        # argparse's own ignores a pipe that is broken and a disk that is full
        (file or sys.stdout).write(self.format_help())

    def error(self, message: str) -> NoReturn:
        message = self._in_words(message)
        say(f"{self.prog}: error: {message} (see {self.prog} --help)\n")
        self.exit(BAD_INPUT)

    def _in_words(self, message: str) -> str:
        """What argparse says, with what to do."""
        if found := re.search(r"invalid (int|float) value: '(.*)'$", message):
            kind = {"int": "whole number", "float": "number"}[found[1]]
            point = ", whose decimal sign is a point" if "," in found[2] else ""
            return f"{message[: found.start()]}{found[2]!r} is no {kind}{point}"
        if message.startswith("unrecognized arguments: "):
            word = message.split(": ", 1)[1].split()[0]
            known = [o for action in self._actions for o in action.option_strings]
            near = get_close_matches(word.partition("=")[0], known, n=1)
            if word.startswith("-") and near:
                return f"{message}; did you mean {near[0]}?"
            if not word.startswith("-"):
                return f"{message}; quote a pattern that names the frames of one test"
        return message


def _now() -> str:
    """Date and time with the offset from UTC, to the second."""
    from datetime import datetime

    return datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")


def _top_parser() -> argparse.ArgumentParser:
    table = "\n".join(f"  {verb:<10} {line}" for verb, (_, line) in VERBS.items())
    parser = _Parser(
        prog="bulgefit",
        usage="bulgefit [--quiet] VERB ...\n"
        "       bulgefit --version | --help | --completion SHELL",
        description=_DESCRIPTION,
        epilog=_EPILOG.format(verbs=table),
    )
    parser.add_argument(
        "--version",
        action=_Version,
        nargs=0,
        help="print what a bug report needs: versions and the platform",
    )
    parser.add_argument(
        "--completion",
        action=Completion,
        choices=SHELLS,
        metavar="SHELL",
        help=f"print what completes lines of bulgefit in {', '.join(SHELLS)}; bash takes it by "
        'eval "$(bulgefit --completion bash)"',
    )
    _add_quiet(parser)
    return parser


def _verb_parser(verb: str, module: Any) -> argparse.ArgumentParser:
    parser = _Parser(prog=f"bulgefit {verb}", description=module.HELP)
    _fill(parser, module)
    return parser


def _fill(parser: argparse.ArgumentParser, module: Any) -> None:
    """With what a verb takes, and every verb."""
    module.add_arguments(parser)
    add_config_arguments(parser)
    _add_quiet(parser)


def _add_quiet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")


class _Version(argparse.Action):
    """Print what a bug report needs; it is looked up only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        import platform

        from bulgefit.cli._common import versions

        found = {**versions(), "platform": platform.platform()}
        print("\n".join(f"{name} {value}" for name, value in found.items()))
        parser.exit()


def _name(words: Sequence[str]) -> str:
    verb = next((word for word in words if not word.startswith("-")), "")
    return f"bulgefit {verb}" if verb in VERBS else "bulgefit"
