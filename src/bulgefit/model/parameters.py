"""Materials: their parameters, units and bounds, and the stiffness that they give."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key, Parameter
from bulgefit.effects.registry import parameter_named
from bulgefit.errors import InputError, needed
from bulgefit.fem.elasticity import STIFFEST, isotropic_constants, orthotropic_stiffness

__all__ = [
    "HELD_BY_DEFAULT",
    "MATERIALS",
    "Material",
    "as_effects",
    "as_material",
    "as_values",
    "check_replaced",
    "material",
]

Floats = NDArray[np.float64]


def _modulus(name: str, lower: float, upper: float) -> Parameter:
    return Parameter(name, "MPa", lower, upper, null=None, coordinate="log")


#: Parameters of each kind of material, in order; `nu12` and `nu` are held unless freed.
#: The bounds of the moduli are the published study's, for tests that imply none.
MATERIALS: dict[str, tuple[Parameter, ...]] = {
    "orthotropic": (
        _modulus("E1", 100.0, 400.0),
        _modulus("E2", 50.0, 300.0),
        _modulus("G12", 2.0, 10.0),
        Parameter("nu12", "1", 0.0, 0.5, null=None),
    ),
    "isotropic": (
        _modulus("E", 50.0, 500.0),
        Parameter("nu", "1", 0.0, 0.49, null=None),
    ),
    "isotropic-EG": (
        _modulus("E", 50.0, 500.0),
        _modulus("G", 20.0, 200.0),
    ),
}

#: Parameters that a fit holds at the test's Poisson ratio unless they are freed.
HELD_BY_DEFAULT = ("nu12", "nu")


@dataclass(frozen=True)
class Material:
    """A kind of material with values: the only place where moduli become a stiffness.

    Attributes
    ----------
    kind : str
        A key of `MATERIALS`.
    values : dict of str to float
        Moduli in MPa, Poisson ratio 1, in the order of `MATERIALS`.

    Raises
    ------
    InputError
        Unknown kind, missing or unknown parameters.
    """

    kind: str
    values: dict[str, float]

    def __post_init__(self) -> None:
        names = [p.name for p in parameters_of(self.kind)]
        missing = [n for n in names if n not in self.values]
        unknown = [n for n in self.values if n not in names]
        if missing or unknown:
            raise InputError(
                f"material {self.kind} takes {', '.join(names)}"
                + (f"; missing: {', '.join(missing)}" if missing else "")
                + (f"; unknown: {', '.join(unknown)}" if unknown else "")
            )

    def constants(self) -> dict[str, float]:
        """E1, E2, G12 (MPa) and nu12; raises InputError where they are not admissible."""
        if self.kind == "orthotropic":
            return dict(self.values)
        return isotropic_constants(self.values)

    def stiffness(self) -> Floats:
        """D11, D22, D12, D33 in MPa; raises InputError where the energy is not positive."""
        c = self.constants()
        return orthotropic_stiffness(c["E1"], c["E2"], c["G12"], c["nu12"])

    def constants_derivative(self) -> Floats:
        """∂(E1, E2, G12, nu12)/∂(values), (4, parameters)."""
        c = self.constants()
        if self.kind == "orthotropic":
            return np.eye(4)
        modulus, shear, nu = c["E1"], c["G12"], c["nu12"]
        if self.kind == "isotropic":  # G = E / 2(1 + nu)
            return np.array([[1, 0], [1, 0], [shear / modulus, -shear / (1 + nu)], [0, 1]])
        # nu = E/2G - 1
        return np.array(
            [[1, 0], [1, 0], [0, 1], [0.5 / shear, -0.5 * modulus / shear**2]], dtype=float
        )


def material(kind: str, **values: float) -> Material:
    """A material of a kind with every parameter given.

    Raises
    ------
    InputError
        Unknown kind, missing or unknown parameters, or values that are not admissible.
    """
    names = [p.name for p in parameters_of(kind)]
    given = as_values(values, "material", ", ".join(names))
    # what is missing, Material tells
    made = Material(kind, {n: given[n] for n in [*names, *values] if n in given})
    made.stiffness()
    return made


def as_material(given: Material | Mapping[str, float], poisson_ratio: float) -> Material:
    """A material as it is, or of the parameters that a mapping gives.

    Parameters
    ----------
    given : Material or mapping
        E1, E2, G12 (MPa); or E, or E and G.
    poisson_ratio : float
        Where the mapping gives none.

    Raises
    ------
    InputError
        Missing or unknown parameters, or values that are not admissible.
    """
    if isinstance(given, Material):
        return given
    given = as_values(given, "material", "E1, E2 and G12 in MPa, or E, or E and G")
    if "E1" in given or "E2" in given:
        return material("orthotropic", **{"nu12": poisson_ratio, **given})
    if "G" in given:
        return material("isotropic-EG", **given)
    return material("isotropic", **{"nu": poisson_ratio, **given})


def as_effects(given: Any) -> dict[str, float]:
    """Effects' parameters by `effect.parameter`, none where None is given.

    Raises
    ------
    InputError
        It is no mapping of names to numbers, a name is unknown, or a value means nothing.
    """
    values = as_values({} if given is None else given, "effects", "effect.parameter to value")
    for name, value in values.items():
        parameter_named(Key.read(name).name).require(value, f"effects: {name}")
    return values


def check_replaced(effects: Iterable[str], stated: Iterable[str]) -> None:
    """Refuse what is stated of the material where an effect takes its place, and it does nothing.

    Parameters
    ----------
    effects : iterable of str
        Names of effects' parameters, held or fitted.
    stated : iterable of str
        Names of the material's parameters that were asked for.

    Raises
    ------
    InputError
    """
    ratios = [name for name in stated if name in HELD_BY_DEFAULT]
    for name in effects:
        # an effect without a null of its own is nothing but another value of the material's
        if ratios and parameter_named(Key.read(name).name).null is None:
            raise InputError(f"{name} takes the place of {ratios[0]}: give one of them")


def as_values(given: Any, what: str, such_as: str) -> dict[str, float]:
    """Numbers by name.

    Parameters
    ----------
    given : mapping
    what, such_as : str
        What they are, and what could be given, for the message.

    Raises
    ------
    InputError
        It is no mapping, a name is no string, or a value no number.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"{what}: {given!r} names no values; give a dict of {such_as}")
    for name, value in given.items():
        if not isinstance(name, str):
            raise InputError(f"{what}: {name!r} is no name; give a dict of {such_as}")
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise InputError(f"{what}: {name} must be a number, got {value!r}")
    return {name: float(value) for name, value in given.items()}


