"""Bulge tests made with a known effect, for checking a diagnosis on data whose effect it is not
told.

What is wrong and by how much is drawn in `draw`, the fabric is balanced in `fabric`,
and the camera looks at it in `camera`. None of it uses the model that diagnoses, beside the
membrane's own law and equilibrium.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.trial.cloth import laminate
from bulgefit.trial.draw import Draw, draw, enlarged, firmer, kind_of
from bulgefit.trial.fabric import UnstableDrawError
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.known import SILENT
from bulgefit.trial.recording import Recipe, has_clock, place, record
from bulgefit.trial.signature import noise_free, of_all, of_each

__all__ = ["Made", "Recipe", "audible", "make_test", "noise_size", "truth_of", "until_stable"]

Floats = NDArray[np.float64]
Drawn = TypeVar("Drawn")
Seen = TypeVar("Seen")

#: Draws of a firmer fabric before giving up.
_TRIES = 12
#: Standard deviations of the noise, mm.
_IN_PLANE, _OUT_OF_PLANE = (5e-3, 9e-3), (10e-3, 18e-3)


@dataclass(frozen=True, eq=False)
class Made:
    """A made test and its truth, ready for JSON.

    Attributes
    ----------
    test : BulgeTest
    truth : dict
        `kind` (none, one, two, several, foreign), `effects`, `parameters` (effect to name to
        value, in the catalogue's units), `waves`, `moduli` (MPa), `nu12`, of plies askew
        `stiffness_MPa` (3, 3) about the warp, `places` and `where` of
        foreign effects, `noise_mm` (in plane, out of plane), `interpolated`, `signature_mm` (rms
        of what the effects change), `signature_left_mm` (of what changed moduli cannot imitate),
        `signatures` (the same of each effect beside the others), `nonce`.
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
        One of `draw.KINDS`; "none" makes tests without any effect, for a fit.
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
    drawn = replace(draw(kind, rng, recipe.shrink), mounted=recipe.mounted)
    with one_blas_thread():
        if recipe.audible:
            drawn = audible(drawn, rng.spawn(1)[0], recipe)
        setting = place(drawn, rng, recipe)

        def look(one: Draw) -> tuple[Floats, Floats, dict[str, Any]]:
            height, seen = noise_free(one, setting, recipe.fineness)
            whole = of_all(one, setting, seen, recipe.fineness)
            return height, seen, {**whole, "signatures": of_each(one, setting)}

        drawn, (height, seen, signature) = until_stable(drawn, rng, look, firmer)
        size = noise_size(rng)
        timed = has_clock(drawn, rng)
        test = record(setting, height, seen, size, rng, name, recipe, timed=timed)
    truth = {
        **truth_of(drawn),
        "noise_mm": size,
        "interpolated": recipe.interpolated,
        **signature,
        "nonce": rng.bytes(16).hex(),
    }
    return Made(test, truth)


def until_stable(
    drawn: Drawn,
    rng: Generator,
    look: Callable[[Drawn], Seen],
    firm: Callable[[Drawn, Generator], Drawn],
) -> tuple[Drawn, Seen]:
    """What was drawn, made firmer until it has a stable shape at every pressure, and its look.

    Raises
    ------
    UnstableDrawError
        It has none even then.
    """
    for _ in range(_TRIES):
        try:
            return drawn, look(drawn)
        except UnstableDrawError:
            drawn = firm(drawn, rng)
    raise UnstableDrawError("made test: no stable fabric was drawn; try another seed")


def audible(drawn: Draw, rng: Generator, recipe: Recipe) -> Draw:
    """The same with every cause as large as the noise, or as large as it was drawn at first.

    Its size is what moduli and other causes cannot imitate of it, and of `SILENT` effects they
    imitate all. A cause is taken to grow in proportion to its parameters.

    Raises
    ------
    UnstableDrawError
    """
    setting = place(drawn, rng, recipe)
    _, each = until_stable(drawn, rng, lambda one: of_each(one, setting), firmer)
    loudest = float(np.sqrt(2 * _IN_PLANE[1] ** 2 + _OUT_OF_PLANE[1] ** 2))
    for effect, worth in each.items():
        if effect not in SILENT and worth["signature_left_mm"] < loudest:
            drawn = enlarged(drawn, effect, loudest / worth["signature_left_mm"])
    return drawn


def noise_size(rng: Generator) -> tuple[float, float]:
    """Standard deviations of the noise in plane and out of plane, mm."""
    return float(rng.uniform(*_IN_PLANE)), float(rng.uniform(*_OUT_OF_PLANE))


def truth_of(drawn: Draw) -> dict[str, Any]:
    """What was drawn, as a truth tells it."""
    parameters: dict[str, dict[str, float]] = {effect: {} for effect in drawn.effects}
    for key, value in drawn.parameters.items():
        effect, name = key.split(".", 1)
        parameters[effect][name] = value
    strangers = [effect for effect in drawn.effects if effect in FOREIGN]
    plies = {"stiffness_MPa": laminate(drawn).tolist()} if "rotated_ply" in drawn.effects else {}
    return {
        "kind": kind_of(drawn.effects),
        "effects": list(drawn.effects),
        "parameters": parameters,
        "waves": [asdict(wave) for wave in drawn.waves],
        "moduli": drawn.moduli,
        "nu12": drawn.nu12,
        "mounted_degree": drawn.mounted,
        **plies,
        "places": {effect: FOREIGN[effect].place for effect in strangers},
        "where": {effect: FOREIGN[effect].where(parameters[effect]) for effect in strangers},
    }
