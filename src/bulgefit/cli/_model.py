"""Which model stands beside a measurement? That of moduli and effects that are given, or found."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from bulgefit.cli import _common
from bulgefit.cli._effects import (
    add_effect_arguments,
    found_law,
    given_ratios,
    held_from,
    take_found_moduli,
)
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest
    from bulgefit.model.predict import Predicted

__all__ = ["add_model_arguments", "has_model", "predicted_from"]

_MODULI = ("E1", "E2", "G12", "nu12", "E", "nu", "G")


def add_model_arguments(parser: argparse.ArgumentParser) -> None:
    """Add moduli, --hold and --from."""
    _common.add_material_arguments(parser, "what the test says")
    add_effect_arguments(parser)


def has_model(args: argparse.Namespace) -> bool:
    """Whether a material or --from is given."""
    return args.from_file is not None or any(getattr(args, name) is not None for name in _MODULI)


def predicted_from(args: argparse.Namespace, test: BulgeTest) -> Predicted | None:
    """What the model says, where there is one."""
    if not has_model(args):
        if args.hold:
            raise InputError("--hold: sets an effect of a model; give a material too")
        return None
    from bulgefit.model.parameters import check_replaced
    from bulgefit.model.predict import predict
    from bulgefit.model.setup import Setup

    ratios = given_ratios(args)
    take_found_moduli(args)
    held = held_from(args)
    check_replaced(held, ratios)
    material = _common.material_from(args, test.poisson_ratio)
    _common.warn_of_moduli(args, material, test.thickness)
    law = found_law(args)
    setup = None if law is None else Setup(law=law)
    return predict(test, material, effects=held, setup=setup)
