"""What is wrong with a made test, and by how much? Drawn from a seed; the blind trial's dice.

The catalogue's effects have the names, units and signs of docs/gap.md; beside them stand effects
that no catalogue entry describes. Nothing here comes from the model that diagnoses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from bulgefit.errors import InputError

__all__ = [
    "FOREIGN",
    "FORMS",
    "KINDS",
    "KNOWN",
    "Draw",
    "Wave",
    "draw",
    "firmer",
    "kind_of",
    "without",
]

#: Poisson's ratio that a made test states; the truth may differ.
STATED_POISSON_RATIO = 0.24

#: Pairs that no test tells apart, or where one is nearly silent: never drawn together.
_NOT_PAIRED = (
    {"clamp_shape", "dic_scale"},
    {"rigid_motion", "reference_state"},
)
_NEARLY_SILENT = ("pressure_gain", "poisson_ratio")

#: Wavelengths of a reference state, mm, and of its creases.
_WAVES, _CREASES = (320.0, 500.0), (35.0, 80.0)


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
    """

    effects: tuple[str, ...]
    parameters: dict[str, float]
    waves: tuple[Wave, ...]
    moduli: dict[str, float]

    def get(self, name: str, null: float = 0.0) -> float:
        """A parameter, or its null."""
        return self.parameters.get(name, null)

    @property
    def nu12(self) -> float:
        """The true Poisson's ratio."""
        return self.get("poisson_ratio.nu12", STATED_POISSON_RATIO)


def _either(rng: Generator, low: float, high: float) -> float:
    """A size, evenly in its logarithm, of either sign."""
    return _size(rng, low, high) * float(rng.choice([-1.0, 1.0]))


