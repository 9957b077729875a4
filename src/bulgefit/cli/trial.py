"""bulgefit trial: does the diagnosis find effects that it is not told?"""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common, _resuming
from bulgefit.cli.report import add_report_argument, check_page, page_of
from bulgefit.cli.stopping import keeps
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["HELP", "add_arguments", "run"]

HELP = "check the diagnosis on made tests whose effect is withheld"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Make bulge tests with drawn effects and sizes, seal the truth (its SHA-256 is printed\n"
        "before any diagnosis starts), diagnose them blind in other processes, then open the\n"
        "truth and score. Tests have none to six effects, a third of them one from outside the\n"
        "catalogue, alone or beside others; families are three tests of one cloth, diagnosed\n"
        "together. Sizes in the score are in mm. The same seed makes the same tests. With\n"
        "--scheduler tests are made here and diagnosed there, and all workers must see the folder\n"
        "--output."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit trial --number 20 --output trial\n"
        "  bulgefit trial --number 40 --effects clamp_slip,none --output slip --json slip.json\n"
        "  bulgefit trial --number 10 --effects beside,family --output hard\n"
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
        "two to six (so many effects), beside (a foreign one beside others), family (default: all)",
    )
    group.add_argument(
        "--strike",
        action="store_true",
        help="strike the true effect from the catalogue: unknown is then the right answer",
    )
    group.add_argument(
        "--shrink",
        type=float,
        default=10.0,
        metavar="FACTOR",
        help="divide each size by a number between 1 and this: 10 goes down to the noise of the "
        "cameras, 30 below what is detectable; foreign ones by 3 at most (default: 10)",
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
    _resuming.add_resume_arguments(parser, "--output")
    _common.add_json_arguments(parser)
    add_report_argument(parser, "what was found and what was not, test by test")


def run(args: argparse.Namespace) -> int:
    """Make, seal, diagnose, open, score."""
    _resuming.ready(args)
    folder = Path(args.output)
    kept = [p for part in ("tests", "sealed", "answers") for p in folder.glob(f"{part}/*")]
    inputs = [folder / "trial.json", folder / "seals.txt", *kept]
    _common.check_outputs(args, inputs, check_page(args))
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: give 0 or more")
    if not 1.0 <= args.shrink < float("inf"):
        raise InputError(f"--shrink {args.shrink:g}: give 1 or more")
    kinds = _kinds(args.effects)
    workers = _common.workers_from(args)

    from bulgefit.gap.diagnose import diagnose
    from bulgefit.gap.effects import CATALOGUE
    from bulgefit.trial.recording import Recipe
    from bulgefit.trial.run import run_trial, score_folder

    if args.score:
        return _told(args, score_folder(folder))
    elsewhere: AbstractContextManager[Executor | None] = nullcontext()
    if args.scheduler is not None:
        elsewhere = _common.executor_from(args)
    with _resuming.resumable(args, "trial") as resumed, elsewhere as executor:
        # a test that is made is there before the journal has anything
        keeps(folder)
        result = run_trial(
            args.number,
            args.seed,
            output=folder,
            kinds=kinds,
            strike=args.strike,
            workers=workers,
            diagnose=diagnose,
            options={"effects": [*CATALOGUE]} if args.strike else None,
            recipe=Recipe(shrink=args.shrink),
            executor=executor,
            # without a journal nothing was done; a folder with answers is a trial that has ended
            resume=resumed or (args.resume and not any(folder.glob("answers/*"))),
            say=lambda line: _common.progress(args, line),
        )
        return _told(args, result)


def _told(args: argparse.Namespace, result: dict[str, Any]) -> int:
    """Write and print a result."""
    from bulgefit.trial.table import report

    result["meta"]["versions"] = _common.versions()
    _common.deliver(args, result, report(result["scores"]), *page_of(args, result, []))
    return 0


def _kinds(text: str | None) -> list[str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise InputError("--effects: name at least one effect")
    return names
