"""What do fit, evaluate and crossval share? How tests are compared, and how a fit searches."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common
from bulgefit.cli._effects import (
    add_effect_arguments,
    add_freeing_arguments,
    held_from,
    priors_from,
    uncertainty_from,
    with_from,
)
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bulgefit.dic import BulgeTest
    from bulgefit.fitting.options import FitOptions
    from bulgefit.model.setup import Setup

__all__ = [
    "add_comparison_arguments",
    "add_search_arguments",
    "check_search",
    "comparison_options",
    "inputs",
    "read_tests",
    "search_options",
    "up_to",
]

#: Part of a pressure by which units that are turned into each other leave it off.
_ROUNDING = 1e-9


def add_comparison_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how modelled and measured fields are compared."""
    group = parser.add_argument_group("comparison")
    group.add_argument(
        "--weight",
        metavar="W",
        help="weight of dz in e_w, or of dx,dy,dz (default: half the sum of the largest |dx| and "
        "|dy| over the largest |dz| of all tests, near 0.1)",
    )
    group.add_argument(
        "--average",
        default="points",
        metavar="HOW",
        help="points: mean over all points of a test, as the study's paper; frames: mean over "
        "each frame first, as its code (default: points)",
    )
    group.add_argument(
        "--evaluation",
        default=None,
        metavar="HOW",
        help="fields at the measured points by splines through the nodes (smooth), the cells' "
        "shape functions (shape), the study's radial basis functions (rbf) or the same on near "
        "nodes (local-rbf); all but smooth leave the mesh's error in (default: smooth)",
    )
    group.add_argument(
        "--interpolation",
        default=None,
        metavar="HOW",
        help="in pressure: dense output of the path (dense), linear between the study's 200 "
        "levels (study), or none: every frame is balanced (none); study leaves the mesh's error in "
        "(default: dense)",
    )
    group.add_argument(
        "--study",
        action="store_true",
        help="the published study's way: --evaluation rbf --interpolation study, the mesh's error "
        "left in (give its mesh with --mesh)",
    )
    group.add_argument(
        "--max-pressure",
        type=float,
        metavar="BAR",
        help="leave frames above this pressure (bar) out (default: all frames)",
    )
    _common.add_mesh_error_argument(
        group,
        "that of a --mesh stays, and any by --interpolation study or an --evaluation that is not "
        "smooth",
    )


