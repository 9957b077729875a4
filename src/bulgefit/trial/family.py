"""Families: three tests of one cloth, each with a shape, a slack and a motion of its own.

Half of them have more: up to two further effects of each specimen, as measured tests of one cloth
have, of which one alone lifted off its clamp.

The law is the cloth's. A specimen's moduli are the cloth's times a factor along warp and one
along fill, as nominally equal pieces of fabric have them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.trial.draw import Draw, draw_moduli, draw_sizes, sheared
from bulgefit.trial.known import KNOWN, NOT_TOGETHER, OF_CLOTH, SILENT
from bulgefit.trial.make import audible, noise_size, truth_of, until_stable
from bulgefit.trial.recording import Recipe, has_clock, place, record
from bulgefit.trial.signature import noise_free, of_each

__all__ = ["SPECIMENS", "STRAINS", "Cloth", "Family", "law_table", "make_family"]

Floats = NDArray[np.float64]

#: Tests of a family.
SPECIMENS = 3
#: Logarithmic strains at which a law is told, uniaxial along warp and along fill.
STRAINS = (0.01, 0.02, 0.03, 0.05)
#: Motions of which each specimen has one.
_MOTIONS = ("rigid_motion", "fixture_motion")
#: Effects of the cloth, each of which half of the families have.
_SHARED = ("nonlinear_material", "surface_offset")
#: Most of what a specimen has beside these.
_FURTHER = 2


@dataclass(frozen=True)
class Cloth:
    """What the specimens of a family share.

    Attributes
    ----------
    moduli : dict of str to float, MPa
    law : dict of str to float
        Parameters of what the cloth has of `_SHARED`.
    scatter : float
        Standard deviation of the logarithm of the factors.
    """

    moduli: dict[str, float]
    law: dict[str, float]
    scatter: float


@dataclass(frozen=True, eq=False)
class Family:
    """Tests of one cloth and their truth, ready for JSON.

    Attributes
    ----------
    tests : tuple of BulgeTest
    truth : dict
        `kind` (family), `effects` (of the cloth and of any specimen), `moduli` (MPa, the
        cloth's), `scatter`, `law` (`strain`, `warp_N_per_mm`, `fill_N_per_mm`), `specimens` (as
        `make.Made` tells a test, with `name` and `factors`), `interpolated` and `nonce`.
    """

    tests: tuple[BulgeTest, ...]
    truth: dict[str, Any]


def make_family(
    seed: int | SeedSequence, recipe: Recipe | None = None, name: str = "cloth"
) -> Family:
    """Make three tests of one cloth from a seed.

    Raises
    ------
    UnstableDrawError
        No stable fabric was drawn.
    """
    recipe = recipe or Recipe()
    rng = default_rng(seed)
    cloth = _cloth(rng)
    factors = _factors(cloth.scatter, rng)
    most = _FURTHER if rng.random() < 0.5 else 0
    drawn = [_specimen(cloth, pair, rng, recipe.shrink, most) for pair in factors]
    drawn[-1] = replace(drawn[-1], mounted=recipe.mounted)
    with one_blas_thread():
        if recipe.audible:
            drawn = [audible(one, rng.spawn(1)[0], recipe) for one in drawn]
        settings = [place(one, rng, recipe) for one in drawn]

        def look(all_of_them: list[Draw]) -> list[tuple[Floats, Floats, dict[str, Any]]]:
            pairs = zip(all_of_them, settings, strict=True)
            return [(*noise_free(*pair, recipe.fineness), of_each(*pair)) for pair in pairs]

        drawn, looks = until_stable(drawn, rng, look, _firmer)
        tests, specimens = [], []
        parts = zip(drawn, settings, looks, factors, strict=True)
        for number, (one, setting, (height, seen, each), pair) in enumerate(parts, start=1):
            told, size, timed = f"{name}_{number}", noise_size(rng), has_clock(one, rng)
            test = record(setting, height, seen, size, rng, told, recipe, timed=timed)
            tests.append(test)
            factor = {"warp": float(pair[0]), "fill": float(pair[1])}
            more = {"name": told, "factors": factor, "noise_mm": size, "signatures": each}
            specimens.append({**truth_of(one), **more})
    moduli = {**cloth.moduli, "G12": drawn[0].moduli["G12"]}
    truth = {
        "kind": "family",
        "effects": sorted({effect for one in drawn for effect in one.effects}),
        "moduli": moduli,
        "scatter": cloth.scatter,
        "law": law_table(moduli, cloth.law, tests[0].thickness),
        "specimens": specimens,
        "interpolated": recipe.interpolated,
        "nonce": rng.bytes(16).hex(),
    }
    return Family(tuple(tests), truth)


def law_table(
    moduli: dict[str, float], law: dict[str, float], thickness: float
) -> dict[str, list[float]]:
    """Stress resultants (N/mm) of the cloth under uniaxial tension, against logarithmic strain.

    Across the pull the cloth is compressed, where stress gains nothing, so that along it the
    linear law's E e stands, and what it gains: N = t E (e + k e²).
    """
    strain = np.array(STRAINS)
    told = {"strain": strain.tolist()}
    for side, modulus, axis in (("warp", "E1", "x"), ("fill", "E2", "y")):
        gain = law.get(f"nonlinear_material.k_{axis}", 0.0)
        resultant = thickness * moduli[modulus] * (strain + gain * strain**2)
        told[f"{side}_N_per_mm"] = resultant.tolist()
    return told


def _cloth(rng: Generator) -> Cloth:
    moduli, scatter = draw_moduli(rng), float(rng.uniform(0.05, 0.10))
    own = [name for name in _SHARED if rng.random() < 0.5]
    return Cloth(moduli, draw_sizes(tuple(own), rng).parameters, scatter)


def _factors(scatter: float, rng: Generator) -> Floats:
    """Factors (specimens, 2) along warp and fill, whose geometric means over the family are 1.

    No test of these pieces tells what others of the same cloth would be like. Taking the mean off
    makes the scatter smaller, by √(1 - 1/n) for n pieces, which is made up for.
    """
    logs = scatter * rng.standard_normal((SPECIMENS, 2))
    centred = logs - logs.mean(axis=0)
    return np.exp(centred / np.sqrt(1.0 - 1.0 / SPECIMENS))


def _specimen(cloth: Cloth, factors: Floats, rng: Generator, shrink: float, most: int) -> Draw:
    motion = _MOTIONS[int(rng.integers(len(_MOTIONS)))]
    own: tuple[str, ...] = "initial_shape", "prestrain", motion
    own += _further(own, int(rng.integers(most + 1)), rng)
    drawn = draw_sizes(own, rng, shrink)
    moduli = {
        "E1": cloth.moduli["E1"] * float(factors[0]),
        "E2": cloth.moduli["E2"] * float(factors[1]),
        "G12": cloth.moduli["G12"],
    }
    shared = tuple(dict.fromkeys(name.partition(".")[0] for name in cloth.law))
    # the law has no share: it is the cloth's, and no specimen's own to enlarge
    parameters = {**cloth.law, **drawn.parameters}
    return replace(drawn, effects=(*shared, *own), parameters=parameters, moduli=moduli)


def _further(own: tuple[str, ...], number: int, rng: Generator) -> tuple[str, ...]:
    """So many more effects of a specimen, of those that some test can tell apart beside its own."""
    names = [n for n in KNOWN if n not in (*own, *SILENT, *OF_CLOTH)]
    while True:
        more = tuple(names[int(i)] for i in rng.choice(len(names), size=number, replace=False))
        if not any(pair <= {*own, *more} for pair in NOT_TOGETHER):
            return more


def _firmer(drawn: list[Draw], rng: Generator) -> list[Draw]:
    """The same cloth with more shear stiffness."""
    factor = float(rng.uniform(1.1, 1.4))
    return [sheared(one, factor) for one in drawn]
