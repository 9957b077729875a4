"""What is wrong with a made test, and by how much? Drawn from a seed; the blind trial's dice.

The catalogue's effects stand in `known`, those from outside it in `foreign`. Nothing here comes
from the model that diagnoses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from bulgefit.errors import InputError
from bulgefit.trial.dice import size
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.known import FORMS, KNOWN, NOT_TOGETHER, SILENT

__all__ = [
    "COUNTS",
    "KINDS",
    "STATED_POISSON_RATIO",
    "Draw",
    "Wave",
    "chosen_together",
    "draw",
    "draw_moduli",
    "draw_sizes",
    "enlarged",
    "firmer",
    "kind_of",
    "only",
    "sheared",
    "without",
]

#: Poisson's ratio that a made test states; the truth may differ.
STATED_POISSON_RATIO = 0.24

#: Kinds of tests with several causes, and how many.
COUNTS = {"two": 2, "three": 3, "four": 4, "five": 5, "six": 6}
#: Causes of the catalogue that a foreign effect may have beside it.
_BESIDE = (1, 2, 3)
#: A foreign effect must be told by its place, which takes more than telling that it is there:
#: its size is divided by no more than this.
_FOREIGN_SHRINK = 3.0

#: Wavelengths of a reference state, mm, and of its creases.
_WAVES, _CREASES = (320.0, 500.0), (35.0, 80.0)

#: Parameters that say where or in which form an effect sits; they have no null to shrink to.
_FORM: dict[str, tuple[str, ...]] = {
    "rim_lift": ("direction", "shape"),
    "fixture_motion": ("shape",),
    "nonlinear_material": ("knee_x", "knee_y"),
    "soft_patch": ("x", "y", "width"),
    "stiff_seam": ("normal", "distance", "width"),
    "stitched_sector": ("middle", "half_width"),
    "rotated_ply": ("share",),
    "slipping_sector": ("middle", "half_width"),
    "frame_bend": ("direction", "cycles", "phase"),
}


@dataclass(frozen=True)
class Wave:
    """A term amplitude cos(kx x + ky y + phase) of the displacement that a reference image shows.

    Attributes
    ----------
    axis : int
        0, 1, 2 for x, y, z.
    amplitude : float, mm
    kx, ky : float, 1/mm
    phase : float, rad
    """

    axis: int
    amplitude: float
    kx: float
    ky: float
    phase: float


@dataclass(frozen=True)
class Draw:
    """A fabric and what is wrong with its test.

    Attributes
    ----------
    effects : tuple of str
        Ids, catalogue or foreign; empty where nothing is wrong.
    parameters : dict of str to float
        `effect.parameter`, in the catalogue's units.
    waves : tuple of Wave
        Of `reference_state`.
    moduli : dict of str to float, MPa
        E1, E2, G12.
    shares : dict of str to float
        Size of each effect over what was drawn for it before it was made smaller; 1 if it is not
        here.
    mounted : float, degree
        Where the warp was mounted, which its test says: its angle to x, counter-clockwise.
    """

    effects: tuple[str, ...]
    parameters: dict[str, float]
    waves: tuple[Wave, ...]
    moduli: dict[str, float]
    shares: dict[str, float] = field(default_factory=dict)
    mounted: float = 0.0

    def get(self, name: str, null: float = 0.0) -> float:
        """A parameter, or its null."""
        return self.parameters.get(name, null)

    @property
    def nu12(self) -> float:
        """The true Poisson's ratio."""
        return self.get("poisson_ratio.nu12", STATED_POISSON_RATIO)


#: What a made test may be, beside a family.
KINDS = ("none", *KNOWN, *COUNTS, *FOREIGN, "beside", *FORMS)


def kind_of(effects: Sequence[str]) -> str:
    """`none`, `one`, `two`, `several` or `foreign`."""
    if any(effect in FOREIGN for effect in effects):
        return "foreign"
    return ("none", "one", "two", "several")[min(len(effects), 3)]


def draw(kind: str, rng: Generator, shrink: float = 1.0) -> Draw:
    """Draw a fabric and sizes of effects.

    Parameters
    ----------
    kind : str
        One of `KINDS`: nothing, an effect by its name, as many of the catalogue's as `COUNTS`
        says, a foreign effect `beside` one to three of them, or a form.
    rng : Generator
    shrink : float
        Each size is divided by a number of its own between 1 and this, to find what is just
        detectable; that of a foreign effect by no more than 3.

    Raises
    ------
    InputError
        The kind is unknown.
    """
    if kind not in KINDS:
        raise InputError(f"effects: {kind!r} is unknown; choose from {', '.join(KINDS)}")
    drawn = draw_sizes(_effects(kind, rng), rng, shrink, form=kind)
    return replace(drawn, moduli=draw_moduli(rng))


def draw_moduli(rng: Generator) -> dict[str, float]:
    """Moduli of a coated fabric, MPa."""
    return {
        "E1": float(rng.uniform(280.0, 420.0)),
        "E2": float(rng.uniform(150.0, 260.0)),
        "G12": float(rng.uniform(12.0, 20.0)),
    }


