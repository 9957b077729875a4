"""Bulge tests made with a known effect, for checking a diagnosis on data whose effect it is not
told.

What is wrong and by how much is drawn in `draw`, the fabric is balanced in `fabric`,
and the camera looks at it in `camera`. None of it uses the model that diagnoses, beside the
membrane's own law and equilibrium.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fem.elasticity import orthotropic_stiffness_derivative
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.trial.camera import (
    NodalField,
    Setting,
    holes,
    material_points,
    noise,
    observe,
)
from bulgefit.trial.draw import STATED_POISSON_RATIO, Draw, draw, firmer, kind_of, without
from bulgefit.trial.fabric import (
    FINENESS,
    UnstableDrawError,
    balance,
    hexagon,
    path_of,
    softening,
    true_load,
)

__all__ = ["Made", "Recipe", "make_test", "noise_free"]

Floats = NDArray[np.float64]

#: Draws of a firmer fabric before giving up.
_TRIES = 12
_BAR = 0.1  # MPa


@dataclass(frozen=True)
class Recipe:
    """How large made tests are; the defaults are those of the blind trial.

    Attributes
    ----------
    frames : int
    spacing : float, mm
        Of the measured points.
    fineness : int
        Of the mesh, a multiple of 8 (`fabric.hexagon`).
    shrink : float
        Sizes of effects are divided by up to this.
    """

    frames: int = 20
    spacing: float = 4.6
    fineness: int = FINENESS
    shrink: float = 1.0


@dataclass(frozen=True, eq=False)
class Made:
    """A made test and its truth, ready for JSON.

    Attributes
    ----------
    test : BulgeTest
    truth : dict
        `kind` (none, one, two, foreign), `effects`, `parameters` (effect to name to value, in the
        catalogue's units), `waves`, `moduli` (MPa), `nu12`, `noise_mm` (in plane, out of plane),
        `signature_mm` (rms of what the effects change) and `signature_left_mm` (of what changed
        moduli cannot imitate), `nonce`.
    """

    test: BulgeTest
    truth: dict[str, Any] = field(repr=False)


def make_test(
    kind: str, seed: int | SeedSequence, recipe: Recipe | None = None, name: str = "test"
) -> Made:
    """Make a test from a seed.

    Parameters
    ----------
    kind : str
        One of `draw.KINDS`.
    seed : int or SeedSequence
        The same seed gives the same test.
    recipe : Recipe, optional
    name : str

    Raises
    ------
    InputError
        The kind is unknown.
    UnstableDrawError
        No stable fabric was drawn.
    """
    recipe = recipe or Recipe()
    rng = default_rng(seed)
    drawn = draw(kind, rng, recipe.shrink)
    setting = _setting(drawn, rng, recipe)
    with one_blas_thread():
        drawn, height, seen, signature = _stable(drawn, setting, rng, recipe)
        size = float(rng.uniform(5e-3, 9e-3)), float(rng.uniform(10e-3, 18e-3))
        test = _recorded(setting, height, seen, size, rng, name, timed=_has_clock(drawn, rng))
    truth = {**_truth(drawn), "noise_mm": size, **signature, "nonce": rng.bytes(16).hex()}
    return Made(test, truth)


def noise_free(drawn: Draw, setting: Setting, fineness: int = FINENESS) -> tuple[Floats, Floats]:
    """Reference heights (n,) and displacements (frames, n, 3) mm as seen, without noise.

    Raises
    ------
    UnstableDrawError
    """
    shapes = balance(
        drawn,
        true_load(drawn, setting.pressure),
        softening(drawn, setting.time),
        radius=setting.radius,
        thickness=setting.thickness,
        fineness=fineness,
    )
    return observe(drawn, setting, shapes)


def _stable(
    drawn: Draw, setting: Setting, rng: Generator, recipe: Recipe
) -> tuple[Draw, Floats, Floats, dict[str, float]]:
    """The draw, or one firmer in shear, that is stable at every pressure; what is seen of it."""
    for _ in range(_TRIES):
        try:
            height, seen = noise_free(drawn, setting, recipe.fineness)
            return drawn, height, seen, _signature(drawn, setting, seen, recipe.fineness)
        except UnstableDrawError:
            drawn = firmer(drawn, rng)
    raise UnstableDrawError("made test: no stable fabric was drawn; try another seed")


def _setting(drawn: Draw, rng: Generator, recipe: Recipe) -> Setting:
    time = np.cumsum(10.0 * np.exp(rng.normal(0.0, 0.5, size=recipe.frames)))
    # two holds at pressure
    holds = rng.choice(np.arange(1, recipe.frames), size=2, replace=False)
    for frame in holds:
        time[frame:] += rng.uniform(40.0, 200.0)
    setting = Setting(_points(rng, recipe.spacing), _pressures(drawn, rng, recipe.frames), time)
    # the camera sees no fabric beyond the clamp
    rim = setting.radius * (1.0 - 0.02)
    inside = np.hypot(*material_points(drawn, setting).T) < rim
    return Setting(setting.reference[inside], setting.pressure, setting.time)


def _points(rng: Generator, spacing: float) -> Floats:
    """A jittered square grid (n, 2) mm inside a circle."""
    reach = rng.uniform(94.0, 97.0)
    line = np.arange(-reach - spacing, reach + 2 * spacing, spacing) + rng.uniform(0, spacing)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    grid = grid + rng.uniform(-0.25, 0.25, size=grid.shape) * spacing
    return grid[np.hypot(*grid.T) < reach]


def _pressures(drawn: Draw, rng: Generator, frames: int) -> Floats:
    """Recorded pressures (frames,) MPa, increasing, from a low first one."""
    low, high = rng.uniform(0.03, 0.05), rng.uniform(2.4, 2.9)
    step = (high - low) / (frames - 1)
    bar = low + step * (np.arange(frames) + rng.uniform(-0.35, 0.35, size=frames))
    bar[0], bar[-1] = low, high
    # a gauge that reads too little may not make the first recorded pressure vanish
    true = bar + max(0.0, 0.01 - drawn.get("pressure_offset.offset") - low)
    gain = 1.0 + drawn.get("pressure_gain.gain")
    return _BAR * (true * gain + drawn.get("pressure_offset.offset"))


def _has_clock(drawn: Draw, rng: Generator) -> bool:
    return bool(rng.random() < 0.6) or "creep" in drawn.effects


def _recorded(
    setting: Setting,
    height: Floats,
    seen: Floats,
    size: tuple[float, float],
    rng: Generator,
    name: str,
    *,
    timed: bool,
) -> BulgeTest:
    """The test with noise and holes; half of them with static images, or with heights kept."""
    points, frames = setting.reference, len(setting.pressure)
    static = 4 if rng.random() < 0.5 else 0
    kept = rng.random() < 0.5
    errors = noise(rng, points, frames + static, size, float(rng.uniform(8.0, 12.0)))
    seen = seen + errors[:frames]
    seen[holes(rng, points, frames)] = np.nan
    z = height + rng.normal(0.0, size[1], size=len(points)) if kept else np.zeros(len(points))
    return BulgeTest.from_arrays(
        np.column_stack([points, z]),
        seen,
        setting.pressure,
        name=name,
        radius=setting.radius,
        thickness=setting.thickness,
        poisson_ratio=STATED_POISSON_RATIO,
        static_displacement=errors[frames:] if static else None,
        time=setting.time if timed else None,
    )


def _truth(drawn: Draw) -> dict[str, Any]:
    parameters: dict[str, dict[str, float]] = {effect: {} for effect in drawn.effects}
    for key, value in drawn.parameters.items():
        effect, name = key.split(".", 1)
        parameters[effect][name] = value
    return {
        "kind": kind_of(drawn.effects),
        "effects": list(drawn.effects),
        "parameters": parameters,
        "waves": [asdict(wave) for wave in drawn.waves],
        "moduli": drawn.moduli,
        "nu12": drawn.nu12,
    }


def _signature(drawn: Draw, setting: Setting, seen: Floats, fineness: int) -> dict[str, float]:
    """How much the effects change what is seen, rms in mm: all of it, and what the moduli leave."""
    if not drawn.effects:
        return {"signature_mm": 0.0, "signature_left_mm": 0.0}
    clean = without(drawn)
    change = seen - noise_free(clean, setting, fineness)[1]
    columns = _by_moduli(clean, setting, fineness).reshape(3, -1)
    weights, *_ = np.linalg.lstsq(columns.T, change.ravel(), rcond=None)
    left = change.ravel() - weights @ columns
    points = change.size / 3
    return {
        "signature_mm": float(np.sqrt((change**2).sum() / points)),
        "signature_left_mm": float(np.sqrt((left**2).sum() / points)),
    }


def _by_moduli(clean: Draw, setting: Setting, fineness: int) -> Floats:
    """∂(displacement)/∂(E1, E2, G12), (3, frames, n, 3) mm/MPa, on the coarse mesh."""
    mesh = hexagon(fineness // 2)
    _, path = path_of(
        clean,
        mesh,
        setting.pressure,
        radius=setting.radius,
        thickness=setting.thickness,
        sensitivities=True,
    )
    by_stiffness = path.stiffness_sensitivity(setting.pressure)
    m = clean.moduli
    chain = orthotropic_stiffness_derivative(m["E1"], m["E2"], m["G12"], clean.nu12)[:, :3]
    nodal = np.einsum("dm,dfnc->mfnc", chain, by_stiffness)
    return NodalField(setting.radius * mesh.nodes, material_points(clean, setting))(nodal)