def _size(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _vector(rng: Generator, name: str, low: float, high: float) -> dict[str, float]:
    """Components name_x, name_y, name_z of a vector of drawn length and direction."""
    direction = rng.normal(size=3)
    vector = _size(rng, low, high) * direction / np.linalg.norm(direction)
    return {f"{name}_{axis}": float(v) for axis, v in zip("xyz", vector, strict=True)}


def _motion(rng: Generator, degree: float, mm: float, span: float) -> dict[str, float]:
    return {
        **_vector(rng, "rotation", degree / span, degree),
        **_vector(rng, "shift", mm / span, mm),
    }


def _initial_shape(rng: Generator) -> dict[str, float]:
    # a dome against the inflation would snap through: most are with it
    h0 = _size(rng, 0.5, 5.0) * float(rng.choice([1.0, -1.0], p=[0.8, 0.2]))
    names = ("hx", "hy", "c2", "s2", "h2")
    uneven = rng.uniform(-0.4, 0.4, size=5) * abs(h0) * (rng.random() < 0.5)
    return {"h0": h0, **{n: float(v) for n, v in zip(names, uneven, strict=True)}}


def _clamp_shape(rng: Generator) -> dict[str, float]:
    radius_error = _either(rng, 0.003, 0.01) if rng.random() < 0.5 else 0.0
    return {"ellipticity": _either(rng, 0.003, 0.015), "radius_error": radius_error}


def _poisson_ratio(rng: Generator) -> dict[str, float]:
    low, high = ((0.1, 0.17), (0.31, 0.4))[int(rng.integers(2))]
    return {"nu12": float(rng.uniform(low, high))}


def _gradient(rng: Generator) -> dict[str, float]:
    size, turn = _size(rng, 0.05, 0.25), rng.uniform(0, 2 * np.pi)
    return {"g_x": float(size * np.cos(turn)), "g_y": float(size * np.sin(turn))}


def _registration(rng: Generator) -> dict[str, float]:
    size, turn = _size(rng, 0.5, 3.0), rng.uniform(0, 2 * np.pi)
    return {"x0": float(size * np.cos(turn)), "y0": float(size * np.sin(turn))}


def _patch(rng: Generator) -> dict[str, float]:
    reach, turn = 60.0 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    return {
        "drop": float(rng.uniform(0.2, 0.5)),
        "width": float(rng.uniform(12.0, 22.0)),
        "x": float(reach * np.cos(turn)),
        "y": float(reach * np.sin(turn)),
    }


_Sizes = Callable[[Generator], dict[str, float]]

#: Sizes of the catalogue's effects.
KNOWN: dict[str, _Sizes] = {
    "initial_shape": _initial_shape,
    "clamp_shape": _clamp_shape,
    "prestrain": lambda rng: {n: _either(rng, 0.001, 0.008) for n in ("slack_x", "slack_y")},
    "clamp_slip": lambda rng: {"compliance": _size(rng, 0.005, 0.05)},
    "axis_misalignment": lambda rng: {"angle": _either(rng, 2.0, 15.0)},
    "poisson_ratio": _poisson_ratio,
    "nonlinear_material": lambda rng: {n: float(rng.uniform(1.0, 5.0)) for n in ("k_x", "k_y")},
    "stiffness_gradient": _gradient,
    "creep": lambda rng: {"rate": float(rng.uniform(0.02, 0.1))},
    "pressure_offset": lambda rng: {"offset": _either(rng, 0.01, 0.05)},
    "pressure_gain": lambda rng: {"gain": _either(rng, 0.01, 0.04)},
    "rigid_motion": lambda rng: _motion(rng, 0.5, 1.0, 10.0),
    "fixture_motion": lambda rng: _motion(rng, 0.3, 0.3, 6.0),
    "reference_state": lambda rng: {},  # its waves are drawn apart
    "registration": _registration,
    "dic_scale": lambda rng: {"scale": _either(rng, 0.003, 0.015)},
    "dic_smoothing": lambda rng: {"window": float(rng.uniform(4.0, 12.0))},
}

#: Effects that no catalogue entry describes.
FOREIGN: dict[str, _Sizes] = {
    # stiffness × (1 - drop exp(-d²/2 width²)), d the distance (mm) from (x, y)
    "soft_patch": _patch,
    # rim radius a (1 + lobe cos 3(φ - turn)); turn in degrees
    "lobed_rim": lambda rng: {
        "lobe": _size(rng, 0.004, 0.015),
        "turn": float(rng.uniform(0.0, 120.0)),
    },
    # the frame shifts in proportion to time; mm over the whole test
    "camera_drift": lambda rng: _vector(rng, "shift", 0.3, 1.5),
    # a point at distance r from the optical axis is seen at r (1 + bend r²/a²)
    "camera_bend": lambda rng: {"bend": _either(rng, 0.004, 0.015)},
    # the clamp slips in a sector alone: compliance × cos² towards its ends; degrees
    "slipping_sector": lambda rng: {
        "compliance": _size(rng, 0.02, 0.08),
        "middle": float(rng.uniform(0.0, 360.0)),
        "half_width": float(rng.uniform(30.0, 55.0)),
    },
}


def _knee(rng: Generator) -> dict[str, float]:
    slopes = {n: float(rng.uniform(-0.7, -0.3)) for n in ("s_x", "s_y")}
    return {**slopes, **{n: float(rng.uniform(0.008, 0.02)) for n in ("knee_x", "knee_y")}}


#: Forms of catalogue effects that the ordinary kinds do not take: the effect, and its sizes.
FORMS: dict[str, tuple[str, _Sizes]] = {
    # the fabric lay in creases on the reference image, and pressure flattens them by and by
    "creases": ("reference_state", lambda rng: {"flattening": _size(rng, 0.02, 0.3)}),
    "knee": ("nonlinear_material", _knee),
}

#: What a made test may be.
KINDS = ("none", *KNOWN, "two", *FOREIGN, *FORMS)


def kind_of(effects: tuple[str, ...] | list[str]) -> str:
    """`none`, `one`, `two` or `foreign`."""
    if any(effect in FOREIGN for effect in effects):
        return "foreign"
    return ("none", "one", "two")[len(effects)]


def draw(kind: str, rng: Generator, shrink: float = 1.0) -> Draw:
    """Draw a fabric and sizes of an effect.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    rng : Generator
    shrink : float
        Sizes are divided by a number between 1 and this, to find what is just detectable.

    Raises
    ------
    InputError
        The kind is unknown.
    """
    if kind not in KINDS:
        raise InputError(f"effects: {kind!r} is unknown; choose from {', '.join(KINDS)}")
    form, form_sizes = FORMS.get(kind, (kind, None))
    effects = _pair(rng) if kind == "two" else () if kind == "none" else (form,)
    smaller = 1.0 / _size(rng, 1.0, shrink)
    parameters = {}
    for effect in effects:
        sizes = (form_sizes or {**KNOWN, **FOREIGN}[effect])(rng)
        parameters.update(
            {f"{effect}.{n}": _shrunk(effect, n, v, smaller) for n, v in sizes.items()}
        )
    waves = _waves(rng, smaller) if "reference_state" in effects else ()
    if kind == "creases":
        waves += _waves(rng, 0.5 * smaller, _CREASES)
    moduli = {
        "E1": float(rng.uniform(280.0, 420.0)),
        "E2": float(rng.uniform(150.0, 260.0)),
        "G12": float(rng.uniform(12.0, 20.0)),
    }
    return Draw(effects, parameters, waves, moduli)


def firmer(drawn: Draw, rng: Generator) -> Draw:
    """The same with more shear stiffness: soft shear makes the fabric unstable."""
    shear = drawn.moduli["G12"] * float(rng.uniform(1.1, 1.4))
    return replace(drawn, moduli={**drawn.moduli, "G12": shear})


def without(drawn: Draw) -> Draw:
    """The same fabric with nothing wrong."""
    return Draw((), {}, (), drawn.moduli)


def _pair(rng: Generator) -> tuple[str, ...]:
    names = [n for n in KNOWN if n not in _NEARLY_SILENT]
    while True:
        one, other = rng.choice(len(names), size=2, replace=False)
        pair = names[int(one)], names[int(other)]
        if set(pair) not in _NOT_PAIRED:
            return pair


def _shrunk(effect: str, name: str, value: float, factor: float) -> float:
    """A size brought towards its null; what says where the effect sits stays."""
    if name in ("x", "y", "width", "turn", "middle", "half_width", "knee_x", "knee_y"):
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
            amplitude = share * factor * _size(rng, low, high)
            kx, ky = float(k * np.cos(turn)), float(k * np.sin(turn))
            out.append(Wave(axis, amplitude, kx, ky, float(rng.uniform(0, 2 * np.pi))))
    return tuple(out)
