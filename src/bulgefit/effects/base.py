"""What is an effect? One object with its words, its parameters, and hooks into the five places.

An effect overrides only the hooks that it uses; everything else (the virtual test, fits, the
diagnosis, reports) is generic and reads attributes. Hooks get `own`, the values of all its
parameters by name. A hook at the nulls must change nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.further import Told
from bulgefit.effects.parameter import Parameter, ends_about
from bulgefit.effects.places import Clamping, Cloth, Load, Scene

__all__ = ["PLACES", "Effect", "several", "stages", "stiffening"]

Floats = NDArray[np.float64]
Own = Mapping[str, float]

PLACES = ("shape", "clamp", "material", "load", "camera")


class Effect:
    """What a real test may have that the ideal one has not.

    Attributes
    ----------
    id : str
        Also the name of its file.
    place : str
        One of `PLACES`.
    meaning : str
        What it is, in a line.
    remedy : str
        What a lab can do about it, in a line.
    parameters : tuple of Parameter
    forms : tuple of tuple of str
        Names of the parameters of each form that it may take; the last contains all others.
        Default: all parameters.
    shared : bool
        True for what belongs to the cloth: its specimens share it.
    of_rig : bool
        True for what belongs to clamp and cameras: tests on the same rig share it.
    factors : mapping of modulus to parameter
        What specimens have about the mean of their cloth: parameters that multiply its moduli. An
        effect with any is in every model of several specimens, in none of one, and no cause.
    needs : tuple of str
        Fields of a test without which it cannot be judged ("time").
    never_separable : str
        Why no test can tell it apart, else "".
    told : tuple of Told
        Further measurements that would tell parameters directly.
    order : int
        Among the effects of its place: lower ones act first.
    """

    id: ClassVar[str] = ""
    place: ClassVar[str] = ""
    meaning: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    forms: ClassVar[tuple[tuple[str, ...], ...]] = ()
    shared: ClassVar[bool] = False
    of_rig: ClassVar[bool] = False
    factors: ClassVar[Mapping[str, str]] = MappingProxyType({})
    needs: ClassVar[tuple[str, ...]] = ()
    never_separable: ClassVar[str] = ""
    told: ClassVar[tuple[Told, ...]] = ()
    order: ClassVar[int] = 0

    # shape

    def outline(self, own: Own, unit: Floats) -> Floats:
        """Positions (n, 2) in the plane, over the radius, of points (n, 2) of the unit disc."""
        return unit

    def height(self, own: Own, unit: Floats) -> Floats:
        """Stress-free height (n,) mm that it adds at points (n, 2) of the unit disc."""
        return np.zeros(len(unit))

    # clamp

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """The clamp with the effect."""
        return clamping

    # material

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """The cloth with the effect."""
        return cloth

    def thickening(self, own: Own, points: Floats) -> Mapping[str, Floats]:
        """∂ ln(thickness)/∂(each parameter), (m, 4), at points (m, 4, 2) of the unit disc.

        Of effects that change nothing else, where it is known in closed form: parameters that are
        many need no differences of descriptions then.
        """
        return {}

    # load

    def load(self, own: Own, load: Load) -> Load:
        """The load with the effect."""
        return load

    # camera

    def locate(self, own: Own, seen: Floats, radius: float) -> Floats:
        """Positions (n, 2) mm, in the cameras' frame, of points that are seen at `seen` (n, 2)."""
        return seen

    def centre(self, own: Own) -> tuple[float, float]:
        """Where (mm) it puts the clamp's centre in the cameras' frame."""
        return 0.0, 0.0

    def face(self, own: Own) -> float:
        """Share of the thickness by which the face that is seen lies above the middle."""
        return 0.0

    def window(self, own: Own) -> float:
        """Square (mm²) of the radius over which it averages displacements."""
        return 0.0

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """Displacements (frames, n, 3) mm as it reports them, of displacements `moved`."""
        return moved

    def see_height(self, own: Own, height: Floats) -> Floats:
        """Heights (n,) mm before inflation as it reports them, of heights `height`."""
        return height

    def motion(self, own: Own, scene: Scene) -> tuple[Floats, Floats]:
        """Rotation vector (degree) and shift (mm) of the frame, each (frames, 3)."""
        none = np.zeros((len(scene.pressure), 3))
        return none, none

    def at_rest(self, own: Own, reference: Floats, radius: float) -> Floats:
        """Displacement (n, 3) mm that points (n, 3) mm have in the reference image already."""
        return np.zeros_like(reference)

    # what is derived

    @classmethod
    def uses(cls, *hooks: str) -> bool:
        """Whether it overrides any of these hooks."""
        return any(getattr(cls, hook) is not getattr(Effect, hook) for hook in hooks)

    def parameter(self, name: str) -> Parameter:
        """One of its parameters; KeyError."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def is_hidden_by(self, other: Effect) -> bool:
        """Whether another effect does to first order what this one does.

        Membranes stretch by the squares of slopes: where pressure lifts a cloth to hardly depends
        on how high it lay, so a height before inflation shifts what is seen by as much in all
        frames, as does what the points have moved by in the reference image.
        """
        return self.uses("height") and other.uses("at_rest")

    def span(self, name: str, value: float) -> tuple[float, float]:
        """Values below and above one of a parameter, to take a difference over."""
        return ends_about(value, self.parameter(name).step)

    @property
    def scatters(self) -> bool:
        """Whether it is what specimens of a cloth scatter by."""
        return bool(self.factors)

    @property
    def names(self) -> tuple[str, ...]:
        """Its parameters as commands and JSON write them: `effect.parameter`."""
        return tuple(f"{self.id}.{p.name}" for p in self.parameters)

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Names (`effect.parameter`) that may be freed together, one group for each form."""
        forms = self.forms or (tuple(p.name for p in self.parameters),)
        return tuple(tuple(f"{self.id}.{name}" for name in form) for form in forms)


def stages(names: tuple[str, ...], *counts: int) -> tuple[tuple[str, ...], ...]:
    """Forms that contain the ones before: the first so many names."""
    return tuple(names[:count] for count in counts)


def several(
    names: tuple[str, ...],
    unit: str,
    size: float,
    *,
    prior: float,
    reason: str,
    step: float,
    above: float | None = None,
) -> tuple[Parameter, ...]:
    """Parameters that are alike, plausible from -size to size."""
    return tuple(
        Parameter(name, unit, -size, size, prior=prior, reason=reason, step=step, above=above)
        for name in names
    )


def stiffening(governor: str | None = None) -> Parameter:
    """The `shape` (1/bar) by which what pressure moves on screws goes less and less (`concave`)."""
    return Parameter(
        "shape",
        "1/bar",
        0.0,
        5.0,
        prior=0.5,
        reason="screws stiffen by the order of their own load",
        step=1e-5,
        governor=governor,
    )
