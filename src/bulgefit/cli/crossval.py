"""bulgefit crossval: do the parameters of some tests predict the others?"""

from __future__ import annotations

import argparse

from bulgefit.cli import _common, _fitting, _resuming
from bulgefit.cli.report import add_report_argument, check_page, page_of
from bulgefit.cli.tests_in import add_reader_arguments, add_tests_argument
from bulgefit.errors import InputError
from bulgefit.shown import number_of

__all__ = ["HELP", "add_arguments", "run"]

HELP = "fit all tests but one, judge on the one left out, for each in turn"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Leave-one-test-out cross-validation: fit all tests but one and judge the parameters on\n"
        "the test that was left out, without what --with frees of each test's own. Options as of\n"
        "fit. Moduli in MPa, objectives in mm."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit crossval test1.npz test2.npz test4.npz\n"
        "  bulgefit crossval test*.npz --objective e --material isotropic --json folds.json"
    )
    add_tests_argument(parser)
    _fitting.add_search_arguments(parser)
    _fitting.add_comparison_arguments(parser)
    _common.add_solver_arguments(parser)
    add_reader_arguments(parser)
    _resuming.add_resume_arguments(parser, "--json")
    _common.add_json_arguments(parser)
    add_report_argument(parser, "parameters and misfits fold by fold")


def run(args: argparse.Namespace) -> int:
    """Cross-validate and print."""
    _resuming.ready(args)
    _common.check_outputs(args, _fitting.inputs(args), check_page(args))
    tests = _fitting.read_tests(args)
    if len(tests) < 2:
        raise InputError(
            f"cross-validation needs two tests or more, got {len(tests)}; bulgefit fit fits one"
        )
    options = {**_fitting.comparison_options(args, tests), **_fitting.search_options(args, tests)}
    chosen = _fitting.check_search(args, options, [tests])

    from bulgefit.effects.registry import effect_named
    from bulgefit.fitting.crossval import check_owners, crossval

    check_owners(chosen)
    own = {name.partition(".")[0] for name in chosen.effects}
    if own := {name for name in own if not effect_named(name).shared}:
        _common.progress(
            args,
            f"warning: each test has its own {', '.join(sorted(own))}: the test left out is judged "
            "without; hold at a value what all tests have alike",
        )
    with _resuming.resumable(args, "crossval", tests):
        with _common.executor_from(args) as executor:
            _common.progress(args, f"{len(tests)} folds of {number_of(args.starts, 'start')}")
            result = crossval(tests, args.objective, executor=executor, **options)
        _common.deliver(args, result, result.report(), *page_of(args, result, tests))
    return 0