def draw_sizes(effects: Sequence[str], rng: Generator, shrink: float = 1.0, form: str = "") -> Draw:
    """Effects of drawn sizes on a fabric without moduli yet; `form` may be one of `FORMS`."""
    parameters: dict[str, float] = {}
    shares: dict[str, float] = {}
    waves: tuple[Wave, ...] = ()
    for effect in effects:
        foreign = effect in FOREIGN
        least = min(shrink, _FOREIGN_SHRINK) if foreign else shrink
        smaller = shares[effect] = 1.0 / size(rng, 1.0, least)
        usual = FOREIGN[effect].sizes if foreign else KNOWN[effect]
        sizes = FORMS[form][1] if form in FORMS else usual
        parameters |= {
            f"{effect}.{n}": _shrunk(effect, n, v, smaller) for n, v in sizes(rng).items()
        }
        if effect == "reference_state":
            waves = _waves(rng, smaller)
            if form == "creases":
                waves += _waves(rng, 0.5 * smaller, _CREASES)
    return Draw(tuple(effects), parameters, waves, {}, shares)


def enlarged(drawn: Draw, effect: str, by: float) -> Draw:
    """The same with one effect larger by this factor, but no larger than it was drawn at first."""
    full = 1.0 / drawn.shares.get(effect, 1.0)
    factor = min(by, full)
    sizes = {
        key: _shrunk(effect, name, value, factor)
        for key, value in drawn.parameters.items()
        if (name := key.removeprefix(f"{effect}.")) != key
    }
    waves = drawn.waves
    if effect == "reference_state":
        waves = tuple(replace(wave, amplitude=factor * wave.amplitude) for wave in waves)
    shares = {**drawn.shares, effect: factor / full}
    return replace(drawn, parameters={**drawn.parameters, **sizes}, waves=waves, shares=shares)


def firmer(drawn: Draw, rng: Generator) -> Draw:
    """The same with more shear stiffness: soft shear makes the fabric unstable."""
    return sheared(drawn, float(rng.uniform(1.1, 1.4)))


def sheared(drawn: Draw, factor: float) -> Draw:
    """The same with so many times the shear stiffness."""
    return replace(drawn, moduli={**drawn.moduli, "G12": factor * drawn.moduli["G12"]})


def only(drawn: Draw, effects: Sequence[str]) -> Draw:
    """The same fabric with these of its effects alone."""
    kept = {k: v for k, v in drawn.parameters.items() if k.split(".")[0] in effects}
    waves = drawn.waves if "reference_state" in effects else ()
    shares = {e: share for e, share in drawn.shares.items() if e in effects}
    return Draw(tuple(effects), kept, waves, drawn.moduli, shares)


def without(drawn: Draw) -> Draw:
    """The same fabric with nothing wrong."""
    return only(drawn, ())


def _effects(kind: str, rng: Generator) -> tuple[str, ...]:
    """Which effects a test of a kind has."""
    if kind == "none":
        return ()
    if kind in COUNTS:
        return chosen_together(COUNTS[kind], rng)
    if kind == "beside":
        names = [*FOREIGN]
        stranger = names[int(rng.integers(len(names)))]
        return (stranger, *chosen_together(int(rng.choice(_BESIDE)), rng))
    return (FORMS[kind][0] if kind in FORMS else kind,)


def chosen_together(number: int, rng: Generator) -> tuple[str, ...]:
    """So many effects of the catalogue that some test can tell apart."""
    names = [n for n in KNOWN if n not in SILENT]
    while True:
        picked = rng.choice(len(names), size=number, replace=False)
        effects = tuple(names[int(i)] for i in picked)
        if not any(pair <= {*effects} for pair in NOT_TOGETHER):
            return effects


def _shrunk(effect: str, name: str, value: float, factor: float) -> float:
    """A size brought towards its null; what says where the effect sits stays."""
    if name in _FORM.get(effect, ()):
        return value
    null = STATED_POISSON_RATIO if effect == "poisson_ratio" else 0.0
    return null + factor * (value - null)


def _waves(
    rng: Generator, factor: float, lengths: tuple[float, float] = _WAVES
) -> tuple[Wave, ...]:
    """Two waves of a component each, larger out of plane: a hanging, creased fabric."""
    out = []
    for axis, (low, high) in enumerate(((0.03, 0.2), (0.03, 0.2), (0.2, 1.0))):
        for share in (1.0, 0.5):
            k, turn = 2 * np.pi / rng.uniform(*lengths), rng.uniform(0, 2 * np.pi)
            amplitude = share * factor * size(rng, low, high)
            kx, ky = float(k * np.cos(turn)), float(k * np.sin(turn))
            out.append(Wave(axis, amplitude, kx, ky, float(rng.uniform(0, 2 * np.pi))))
    return tuple(out)
