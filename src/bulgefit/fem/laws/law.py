"""What is a law? Its name, its energy in plain NumPy, and what the kernels compile of it.

A kernel takes the law as an argument whose type tells which law it is, and calls the law's
functions as its attributes. So every law gets kernels of its own, compiled when it is first used,
and there is one source for all of them.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numpy.typing import NDArray

from bulgefit.fem.jit import merged
from bulgefit.fem.laws.potential import PARAMETERS

__all__ = ["Lanes", "Law"]

Values = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Lanes:
    """Compiled functions of a law that is a strain measure e under the common potential.

    They work on many points at once (`bulgefit.fem.lanes`): without branches or calls, and right
    for points that are moderately stretched.

    Attributes
    ----------
    straight : function (c11, c22, c12, q) -> 10 floats
        `Law.response` without bends, curves and couplings.
    bends : function (c11, c22, c12, q) -> 10 floats
        What they add to it.
    measure : function (c11, c22, c12) -> 12 floats
        Strain (e11, e22, 2 e12) and, row by row, ∂e_i/∂E_j.
    by_stiffness : function (c11, c22, c12, q) -> 4 x 3 floats
        As `Law.by_stiffness`.
    """

    straight: Any
    bends: Any
    measure: Any
    by_stiffness: Any


@dataclass(frozen=True, eq=False)
class Law:
    """Stored energy, stress and tangent of a material point.

    Functions of a law are compiled with numba if they are not already. They see the right
    Cauchy-Green tensor C = FᵀF in material axes by its components, and the parameters as a tuple
    q of floats, in the order of `bulgefit.fem.laws.potential.PARAMETERS`. W is the energy per
    reference volume (MPa), S = 2 ∂W/∂C the second Piola-Kirchhoff stress, CC = 4 ∂²W/∂C∂C.

    Attributes
    ----------
    name : str
    meaning : str
        In one clause, for the help text.
    energy : function ((3, ...) array, q) -> (...) array
        W at C11, C22, C12, in plain NumPy that also takes complex numbers: what the compiled
        functions are tested against.
    strain : function ((3, ...) array) -> (3, ...) array
        The law's strain e11, e22, 2 e12 at C11, C22, C12, in plain NumPy.
    response : function (c11, c22, c12, q) -> 10 floats
        W; S11, S22, S12; CC 11, 22, 33, 12, 13, 23 of a sheet that cannot wrinkle.
    natural : function q -> 2 floats
        C11 and C22 of the state without stress.
    by_stiffness : function (c11, c22, c12, q) -> 4 tuples of 3 floats, or None
        ∂(S11, S22, S12)/∂ each of D11, D22, D12, D33. None: taken as differences.
    lanes : Lanes or None
        For speed. None: points are taken one by one.
    logarithmic : bool
        For speed: stress is about linear in logarithms of stretches; wrinkles are sought by that.
    parameters : tuple of str
        Names of the entries of q that the law heeds.
    """

    name: str
    meaning: str
    energy: Callable[[Values, tuple[float, ...]], Values]
    strain: Callable[[Values], Values]
    response: Any
    natural: Any
    by_stiffness: Any = None
    lanes: Lanes | None = None
    logarithmic: bool = False
    parameters: tuple[str, ...] = PARAMETERS

    @cached_property
    def compiled(self) -> dict[str, Any]:
        """What kernels find as the law's attributes."""
        lanes = self.lanes or Lanes(self.response, self.response, _no_measure, _no_stiffness)
        return {
            "vectorised": self.lanes is not None,
            "logarithmic": self.logarithmic,
            "response": _dispatcher(self.response),
            "natural": _dispatcher(self.natural),
            "by_stiffness": _dispatcher(self.by_stiffness or _no_stiffness),
            "straight_in_lanes": _dispatcher(lanes.straight),
            "bends_in_lanes": _dispatcher(lanes.bends),
            "measure_in_lanes": _dispatcher(lanes.measure),
            "by_stiffness_in_lanes": _dispatcher(lanes.by_stiffness),
        }

    @cached_property
    def type(self) -> LawType:
        """What kernels know the law by: another one where its source is another."""
        source = inspect.getsourcefile(inspect.unwrap(_plain(self.response)))
        text = Path(source).read_bytes() if source and Path(source).is_file() else b""
        return LawType(self, hashlib.sha256(text).hexdigest())


@merged
def _no_measure(c11, c22, c12):
    """Stands where a law without lanes has no measure; what it gives is not read."""
    return (0.0,) * 12


@merged
def _no_stiffness(c11, c22, c12, q):
    """Stands where a law does not tell ∂S/∂D; what it gives is not read."""
    nothing = (0.0, 0.0, 0.0)
    return nothing, nothing, nothing, nothing


def _plain(function: Any) -> Any:
    return getattr(function, "py_func", function)


def _dispatcher(function: Any) -> Any:
    if isinstance(function, Dispatcher):
        return function
    return njit(error_model="numpy", nogil=True)(function)


class LawType(types.Type):
    """numba's type of one law."""

    #: Laws in use, by the name of their type: a type that comes from the cache knows only that.
    known: dict[str, Law] = {}  # noqa: RUF012

    def __init__(self, law: Law, digest: str) -> None:
        super().__init__(name=f"Law({law.name}, {digest})")
        self.known[self.name] = law

    @property
    def law(self) -> Law:
        return self.known[self.name]


register_model(LawType)(models.OpaqueModel)


@typeof_impl.register(Law)
def _type_of(law: Law, _: object) -> LawType:
    return law.type


@unbox(LawType)
def _take_in(_: LawType, __: object, compiler: Any) -> NativeValue:
    """Nothing of a law is left when a kernel runs: all is in its type."""
    return NativeValue(compiler.context.get_dummy_value())


@infer_getattr
class _Attributes(AttributeTemplate):
    key = LawType

    def generic_resolve(self, law: LawType, name: str) -> types.Type | None:
        found = law.law.compiled.get(name)
        if found is None:
            return None
        return types.boolean if isinstance(found, bool) else types.Dispatcher(found)


@lower_getattr_generic(LawType)
def _get_attribute(context: Any, _: object, law: LawType, __: object, name: str) -> Any:
    found = law.law.compiled[name]
    if isinstance(found, bool):
        return context.get_constant(types.boolean, found)
    return context.get_dummy_value()
