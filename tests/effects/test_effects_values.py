"""Which values of an effect's parameter mean something?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.effects.registry import acting, parameter_named
from bulgefit.errors import InputError
from bulgefit.model.parameters import as_effects
from bulgefit.model.simulation import simulate

#: A value that means nothing, and one beside it that does.
EDGES = {
    "clamp_slip.compliance": (-1e-9, 0.0, "must be 0 or more"),
    "rim_lift.amplitude": (-0.1, 0.0, "must be 0 or more"),
    "rim_lift.shape": (-0.1, 0.0, "must be 0 or more"),
    "creep.rate": (-0.1, 0.0, "must be 0 or more"),
    "dic_smoothing.window": (-1.0, 0.0, "must be 0 or more"),
    "reference_state.flattening": (-1.0, 0.0, "must be 0 or more"),
    "pressure_gain.gain": (-1.0, -0.999, "must be above -1"),
    "dic_scale.scale": (-1.0, -0.999, "must be above -1"),
    "depth_scale.scale_z": (-1.0, -0.999, "must be above -1"),
    "nonlinear_material.s_x": (-1.0, -0.999, "must be above -1"),
    "nonlinear_material.knee_y": (0.0, 1e-6, "must be above 0"),
    "clamp_shape.radius_error": (-1.0, -0.999, "must be above -1"),
    "clamp_shape.ellipticity": (-1.0, -0.999, "must be above -1"),
    "specimen_factor.warp": (0.0, 1e-6, "must be above 0"),
    "pressure_offset.offset": (np.nan, -1.0, "must be finite"),
}


@pytest.mark.parametrize("name", EDGES)
def test_a_value_that_means_nothing_is_refused(name: str) -> None:
    beyond, within, said = EDGES[name]
    with pytest.raises(InputError, match=f"^effects: {name} {said}, got"):
        as_effects({name: beyond})
    assert as_effects({name: within}) == {name: within}


def test_a_name_is_refused_as_well() -> None:
    with pytest.raises(InputError, match="clamp_slip has no parameter 'compliant'"):
        as_effects({"clamp_slip.compliant": 0.1})


def test_what_is_plausible_means_something() -> None:
    for effect in acting().values():
        for parameter in effect.parameters:
            for value in (parameter.lower, parameter.upper):
                parameter.require(value, parameter.name)
    # and what is hardly plausible is no nonsense
    parameter_named("initial_shape.h0").require(-50.0, "h0")


def test_a_simulation_refuses_it() -> None:
    given = {"E1": 300.0, "E2": 250.0, "G12": 5.0, "nu12": 0.24}
    with pytest.raises(InputError, match=r"^effects: clamp_slip\.compliance must be 0 or more"):
        simulate(given, 0.1, effects={"clamp_slip.compliance": -0.5})


@pytest.mark.parametrize(
    ("name", "beyond", "within"),
    [
        ("clamp_shape.ellipticity", 1.0, 0.9),
        # p (1 + f), f = c rⁿ cos nφ, has the area (1 + f)(1 + (n + 1) f) dA
        ("clamp_lobes.c3", 0.3, 0.24),
        ("rim_field.s4", -0.25, -0.19),
    ],
)
def test_an_opening_that_folds_over_itself_is_refused(
    name: str, beyond: float, within: float
) -> None:
    """Cells that were turned over made apexes that went down with pressure."""
    given = {"E1": 300.0, "E2": 250.0, "G12": 50.0, "nu12": 0.24}
    effect = name.partition(".")[0]
    with pytest.raises(InputError, match=f"folds over itself: let {effect} be smaller"):
        simulate(given, 0.01, effects={name: beyond})
    assert simulate(given, 0.01, effects={name: within}).apex[0] > 0.0
