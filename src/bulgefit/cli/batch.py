"""bulgefit batch: how much do the moduli of several specimens differ?"""

from __future__ import annotations

import argparse
import csv
import io
from functools import partial
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common, _fitting, _resuming
from bulgefit.cli.tests_in import add_reader_arguments, add_tests_argument
from bulgefit.errors import BulgefitError, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bulgefit.dic import BulgeTest
    from bulgefit.fitting.batch import Batch
    from bulgefit.fitting.result import FitResult

__all__ = ["HELP", "add_arguments", "run"]

HELP = "fit each of several specimens, and show how much they differ"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Fit each test by itself, and show the parameters with their mean, their standard\n"
        "deviation over the specimens, and how much of it lies beyond the standard errors of the\n"
        "fits. Options as of fit; in e_w all specimens have one weight of dz. Moduli in MPa.\n"
        "Where a specimen cannot be fitted, the others are told, and why not; exit status 2 then."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit batch specimen1.npz specimen2.npz specimen3.npz\n"
        "  bulgefit batch specimen*.npz --csv moduli.csv --plot moduli.png --json moduli.json"
    )
    add_tests_argument(parser)
    _fitting.add_search_arguments(parser)
    _fitting.add_comparison_arguments(parser)
    _common.add_solver_arguments(parser)
    add_reader_arguments(parser)
    _resuming.add_resume_arguments(parser, "--json")
    _common.add_json_arguments(parser)
    parser.add_argument(
        "--csv", metavar="FILE.csv", help="also write the table as CSV, numbers in full"
    )
    parser.add_argument(
        "--plot",
        metavar="FILE",
        help="draw the parameters of all specimens with their 95 %% intervals (.png, .pdf, .svg)",
    )


def run(args: argparse.Namespace) -> int:
    """Fit each, write, draw and print."""
    from bulgefit.files import atomic_write_text, check_output

    _resuming.ready(args)
    others = [file for file in (args.csv, args.plot) if file is not None]
    _common.check_outputs(args, _fitting.inputs(args), others)
    if args.csv is not None:
        check_output(args.csv, _common.may_replace(args, args.csv))
    if args.plot is not None:
        from bulgefit.report.spreads import check_plot

        check_plot(args.plot, _common.may_replace(args, args.plot))
    tests = _fitting.read_tests(args)
    if len(tests) < 2:
        raise InputError("a batch needs two tests or more; bulgefit fit fits one")
    options = {**_fitting.comparison_options(args, tests), **_fitting.search_options(args, tests)}

    from bulgefit.fitting.batch import batch_of
    from bulgefit.fitting.objective import displacement_weight

    if options["weight"] is None:
        options["weight"] = displacement_weight(tests)
    _fitting.check_search(args, options, [[test] for test in tests])
    with _resuming.resumable(args, "batch", tests):
        fits, unfitted = _fitted(args, tests, options)
        if fits:
            batch = batch_of(fits, unfitted)
            works = []
            if args.csv is not None:
                force = _common.may_replace(args, args.csv)
                works.append(partial(atomic_write_text, args.csv, _csv(batch), force))
            if args.plot is not None:
                works.append(partial(_draw, args, batch))
            _common.deliver(args, batch.to_dict(), batch.report(), *works)
    # only now, so that no journal is left: going on from it would end here again
    if unfitted:
        raise BulgefitError(
            "not fitted: " + "; ".join(f"{name}: {why}" for name, why in unfitted.items())
        )
    return 0


def _fitted(
    args: argparse.Namespace, tests: Sequence[BulgeTest], options: dict[str, Any]
) -> tuple[list[FitResult], dict[str, str]]:
    """The fits, and why there are none of the other tests, by their names."""
    from bulgefit.fitting.fit import fit

    fits, unfitted = list[Any](), dict[str, str]()
    with _common.executor_from(args) as executor:
        for test in tests:
            _common.step(args, f"fitting {test.name}")
            try:
                fits.append(fit(test, args.objective, executor=executor, **options))
            except InputError:  # what was asked, or the journal: not the specimen
                raise
            except BulgefitError as error:
                unfitted[test.name] = str(error)
    return fits, unfitted


def _csv(batch: Batch) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(batch.rows())
    return text.getvalue()


def _draw(args: argparse.Namespace, batch: Batch) -> None:
    from bulgefit.report.spreads import plot_spreads

    plot_spreads(batch, args.plot, force=_common.may_replace(args, args.plot))
    _common.progress(args, f"drew {args.plot}")
