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
        "the test that was left out. Options as of fit. Moduli in MPa, objectives in mm."
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
    options = {**_fitting.comparison_options(args, tests), **_fitting.search_options(args)}
    chosen = _fitting.check_search(args, options, [tests])

    from bulgefit.fitting.crossval import check_owners, crossval
    from bulgefit.fitting.result import describe_tests

    check_owners(chosen)
    with _resuming.resumable(args, "crossval", tests):
        with _common.executor_from(args) as executor:
            _common.progress(args, f"{len(tests)} folds of {number_of(args.starts, 'start')}")
            result = crossval(tests, args.objective, executor=executor, **options)
        result["sources"] = describe_tests(tests)
        _common.deliver(args, result, result.report(), *page_of(args, result, tests))
    return 0
