"""bulgefit evaluate: how far are given parameters from measured tests?"""

from __future__ import annotations

import argparse

from bulgefit.cli import _common, _fitting
from bulgefit.cli._effects import (
    add_effect_arguments,
    given_ratios,
    held_from,
    take_found_law,
    take_found_moduli,
)
from bulgefit.cli.tests_in import add_reader_arguments, add_tests_argument
from bulgefit.errors import InputError

__all__ = ["HELP", "add_arguments", "run"]

HELP = "compare given material parameters with bulge tests"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Simulate bulge tests with given parameters and print every published objective (mm):\n"
        "mean absolute deviations r_dx, r_dy, r_dz, their sum e, the weighted sum e_w, and e_z at\n"
        "the point nearest the centre. Several tests: the mean over tests."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit evaluate test1.npz --E1 303 --E2 229 --G12 30\n"
        "  bulgefit evaluate test1.npz test2.npz --E 250 --nu 0.24 --law svk --json -\n"
        "  bulgefit evaluate test1.npz --undeformed"
    )
    add_tests_argument(parser)
    _common.add_material_arguments(parser, "what the test says")
    parser.add_argument(
        "--undeformed",
        action="store_true",
        help="judge a model that does not deform, instead of a material",
    )
    add_effect_arguments(parser)
    _fitting.add_comparison_arguments(parser)
    _common.add_solver_arguments(parser, found=True)
    add_reader_arguments(parser)
    _common.add_json_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Evaluate and print."""
    _common.check_outputs(args, _fitting.inputs(args))
    if args.undeformed:
        for name in ("E1", "E2", "G12", "nu12", "E", "nu", "G"):
            if getattr(args, name) is not None:
                raise InputError(f"--undeformed and --{name} do not go together: give one of them")
        for option, given in (("from", args.from_file), ("hold", args.hold)):
            if given:
                raise InputError(f"--undeformed and --{option} do not go together: it has no model")
    tests = _fitting.read_tests(args)
    take_found_law(args)
    options = _fitting.comparison_options(args, tests)

    from bulgefit.fitting.evaluate import evaluate, evaluate_resting
    from bulgefit.fitting.free import stated_ratio
    from bulgefit.model.parameters import check_replaced

    if args.undeformed:
        result = evaluate_resting(tests, **options)
    else:
        given = args.nu12 is not None or args.nu is not None or args.G is not None
        ratio = tests[0].poisson_ratio if given else stated_ratio(tests)
        ratios = given_ratios(args)
        take_found_moduli(args)
        held = held_from(args, tests)
        check_replaced(held, ratios)
        material = _common.material_from(args, ratio)
        _common.warn_of_moduli(args, material, tests[0].thickness)
        result = evaluate(tests, material, effects=held, **options)
    _common.deliver(args, result, result.report())
    return 0
