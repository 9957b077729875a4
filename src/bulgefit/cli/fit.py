"""bulgefit fit: which material parameters do measured tests show?"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common, _fitting, _resuming
from bulgefit.cli.report import add_report_argument, check_page, page_of
from bulgefit.cli.tests_in import add_reader_arguments, add_tests_argument
from bulgefit.errors import InputError
from bulgefit.shown import after_value, number_of

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest
    from bulgefit.fitting.result import FitResult

__all__ = ["HELP", "add_arguments", "run"]

HELP = "find the material parameters of bulge tests"

#: Below, the ends of a 95 % interval are the two outermost refits.
FEWEST_REFITS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Find the moduli that bring a virtual bulge test closest to the measured ones, from\n"
        "several starts spread over the bounds. Several tests are fitted together. Moduli in MPa,\n"
        "pressures in bar, objectives in mm. The same seed gives the same result for any number\n"
        "of workers."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit fit test1.npz\n"
        "  bulgefit fit test1.npz test2.npz --objective e --plots figures\n"
        "  bulgefit fit test1.npz --report fit.html\n"
        "  bulgefit fit test1.npz --material isotropic --bounds E=100:400 --json result.json\n"
        "  bulgefit fit test1.npz --free nu12 --method L-BFGS-B --starts 10 --seed 3\n"
        "  bulgefit fit test1.npz --cross-table\n"
        "  bulgefit fit test1.npz --bootstrap 200 --json result.json\n"
        "  bulgefit fit test*.npz --starts 50 --scheduler tcp://cluster:8786"
    )
    add_tests_argument(parser)
    _fitting.add_search_arguments(parser)
    _fitting.add_comparison_arguments(parser)
    _common.add_solver_arguments(parser)
    add_reader_arguments(parser)
    _resuming.add_resume_arguments(parser, "--json")
    _common.add_json_arguments(parser)
    add_report_argument(parser, "what to use, maps by pressure")
    parser.add_argument(
        "--plots",
        metavar="FOLDER",
        help="draw profiles and residual maps of every test into this folder (made if needed)",
    )
    parser.add_argument(
        "--cross-table",
        action="store_true",
        help="also fit the other objectives, and give each objective (mm) under each optimum and "
        "of a model that does not deform (default: the one fit)",
    )
    parser.add_argument(
        "--bootstrap",
        type=int,
        metavar="N",
        help=f"also fit N times, {FEWEST_REFITS} or more, to frames drawn with replacement, and "
        "give the 95 %% intervals of the parameters (default: none); workers of this machine are "
        "then processes",
    )


def run(args: argparse.Namespace) -> int:
    """Fit, write, draw and print."""
    _resuming.ready(args)
    _common.check_outputs(args, _fitting.inputs(args))
    tests = _fitting.read_tests(args)
    figures = _figure_names(args, [t.name for t in tests])
    files = [path for pair in figures for path in pair]
    _common.check_outputs(args, _fitting.inputs(args), [*files, *check_page(args)])
    options = {**_fitting.comparison_options(args, tests), **_fitting.search_options(args, tests)}
    _fitting.check_search(args, options, [tests])
    _check_bootstrap(args, tests)

    from bulgefit.fitting.fit import fit

    with (
        _resuming.resumable(args, "fit", tests),
        _common.executor_from(args, processes=args.bootstrap is not None) as executor,
    ):
        _common.progress(
            args,
            f"fitting {number_of(len(tests), 'test')}, "
            f"{sum(t.n_measured for t in tests):,} measured points, "
            f"{number_of(args.starts, 'start')}",
        )
        options["executor"] = executor
        result = fit(tests, args.objective, **options)
        payload, lines = result.to_dict(), [result.report()]
        try:
            _extend(args, result, tests, options, payload, lines)
        finally:  # the fit is given whatever becomes of what was asked beside it
            works = page_of(args, payload, tests)
            if figures:
                works.append(partial(_draw, args, result, options["setup"], tests, figures))
            _common.deliver(args, payload, "\n".join(lines), *works)
    return 0


def _check_bootstrap(args: argparse.Namespace, tests: list[BulgeTest]) -> None:
    """Refuse a --bootstrap that cannot be, before the fit."""
    if args.bootstrap is None:
        return
    if args.bootstrap < FEWEST_REFITS:
        raise InputError(
            f"--bootstrap {args.bootstrap}: give {FEWEST_REFITS} or more; fewer refits show no "
            "95 % interval"
        )
    for test in tests:
        if test.n_frames < 2:
            raise InputError(
                f"--bootstrap: {test.source} has one frame to draw from; every test needs two"
            )


def _extend(
    args: argparse.Namespace,
    result: FitResult,
    tests: list[BulgeTest],
    options: dict[str, Any],
    payload: dict[str, Any],
    lines: list[str],
) -> None:
    """Add --bootstrap and --cross-table to the payload and to the lines, each once it is there."""
    from bulgefit.fitting.bootstrap import bootstrap

    if args.bootstrap is not None:
        _common.progress(args, f"refitting {args.bootstrap} times")
        same = {key: options[key] for key in ("seed", "method", "limits", "executor")}
        sure = bootstrap(result, tests, replicates=args.bootstrap, **same)
        payload["bootstrap"] = sure.to_dict()
        lines.append(sure.report())
    if args.cross_table:
        payload["cross_table"] = _cross_table(args, result, tests, options)
        lines.append(_cross_lines(payload["cross_table"]))


def _cross_table(
    args: argparse.Namespace, result: FitResult, tests: list[BulgeTest], options: dict[str, Any]
) -> dict[str, dict[str, float | None]]:
    """Each objective under each objective's optimum, mm; None where that has none to compare."""
    from bulgefit.fitting.evaluate import cross_table
    from bulgefit.fitting.fit import fit
    from bulgefit.fitting.objective import OBJECTIVES

    optima: dict[str, FitResult] = {f"optimum of {args.objective}": result}
    empty: dict[str, dict[str, float | None]] = {}
    for name in OBJECTIVES:
        row = f"optimum of {name}"
        if row in optima:
            continue
        _common.progress(args, f"fitting {name} for the cross table")
        try:
            optima[row] = fit(tests, name, **options)
        except InputError as error:  # all else was good for the fit
            _common.progress(args, f"no {row}: {error}")
            empty[row] = dict.fromkeys(OBJECTIVES)
    compared = {key: options[key] for key in ("weight", "average", "setup")}
    table = {**empty, **cross_table(tests, optima, **compared)}
    # by objective, that of a likelihood and the model at rest last
    rows = [f"optimum of {name}" for name in OBJECTIVES]
    return {row: table[row] for row in [*rows, *table]}


