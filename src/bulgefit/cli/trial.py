"""bulgefit trial: does the diagnosis find effects that it is not told?"""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["HELP", "add_arguments", "run"]

HELP = "check the diagnosis on made tests whose effect is withheld"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Make bulge tests with a drawn effect and size, seal the truth (its SHA-256 is printed\n"
        "before any diagnosis starts), diagnose them blind in other processes, then open the\n"
        "truth and score. Tests have no effect, one, two, or one from outside the catalogue.\n"
        "Sizes in the score are in mm. The same seed makes the same tests. With --scheduler tests\n"
        "are made here and diagnosed there, and all workers must see the folder --output."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit trial --number 20 --output trial\n"
        "  bulgefit trial --number 40 --effects clamp_slip,none --output slip --json slip.json\n"
        "  bulgefit trial --number 20 --strike --output struck\n"
        "  bulgefit trial --number 60 --shrink 30 --output limits"
    )
    group = parser.add_argument_group("trial")
    group.add_argument(
        "--number", type=int, default=20, metavar="N", help="tests to make (default: 20)"
    )
    group.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of all that is drawn (default: 0)"
    )
    group.add_argument(
        "--effects",
        metavar="NAMES",
        help="make only these, separated by commas: effects of the catalogue, foreign ones, none, "
        "two (default: all)",
    )
    group.add_argument(
        "--strike",
        action="store_true",
        help="strike the true effect from the catalogue: unknown is then the right answer",
    )
    group.add_argument(
        "--shrink",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="divide sizes by a number between 1 and this, to find what is just detectable "
        "(default: 1)",
    )
    group.add_argument(
        "--output",
        required=True,
        metavar="FOLDER",
        help="tests, sealed truths and answers go here; empty, or made",
    )
    group.add_argument(
        "--score",
        action="store_true",
        help="only score the answers that the folder holds, of a trial that was interrupted",
    )
    _common.add_workers_argument(parser)
    _common.add_scheduler_argument(parser)
    _common.add_json_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Make, seal, diagnose, open, score."""
    folder = Path(args.output)
    kept = [p for part in ("tests", "sealed", "answers") for p in folder.glob(f"{part}/*")]
    _common.check_outputs(args, [folder / "trial.json", folder / "seals.txt", *kept])
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: give 0 or more")
    if not 1.0 <= args.shrink < float("inf"):
        raise InputError(f"--shrink {args.shrink:g}: give 1 or more")
    kinds = _kinds(args.effects)
    workers = _common.workers_from(args)

    from bulgefit.gap.diagnosis import diagnose
    from bulgefit.trial.make import Recipe
    from bulgefit.trial.run import run_trial, score_folder

    if args.score:
        return _told(args, score_folder(folder))
    elsewhere: AbstractContextManager[Executor | None] = nullcontext()
    if args.scheduler is not None:
        elsewhere = _common.executor_from(args)
    with elsewhere as executor:
        result = run_trial(
            args.number,
            args.seed,
            output=folder,
            kinds=kinds,
            strike=args.strike,
            workers=workers,
            diagnose=diagnose,
            recipe=Recipe(shrink=args.shrink),
            executor=executor,
            say=lambda line: _common.progress(args, line),
        )
    return _told(args, result)


def _told(args: argparse.Namespace, result: dict[str, Any]) -> int:
    """Write and print a result."""
    from bulgefit.trial.score import report

    result["meta"]["versions"] = _common.versions()
    _common.deliver(args, result, report(result["scores"]))
    return 0


def _kinds(text: str | None) -> list[str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise InputError("--effects: name at least one effect")
    return names
