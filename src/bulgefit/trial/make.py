"""Bulge tests made with a known effect, for checking a diagnosis on data whose effect it is not
told.

What is wrong and by how much is drawn in `draw`, the fabric is balanced in `fabric`,
and the camera looks at it in `camera`. None of it uses the model that diagnoses, beside the
membrane's own law and equilibrium.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from numpy.random import Generator, SeedSequence, default_rng

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.trial.draw import Draw, draw, firmer, kind_of
from bulgefit.trial.fabric import UnstableDrawError
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.recording import Recipe, has_clock, place, record
from bulgefit.trial.signature import noise_free, of_all, of_each

__all__ = ["TRIES", "Made", "Recipe", "make_test", "noise_size", "truth_of"]

#: Draws of a firmer fabric before giving up.
TRIES = 12


@dataclass(frozen=True, eq=False)
class Made:
    """A made test and its truth, ready for JSON.

    Attributes
    ----------
    test : BulgeTest
    truth : dict
        `kind` (none, one, two, several, foreign), `effects`, `parameters` (effect to name to
        value, in the catalogue's units), `waves`, `moduli` (MPa), `nu12`, `places` and `where` of
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
    drawn = draw(kind, rng, recipe.shrink)
    setting = place(drawn, rng, recipe)
    with one_blas_thread():
        for _ in range(TRIES):
            try:
                height, seen = noise_free(drawn, setting, recipe.fineness)
                signature = of_all(drawn, setting, seen, recipe.fineness)
                each = of_each(drawn, setting)
                break
            except UnstableDrawError:
                drawn = firmer(drawn, rng)
        else:
            raise UnstableDrawError("made test: no stable fabric was drawn; try another seed")
        size = noise_size(rng)
        timed = has_clock(drawn, rng)
        test = record(setting, height, seen, size, rng, name, recipe, timed=timed)
    truth = {
        **truth_of(drawn),
        "noise_mm": size,
        "interpolated": recipe.interpolated,
        **signature,
        "signatures": each,
        "nonce": rng.bytes(16).hex(),
    }
    return Made(test, truth)


def noise_size(rng: Generator) -> tuple[float, float]:
    """Standard deviations of the noise in plane and out of plane, mm."""
    return float(rng.uniform(5e-3, 9e-3)), float(rng.uniform(10e-3, 18e-3))


def truth_of(drawn: Draw) -> dict[str, Any]:
    """What was drawn, as a truth tells it."""
    parameters: dict[str, dict[str, float]] = {effect: {} for effect in drawn.effects}
    for key, value in drawn.parameters.items():
        effect, name = key.split(".", 1)
        parameters[effect][name] = value
    strangers = [effect for effect in drawn.effects if effect in FOREIGN]
    return {
        "kind": kind_of(drawn.effects),
        "effects": list(drawn.effects),
        "parameters": parameters,
        "waves": [asdict(wave) for wave in drawn.waves],
        "moduli": drawn.moduli,
        "nu12": drawn.nu12,
        "places": {effect: FOREIGN[effect].place for effect in strangers},
        "where": {effect: FOREIGN[effect].where(parameters[effect]) for effect in strangers},
    }