def parameters_of(kind: str) -> tuple[Parameter, ...]:
    """Parameters of a kind of material; raises InputError for an unknown kind."""
    if needed(kind, str, "the name of a material") not in MATERIALS:
        raise InputError(f"material: {kind!r} is unknown; choose from {', '.join(MATERIALS)}")
    return MATERIALS[kind]


def free_parameters(
    kind: str,
    free: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Parameter, ...]:
    """Parameters that a fit varies, with its bounds.

    Parameters
    ----------
    kind : str
    free : iterable of str
        Parameters freed beyond the default (`nu12`, `nu`).
    bounds : mapping of name to (lower, upper), optional
        In the parameter's unit; others keep their default. Equal ones hold a parameter, which then
        is not varied.

    Raises
    ------
    InputError
        Unknown names; bounds that are reversed, not finite, or not positive for a modulus.
    """
    known = {p.name: p for p in parameters_of(kind)}
    wanted = [n for n in known if n not in HELD_BY_DEFAULT]
    for name in free:
        if name not in known:
            raise InputError(f"free: {name!r} is no parameter of {kind} ({', '.join(known)})")
        if name not in wanted:
            wanted.append(name)
    limits = dict(bounds or {})
    for name, (lower, upper) in limits.items():
        if name not in known:
            raise InputError(f"bounds: {name!r} is no parameter of {kind} ({', '.join(known)})")
        if name not in wanted:
            raise InputError(f"bounds: {name} is held fixed; free it to bound it")
        if not (math.isfinite(lower) and math.isfinite(upper)):
            raise InputError(f"bounds of {name} must be finite, got {lower:g}:{upper:g}")
        if lower > upper:
            raise InputError(f"bounds of {name} are reversed: {lower:g}:{upper:g}")
        if known[name].unit == "MPa" and lower <= 0:
            raise InputError(f"bounds of {name} must be positive, got {lower:g}:{upper:g} MPa")
        if known[name].unit == "MPa" and upper > STIFFEST:
            raise InputError(
                f"bounds of {name} must be at most {STIFFEST:g} MPa, got {lower:g}:{upper:g}"
            )
    return tuple(
        replace(known[n], lower=limits[n][0], upper=limits[n][1]) if n in limits else known[n]
        for n in known
        if n in wanted and not (n in limits and held_by(limits[n]))
    )


def held_by(bounds: tuple[float, float]) -> bool:
    """Whether bounds hold a parameter: they are equal."""
    return bounds[0] == bounds[1]
