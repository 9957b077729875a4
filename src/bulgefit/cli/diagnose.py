"""bulgefit diagnose: where does the model miss, and which unmodelled effect causes it?"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common, _fitting, _resuming
from bulgefit.cli._effects import (
    add_hold_argument,
    add_prior_argument,
    held_by_hand,
    priors_from,
)
from bulgefit.cli.report import check_page, is_page, page_of
from bulgefit.cli.tests_in import add_reader_arguments, add_tests_argument
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest
    from bulgefit.gap.diagnosis import Diagnosis

__all__ = ["HELP", "add_arguments", "run"]

HELP = "find out where a model misses bulge tests, and why"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Diagnose the gap between a virtual bulge test and the measured one: where it lies, which\n"
        "effects that the model leaves out cause it, and how far it shrinks once they are added.\n"
        "All effects are freed at once, beside a field in each place for what has no name, and\n"
        "weighed by evidence. The verdict is none (good to the noise), named, ambiguous,\n"
        "partial (causes are sure, and something else is left) or unknown. Several tests are\n"
        "specimens of one cloth: they share its law, about which each has factors of its own\n"
        "along warp and fill, and the face that is seen; all other effects are each test's own.\n"
        "Moduli in MPa, pressures in bar, gaps in mm. Refits go side by side, by several\n"
        "--workers (processes) or those of a --scheduler; what is found does not depend on them."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit diagnose test1.npz --report gap.html\n"
        "  bulgefit diagnose test1.npz test2.npz --max-pressure 2.5 --json gap.json\n"
        "  bulgefit diagnose test1.npz test2.npz --holdout test3.npz\n"
        "  bulgefit diagnose test1.npz test2.npz test3.npz --same-rig --prior E1=700+-100\n"
        "  bulgefit diagnose test1.npz --effects clamp_slip,prestrain,rigid_motion\n"
        "  bulgefit diagnose test1.npz --hold surface_offset.share=0.5\n"
        "  bulgefit diagnose test1.npz --thorough --scheduler tcp://cluster:8786"
    )
    add_tests_argument(parser)
    group = parser.add_argument_group("diagnosis")
    group.add_argument(
        "--effects",
        metavar="ID,ID",
        help="effects to try (default: the whole catalogue; an unknown name lists it)",
    )
    group.add_argument(
        "--thorough",
        action="store_true",
        help="search by every way, also where the first leaves nothing but noise: minutes instead "
        "of seconds",
    )
    group.add_argument(
        "--holdout",
        metavar="TEST",
        help="a test that takes no part in the diagnosis: what specimens share comes from the "
        "others, its own parameters are fitted on every second frame, and it is judged on the rest",
    )
    group.add_argument(
        "--max-pressure",
        type=float,
        metavar="BAR",
        help="leave frames above this pressure (bar) out (default: all frames)",
    )
    group.add_argument(
        "--same-rig",
        action="store_true",
        help="several tests share what belongs to clamp and cameras: the clamp's shape, the lens "
        "and its scales (default: each has its own)",
    )
    add_prior_argument(
        group, "what is believed of E1, E2 or G12 (MPa), as E1=300+-60 (default: next to nothing)"
    )
    add_hold_argument(
        group,
        "what is known of every test: a parameter of an effect that every model has, in its unit, "
        "as surface_offset.share=0.5; its effect is not looked for",
        "nothing is known",
    )
    _common.add_law_argument(group)
    group.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="written to the result; the search draws nothing at random (default: 0)",
    )
    _common.add_workers_argument(parser)
    _common.add_scheduler_argument(parser)
    add_reader_arguments(parser)
    parser.add_argument(
        "--report",
        metavar="FILE.html|FOLDER",
        help="write one page of HTML that holds all it shows: what to use, where the gap lies, "
        "maps by pressure, how it was made; it opens offline, from a mail, on a phone. A name that "
        "does not end in .html is a folder (made if needed) for the page, figures and a summary in "
        "Markdown (default: none)",
    )
    _resuming.add_resume_arguments(parser, "--json")
    _common.add_json_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Diagnose, write, draw and print."""
    _resuming.ready(args)
    _common.check_outputs(args, _fitting.inputs(args))
    effects = _effects(args.effects)
    priors, held = priors_from(args), held_by_hand(args)
    workers = _common.workers_from(args)
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: give 0 or more")
    tests = _fitting.read_tests(args)
    holdout = _holdout(args, tests)
    _common.check_outputs(args, _fitting.inputs(args), _report_files(args, tests))

    from bulgefit.gap.diagnose import diagnose
    from bulgefit.report.record import record_of
    from bulgefit.report.words.table import table

    with _resuming.resumable(args, "diagnose", [*tests, *([holdout] if holdout else [])]):
        # threads would wait for each other: most of a refit is Python
        with _common.executor_from(args, processes=workers > 1) as executor:
            found = diagnose(
                tests,
                holdout=holdout,
                effects=effects,
                law=args.law,
                thorough=args.thorough,
                same_rig=args.same_rig,
                priors=priors,
                held=held,
                seed=args.seed,
                executor=executor,
                # those of a cluster have their own work for their cores
                workers=1 if args.scheduler else workers,
                say=partial(_common.step, args),
                left=args.shown.ahead,
            )
        record = record_of(found)
        _common.deliver(args, record, table(record), *_works(args, found, record))
    return 0


def _report_files(args: argparse.Namespace, tests: list[BulgeTest]) -> Sequence[str | Path]:
    """Files of --report; refused before the work where they cannot be."""
    if args.report is None or is_page(args.report):
        return check_page(args)
    from bulgefit.report.diagnosis import check_report

    force = _common.may_replace(args, args.report)
    return check_report([t.name for t in tests], args.report, force)


def _works(
    args: argparse.Namespace, found: Diagnosis, record: dict[str, Any]
) -> list[Callable[[], None]]:
    """What writes the page, or the folder, of --report."""
    if args.report is None or is_page(args.report):
        return page_of(args, record, found.tests)
    return [partial(_draw, args, found, record)]


def _draw(args: argparse.Namespace, found: Diagnosis, record: dict[str, Any]) -> None:
    from bulgefit.report.diagnosis import write_report

    told = {**record, "run": _common.run_of(args)}
    force = _common.may_replace(args, args.report)
    files = write_report(found, args.report, record=told, force=force)
    _common.progress(args, f"drew {len(files)} files into {args.report}; open {files[0]}")


def _holdout(args: argparse.Namespace, tests: list[BulgeTest]) -> BulgeTest | None:
    """The test of --holdout, read and cut as the others."""
    if args.holdout is None:
        return None
    from bulgefit.dic.copies import same_data

    (kept,) = _fitting.read_tests(argparse.Namespace(**{**vars(args), "tests": [args.holdout]}))
    for test in tests:
        if same_data(kept, test):
            raise InputError(
                f"--holdout {args.holdout}: is among the tests diagnosed (as {test.source}); "
                "name it once"
            )
    return kept


def _effects(text: str | None) -> list[str] | None:
    """The names of --effects; refused before a test is read."""
    if text is None:
        return None
    from bulgefit.gap.effects import chosen_effects

    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise InputError("--effects: give one or more names, such as clamp_slip,prestrain")
    chosen_effects(names)
    return names
