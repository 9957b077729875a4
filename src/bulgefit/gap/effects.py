"""The catalogue: what may be missing from the model, with its parameters and plausible range.

Every effect is a parameter group held at its null in the baseline; diagnosing frees groups. A new
effect is one entry here and one term in its place (`bulgefit.model.places`, `.camera`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bulgefit.errors import InputError
from bulgefit.model.camera import FLATTENING, REFERENCE_MODES
from bulgefit.model.places import FOLD_ORDERS

__all__ = ["CATALOGUE", "FIELD", "MODULI", "STEADY", "Effect", "EffectParameter", "chosen_effects"]

MODULI = ("E1", "E2", "G12")

#: Key of the offset of every measured point.
FIELD = "reference_state.field"


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
        As the effect's report shows it; in the model it is `effect.name`.
    unit : str
    lower, upper : float
        Plausible range.
    start : float
        Where a fit starts; not the null where the effect is of second order there. On either side
        of the null, where both are plausible.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float = 0.0


@dataclass(frozen=True)
class Effect:
    """An unmodelled effect.

    Attributes
    ----------
    id, place, meaning : str
    parameters : tuple of EffectParameter
    forms : tuple of tuple of str
        Parameters of each form that the effect may take, the most flexible last: as flexible as
        held-out data pay for. Default: all parameters.
    field_forms : tuple of tuple of str
        Keys of further forms with an offset of every measured point in the place of the
        parameters so far; tried only once the form before is in the model.
    steady : tuple of str
        Parameters whose effect is the same in every frame: an offset of every point contains it.
    shared : bool
        True for the material: specimens of one fabric share it.
    needs_time : bool
    never_separable : str
        Why no test can tell it apart, else "".
    """

    id: str
    place: str
    meaning: str
    parameters: tuple[EffectParameter, ...]
    forms: tuple[tuple[str, ...], ...] = ()
    field_forms: tuple[tuple[str, ...], ...] = ()
    steady: tuple[str, ...] = ()
    shared: bool = False
    needs_time: bool = False
    never_separable: str = ""

    @property
    def all_keys(self) -> tuple[str, ...]:
        """Names of the parameters in the model."""
        return tuple(f"{self.id}.{p.name}" for p in self.parameters)

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Parameter groups that may be freed, one for each form."""
        if not self.forms:
            return (self.all_keys,)
        return tuple(tuple(f"{self.id}.{name}" for name in form) for form in self.forms)


def _stages(names: Sequence[str], *counts: int) -> tuple[tuple[str, ...], ...]:
    """Forms that contain the ones before."""
    return tuple(tuple(names[:count]) for count in counts)


def _several(names: Iterable[str], unit: str, size: float) -> tuple[EffectParameter, ...]:
    return tuple(EffectParameter(name, unit, -size, size) for name in names)


_AXES = ("x", "y", "z")
_TURNS, _SHIFTS = (tuple(f"{kind}_{a}" for a in _AXES) for kind in ("rotation", "shift"))
_FOLDS = tuple(f"{kind}{order}" for order in FOLD_ORDERS for kind in "cs")
_DOMES = ("h0", "hx", "hy", "c2", "s2", "h2", *_FOLDS)
_GAINS, _KNEES = ("k_x", "k_y"), ("s_x", "s_y", "knee_x", "knee_y")
# by degree, so that a stage is a full polynomial in all three components
_STATE = tuple(
    f"{axis}{i}{j}" for n in range(6) for axis in _AXES for i, j in REFERENCE_MODES if i + j == n
)