def _cross_lines(table: dict[str, dict[str, float | None]]) -> str:
    heads = list(next(iter(table.values())))
    rows = ["mm".ljust(28) + "".join(f"{h:>10}" for h in heads)]
    rows += [
        name.ljust(28)
        + "".join(f" {'-' if v is None else format(v, '.4f'):>9}" for v in values.values())
        for name, values in table.items()
    ]
    return "\n".join(rows)


def _figure_names(args: argparse.Namespace, names: list[str]) -> list[tuple[Path, Path]]:
    """Profile and residual picture of each test; refused before the work where they exist."""
    from bulgefit.files import check_folder, check_output
    from bulgefit.report.stems import file_stems

    if args.plots is None:
        return []
    folder = Path(args.plots)
    check_folder(folder)
    stems = file_stems(names)
    pairs = [(folder / f"{s}_profiles.png", folder / f"{s}_residuals.png") for s in stems]
    files = [path for pair in pairs for path in pair]
    if folder.is_dir():
        for path in files:
            check_output(path, _common.may_replace(args, args.plots))
    return pairs


def _draw(
    args: argparse.Namespace,
    result: FitResult,
    setup: object,
    tests: list[BulgeTest],
    figures: list[tuple[Path, Path]],
) -> None:
    from bulgefit.model.predict import predict
    from bulgefit.model.setup import Setup
    from bulgefit.report.profiles import plot_profiles
    from bulgefit.report.residuals import plot_residuals

    assert isinstance(setup, Setup)
    # only now, so that input that is refused leaves no empty folder behind
    folder = figures[0][0].parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--plots {folder}: cannot be made ({error.strerror})") from error
    predictions = [
        predict(test, result.material, effects=result.effects_of(i), setup=setup).blocks
        for i, test in enumerate(tests)
    ]
    values = ", ".join(_with_unit(name, v) for name, v in result.material.values.items())
    label = f"{result.objective} fit: {values}"
    force = _common.may_replace(args, args.plots)
    for test, prediction, (profiles, residuals) in zip(tests, predictions, figures, strict=True):
        plot_profiles(test, prediction, profiles, label=label, force=force)
        plot_residuals(test, prediction, residuals, force=force)
        _common.progress(args, f"drew {profiles} and {residuals}")


def _with_unit(name: str, value: float) -> str:
    from bulgefit.fitting.result import unit_of

    return f"{name} {value:.4g}{after_value(unit_of(name))}"
