"""Which further measurement would best split what this test cannot tell apart?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import BulgefitError
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.evidence.coordinates import effect_of, is_field
from bulgefit.gap.explain import Explanation
from bulgefit.gap.keys import specimen_values
from bulgefit.gap.specimen import Specimen
from bulgefit.model.inflation import Shapes

__all__ = ["Advice", "advise"]

Floats = NDArray[np.float64]

#: Standard error (mm) of a shape measured without pressure.
SHAPE_ERROR = 0.05


@dataclass(frozen=True)
class Advice:
    """A further measurement and what it promises.

    Attributes
    ----------
    measurement : str
    separation : float
        Predicted distance, in standard errors, between the two leading explanations once the
        measurement is added; now it is that of the first entry, "this test alone".
    between : (str, str)
        Those two effects.
    """

    measurement: str
    separation: float
    between: tuple[str, str]


def advise(data: Sequence[Data], found: Explanation) -> list[Advice]:
    """Measurements ranked by the separation that the sensitivities predict.

    The leading ambiguity is the first effect that has a rival against that; without one, the least
    sure effect against the most probable one that is not in the model.
    """
    pair = _leading(found)
    if pair is None:
        return []
    first, second = pair
    d = data[0]
    names = [*MODULI, *_first_group(first), *_first_group(second)]
    rival = len(_first_group(second))
    size = np.array([_plausible(name) for name in names[len(names) - rival :]])
    here = found.final.predictions[0].shapes
    base = _normal(d, d.specimen, found, names, near=here)
    options: dict[str, Callable[[], Floats]] = {
        "this test alone": lambda: base,
        "low-pressure frames (0.005 to 0.05 bar)": lambda: (
            base + _normal(d, _with_pressures(d, np.geomspace(5e-4, 5e-3, 6)), found, names)
        ),
        "rim points (0.95 to 0.99 of the radius)": lambda: (
            base + _normal(d, _with_rim_points(d), found, names, near=here)
        ),
        "specimen rotated by 90° in the clamp": lambda: (
            base + _normal(d, d.specimen, found, names, turned=True)
        ),
        "static images (four times the frames' precision at rest)": lambda: (
            base + _camera_prior(names)
        ),
        "shape at zero pressure": lambda: base + _shape_prior(names),
        "hold at the highest pressure": lambda: base + _only(names, "creep", 1e4),
        "unloading branch": lambda: base + _only(names, "creep", 1e3) + 0.5 * base,
    }
    ranked = []
    for name, normal in options.items():
        with suppress(BulgefitError):  # where nothing balances, there is nothing to measure
            ranked.append(Advice(name, _separation(normal(), size, d.inflation), pair))
    return [ranked[0], *sorted(ranked[1:], key=lambda a: -a.separation)]


def _leading(found: Explanation) -> tuple[str, str] | None:
    """What is least sure of the model, and what may be in its place, or beside it."""
    causes = {g: e for g, e in found.evidence.items() if not is_field(g)}
    for group, evidence in causes.items():
        if evidence.rivals and not is_field(evidence.rivals[0]):
            return effect_of(group), effect_of(evidence.rivals[0])
    others = {effect_of(g): p for g, p in found.others.items() if not is_field(g)}
    if not causes or not others:
        return None
    doubted = min(causes, key=lambda g: causes[g].probability)
    rest = {e: p for e, p in others.items() if e != effect_of(doubted)}
    return (effect_of(doubted), max(rest, key=lambda e: rest[e])) if rest else None


def _first_group(effect: str) -> tuple[str, ...]:
    return CATALOGUE[effect].groups()[0]


def _plausible(name: str) -> float:
    """A tenth of the plausible range of an effect's parameter."""
    effect, _, parameter = name.partition(".")
    (found,) = (p for p in CATALOGUE[effect].parameters if p.name == parameter)
    return 0.1 * (found.upper - found.lower)


def _normal(
    d: Data,
    specimen: Specimen,
    found: Explanation,
    names: Sequence[str],
    *,
    near: Shapes | None = None,
    turned: bool = False,
) -> Floats:
    """Normal matrix of a (further) measurement with the final model's parameters."""
    values = specimen_values(found.final.values, 0)
    if turned:
        values = {
            **values,
            "axis_misalignment.angle": values.get("axis_misalignment.angle", 0) + 90,
        }
    rows = specimen.predict(values, names, near).derivative / d.sigma
    if specimen is d.specimen:
        rows = np.where(d.used, rows, 0.0)
    flat = rows.reshape(len(names), -1)
    return flat @ flat.T


def _with_pressures(d: Data, pressure: Floats) -> Specimen:
    """The specimen at other pressures, at the times that its own frames suggest."""
    return _elsewhere(d, d.specimen.reference, pressure)


def _with_rim_points(d: Data) -> Specimen:
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    ring = np.concatenate(
        [
            share * d.specimen.test.semi_axes * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            for share in (0.95, 0.97, 0.99)
        ]
    )
    return _elsewhere(d, np.column_stack([ring, np.zeros(len(ring))]), d.specimen.recorded)


def _elsewhere(d: Data, points: Floats, pressure: Floats) -> Specimen:
    specimen = d.specimen
    time = None
    if specimen.time is not None:
        order = np.argsort(specimen.recorded)
        time = np.interp(pressure, specimen.recorded[order], specimen.time[order])
    made = BulgeTest.from_arrays(
        points,
        np.zeros((len(pressure), len(points), 3)),
        pressure,
        radius=specimen.test.radius,
        ellipticity=specimen.test.ellipticity,
        thickness=specimen.test.thickness,
        poisson_ratio=specimen.test.poisson_ratio,
        time=time,
    )
    return specimen.of(made)


def _prior(names: Sequence[str], errors: dict[str, float]) -> Floats:
    return np.diag([1.0 / errors[n] ** 2 if n in errors else 0.0 for n in names])


def _camera_prior(names: Sequence[str]) -> Floats:
    """Images at rest show a moved frame directly: 0.005 degree, 0.005 mm."""
    return _prior(names, {n: 0.005 for n in names if n.startswith("rigid_motion")})


def _shape_prior(names: Sequence[str]) -> Floats:
    """A measured shape fixes the initial shape, and what the reference image already showed."""
    return _prior(
        names,
        {n: SHAPE_ERROR for n in names if n.startswith(("initial_shape", "reference_state.z"))},
    )


def _only(names: Sequence[str], effect: str, weight: float) -> Floats:
    return np.diag([weight if n.startswith(effect) else 0.0 for n in names])


def _separation(h: Floats, size: Floats, inflation: float) -> float:
    """Largest signal of the second effect, at a plausible size, that the rest cannot imitate.

    Its parameters are the last of the normal matrix.
    """
    first = len(h) - len(size)
    rest, own = slice(0, first), slice(first, None)
    left = h[own, own] - h[own, rest] @ np.linalg.pinv(h[rest, rest], hermitian=True) @ h[rest, own]
    signal = np.linalg.eigvalsh(left * np.outer(size, size)).max()
    return float(np.sqrt(max(signal, 0.0) / inflation))