CATALOGUE: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        Effect(
            "initial_shape",
            "shape",
            "the fabric was not flat before inflation",
            _several(_DOMES, "mm", 10.0),
            forms=_stages(_DOMES, 1, 3, 6, 10, 14),
        ),
        Effect(
            "clamp_shape",
            "shape",
            "the clamp's opening is oval or of another radius",
            _several(("ellipticity", "radius_error"), "1", 0.03),
        ),
        Effect(
            "prestrain",
            "clamp",
            "the fabric was mounted slack (positive) or stretched (negative)",
            _several(("slack_x", "slack_y"), "1", 0.02),
        ),
        Effect(
            "clamp_slip",
            "clamp",
            "the fabric slips inwards at the clamp",
            (EffectParameter("compliance", "mm per N/mm", 0.0, 0.1, 1e-3),),
        ),
        Effect(
            "axis_misalignment",
            "material",
            "the warp axis is turned from x",
            (EffectParameter("angle", "degree", -45.0, 45.0),),
        ),
        Effect(
            "poisson_ratio",
            "material",
            "Poisson's ratio is not the one assumed",
            (EffectParameter("nu12", "1", 0.0, 0.5),),
            shared=True,
        ),
        Effect(
            "nonlinear_material",
            "material",
            "stress is not linear in strain along warp and fill",
            tuple(EffectParameter(n, "1", -2.0, 8.0) for n in _GAINS)
            # from no change of slope at all, a fit does not find where the knee is
            + tuple(EffectParameter(n, "1", -0.95, 3.0, 0.3) for n in _KNEES[:2])
            # a knee below 0.4 % strain would be that of another modulus
            + tuple(EffectParameter(n, "1", 0.004, 0.05, 0.015) for n in _KNEES[2:]),
            forms=(_GAINS, _KNEES, (*_GAINS, *_KNEES)),
            shared=True,
        ),
        Effect(
            "stiffness_gradient",
            "material",
            "stiffness (thickness) varies across the specimen",
            _several(("g_x", "g_y"), "1", 0.5),
        ),
        Effect(
            "creep",
            "material",
            "stiffness falls with the logarithm of time under load",
            (EffectParameter("rate", "1 per decade", 0.0, 0.2),),
            shared=True,
            needs_time=True,
        ),
        Effect(
            "pressure_offset",
            "load",
            "recorded minus true pressure",
            (EffectParameter("offset", "bar", -0.06, 0.06),),
        ),
        Effect(
            "pressure_gain",
            "load",
            "recorded pressure is true times 1 + gain",
            (EffectParameter("gain", "1", -0.05, 0.05),),
            never_separable="a gain of pressure is a gain of every modulus",
        ),
        Effect(
            "rigid_motion",
            "camera",
            "the camera's frame moved after the reference image",
            _several(_TURNS, "degree", 1.0) + _several(_SHIFTS, "mm", 2.0),
            forms=(_TURNS, (*_TURNS, *_SHIFTS)),
            steady=_SHIFTS,
        ),
        Effect(
            "fixture_motion",
            "camera",
            "the clamp tilts and shifts in proportion to the true pressure",
            _several(_TURNS, "degree/bar", 0.5) + _several(_SHIFTS, "mm/bar", 1.0),
        ),
        Effect(
            "reference_state",
            "camera",
            "the reference image shows the fabric already displaced",
            (
                *_several(_STATE, "mm", 10.0),
                EffectParameter("flattening", "bar", 0.0, 1.0, 0.02),
            ),
            forms=_stages(_STATE, 9, 18, 30, 45, 63),
            field_forms=((FIELD,), (FIELD, FLATTENING)),
            steady=_STATE,
        ),
        Effect(
            "registration",
            "camera",
            "the clamp's centre is not the origin of the DIC frame",
            _several(("x0", "y0"), "mm", 5.0),
        ),
        Effect(
            "dic_scale",
            "camera",
            "lengths are seen too long or too short",
            _several(("scale",), "1", 0.03),
        ),
        Effect(
            "dic_smoothing",
            "camera",
            "displacement is averaged over a window",
            (EffectParameter("window", "mm", 0.0, 15.0, 8.0),),
        ),
    )
}

#: Parameters that an offset of every point contains.
STEADY = frozenset(f"{effect.id}.{name}" for effect in CATALOGUE.values() for name in effect.steady)


def chosen_effects(names: Iterable[str] | None) -> list[Effect]:
    """Effects by id (default: all).

    Raises
    ------
    InputError
        Unknown names; the known ones are listed.
    """
    wanted = list(CATALOGUE if names is None else names)
    unknown = [n for n in wanted if n not in CATALOGUE]
    if unknown:
        raise InputError(
            f"effects: {', '.join(unknown)} unknown; choose from {', '.join(CATALOGUE)}"
        )
    return [CATALOGUE[n] for n in wanted]