def add_search_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is fitted and how."""
    group = parser.add_argument_group("fit")
    group.add_argument(
        "--objective",
        default="e_w",
        metavar="NAME",
        help="e: mean |dx| + |dy| + |dz| deviation; e_w: the same with dz weighted; e_z: |dz| at "
        "the point nearest the centre, all in mm; likelihood: Gaussian, with the noise's own size "
        "and correlation (default: e_w)",
    )
    group.add_argument(
        "--material",
        default="orthotropic",
        metavar="KIND",
        help="orthotropic (E1, E2, G12), isotropic (E) or isotropic-EG (E, G) "
        "(default: orthotropic)",
    )
    group.add_argument(
        "--free", default="", metavar="NAME", help="also fit nu12 (or nu), held otherwise"
    )
    group.add_argument(
        "--nu12",
        "--nu",
        type=float,
        metavar="RATIO",
        help="Poisson's ratio where it is held, nu12 or an isotropic nu (default: what the test "
        "says)",
    )
    group.add_argument(
        "--bounds",
        default="",
        metavar="E1=LOW:HIGH,...",
        help="bounds, of moduli in MPa (default: from the apex of the tests, an eighth to eight "
        "times the modulus that it implies, G12 a two hundredth to one; E a fifth to five, G a "
        "twelfth to two and a half; what is plausible of effects); equal ones "
        "(E1=330:330) hold a modulus",
    )
    group.add_argument(
        "--starts", type=int, default=5, metavar="N", help="scrambled-Sobol starts (default: 5)"
    )
    group.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the starts (default: 0)"
    )
    group.add_argument(
        "--method",
        default="gauss-newton",
        metavar="NAME",
        help="gauss-newton (on absolute residuals), or a scipy minimiser such as L-BFGS-B, SLSQP "
        "or Nelder-Mead (default: gauss-newton)",
    )
    group.add_argument(
        "--max-evaluations",
        type=int,
        default=100,
        metavar="N",
        help="forward paths of one start at most (default: 100)",
    )
    group.add_argument(
        "--tolerance",
        type=float,
        default=1e-6,
        metavar="X",
        help="stop where the objective falls by less than this part (default: 1e-6)",
    )
    add_effect_arguments(parser, fits=True)
    add_freeing_arguments(parser)
    _common.add_workers_argument(parser)
    _common.add_scheduler_argument(parser)


def inputs(args: argparse.Namespace) -> list[Path]:
    """The files that are read: of tests and, if given, a mesh, pressures and a held-out test."""
    from bulgefit.cli.tests_in import files_read

    others = [getattr(args, name, None) for name in ("mesh", "holdout", "from_file", "pressure")]
    return files_read([*args.tests, *others])


def read_tests(args: argparse.Namespace) -> list[BulgeTest]:
    """The tests of the command line, cut at --max-pressure, if no number is beyond sense."""
    from bulgefit.cli.tests_in import tests_from

    _check_numbers(args)
    tests = tests_from(args)
    if args.max_pressure is None:
        return tests
    return [up_to(test, args.max_pressure) for test in tests]


def _check_numbers(args: argparse.Namespace) -> None:
    """Refuse what no test could make sense of, before any is read: that may take a while."""
    if args.max_pressure is not None and not args.max_pressure > 0.0:
        raise InputError(f"--max-pressure {args.max_pressure:g}: give a pressure above 0 bar")
    if not hasattr(args, "starts"):  # of a verb that does not search
        return
    if args.starts < 1:
        raise InputError(f"--starts {args.starts}: give 1 or more")
    if args.max_evaluations < 1:
        raise InputError(f"--max-evaluations {args.max_evaluations}: give 1 or more")
    if not 0.0 < args.tolerance < 1.0:
        raise InputError(f"--tolerance {args.tolerance:g}: give a part between 0 and 1")
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: give 0 or more")


def up_to(test: BulgeTest, bar: float) -> BulgeTest:
    """The test without its frames above a pressure (bar)."""
    import numpy as np

    # 70 kPa and 0.07 MPa are 0.7 bar, though not in the last bits of their numbers
    kept = np.flatnonzero(10.0 * test.pressure <= bar * (1.0 + _ROUNDING))
    if not len(kept):
        raise InputError(
            f"--max-pressure {bar:g}: every frame of {test.name} lies above it "
            f"(from {10 * test.pressure.min():.3g} bar)"
        )
    return test.select(frames=kept)


def comparison_options(args: argparse.Namespace, tests: Sequence[BulgeTest]) -> dict[str, Any]:
    """Keyword arguments `weight`, `average` and `setup`."""
    return {"weight": _weight(args.weight), "average": args.average, "setup": _setup(args, tests)}


def search_options(args: argparse.Namespace, tests: Sequence[BulgeTest]) -> dict[str, Any]:
    """Keyword arguments of `fit` that the options stand for."""
    from bulgefit.fitting.minimise import Limits

    free = [name for name in args.free.split(",") if name]
    held = {**_held(args, free), **held_from(args, tests)}
    return {
        "material": args.material,
        "free": free,
        "bounds": _bounds(args.bounds),
        "held": held,
        "effects": with_from(args),
        "priors": priors_from(args),
        "uncertainty": uncertainty_from(args),
        "starts": args.starts,
        "seed": args.seed,
        "method": args.method,
        "limits": Limits(evaluations=args.max_evaluations, objective_change=args.tolerance),
    }


def check_search(
    args: argparse.Namespace, options: dict[str, Any], fits: Sequence[Sequence[BulgeTest]]
) -> FitOptions:
    """Refuse what cannot be fitted, before anything is said of a fit.

    Parameters
    ----------
    args : Namespace
    options : dict
        Keyword arguments of `fit`.
    fits : sequence of sequences of BulgeTest
        The tests of each fit.

    Returns
    -------
    FitOptions
        The options with the objective.

    Raises
    ------
    InputError
    """
    from bulgefit.dic.suspicions.sizes import about_bounds
    from bulgefit.fitting.options import options_from

    _common.workers_from(args)
    chosen = options_from(None, {"objective": args.objective, **options})
    for tests in fits:
        chosen.problem(tests)
    moduli = {name: ends for name, ends in chosen.bounds.items() if name.startswith("E")}
    for one in about_bounds(fits[0][0].thickness, moduli):
        _common.progress(args, f"warning: --bounds: {one.text}; {one.remedy}")
    return chosen


def _held(args: argparse.Namespace, free: Sequence[str]) -> dict[str, float]:
    """Poisson's ratio that --nu12 holds."""
    if args.nu12 is None:
        return {}
    if args.material == "isotropic-EG":
        raise InputError("--nu12 and isotropic-EG do not go together: G gives nu = E/2G - 1")
    name = "nu" if args.material == "isotropic" else "nu12"
    if name in free:
        raise InputError(f"--nu12 and --free {name} do not go together: one holds it, one fits it")
    if not math.isfinite(args.nu12):
        raise InputError(f"--nu12 {args.nu12:g}: give a finite ratio")
    return {name: args.nu12}


def _setup(args: argparse.Namespace, tests: Sequence[BulgeTest]) -> Setup:
    from bulgefit.fem.mesh import DEFAULT_REFINE
    from bulgefit.model.setup import Setup

    if args.study and (args.evaluation or args.interpolation):
        raise InputError("--study and --evaluation or --interpolation do not go together")
    return Setup(
        mesh=_common.mesh_from(args, tests[0].radius) if args.mesh is not None else None,
        refine=DEFAULT_REFINE if args.refine is None else args.refine,
        evaluation=args.evaluation or ("rbf" if args.study else "smooth"),
        interpolation=args.interpolation or ("study" if args.study else "dense"),
        correct_mesh=not (args.study or args.keep_mesh_error),
        **_common.solver_options(args),
    )


def _weight(text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        weights = [float(item) for item in text.split(",")]
    except ValueError:
        raise InputError(
            f"--weight {text!r}: give one number (of dz) or three (of dx,dy,dz)"
        ) from None
    if len(weights) == 3 and not any(weights):
        raise InputError(f"--weight {text}: nothing would be compared; give one weight above 0")
    return weights


def _bounds(text: str) -> dict[str, tuple[float, float]]:
    bounds = {}
    for item in filter(None, text.split(",")):
        name, equals, span = (part.strip() for part in item.partition("="))
        try:
            low, high = (float(part) for part in span.split(":"))
        except ValueError:
            equals = ""
        if not equals or not name:
            raise InputError(f"--bounds: {item!r} is not of the form NAME=LOW:HIGH, as E1=200:400")
        if name in bounds:
            raise InputError(f"--bounds: {name} is given twice; give it once")
        bounds[name] = (low, high)
    return bounds
