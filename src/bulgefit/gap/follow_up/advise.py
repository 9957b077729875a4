"""Which further measurement would best split what this test cannot tell apart?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.further import Further
from bulgefit.effects.parameter import Key, Owned
from bulgefit.errors import BulgefitError
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.evidence.coordinates import is_field
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.keys import by_value, parameter_of, specimen_values
from bulgefit.gap.specimen import Specimen
from bulgefit.model.inflation import Shapes

__all__ = ["Advice", "advise"]

Floats = NDArray[np.float64]

_ALONE = "this test alone"
_LOW = "low-pressure frames (0.005 to 0.05 bar)"
_RIM = "rim points (0.95 to 0.99 of the radius)"
_TURNED = "specimen rotated by 90° in the clamp"

#: What each shows that the test by itself does not.
_WHY = {
    _ALONE: "",
    _LOW: "what is there before any load weighs most while the cloth hardly stretches",
    _RIM: "what the clamp does is largest beside it",
    _TURNED: "what the cloth has turns with it, and what clamp and cameras have stays",
    Further.AT_REST: "they show where the cameras stood before any load",
    Further.SHAPE: "it shows the shape before inflation by itself",
    Further.HOLD: "there time alone acts",
    Further.UNLOADING: "there the pressure is met again at another time",
}


@dataclass(frozen=True)
class Advice:
    """A further measurement and what it promises.

    Attributes
    ----------
    measurement : str
    separation : float
        By how many standard errors the second effect, at a tenth of its plausible range, would
        show beyond all that the first one and the moduli can imitate, once the measurement is
        added to the test; now it is that of the first entry, "this test alone".
    between : (str, str)
        Those two effects.
    specimen : int
        Of the tests, the one that is meant.
    why : str
        What the measurement shows that the test does not.
    """

    measurement: str
    separation: float
    between: tuple[str, str]
    specimen: int
    why: str


def advise(data: Sequence[Data], found: Explanation) -> list[Advice]:
    """Measurements ranked by the separation that the sensitivities predict.

    The leading ambiguity is the least sure effect that has a rival against that; without one, the
    least sure effect against the most probable one that is not in the model. Of several tests it is
    that of the one whose effect it is, and of the first where all share it.
    """
    leading = _leading(found)
    if leading is None:
        return []
    first, second = (group.effect for group in leading)
    index = next((group.specimen for group in leading if group.specimen is not None), 0)
    d = data[index]
    keys = [*MODULI, *_first_group(first), *_first_group(second)]
    rival = len(_first_group(second))
    size = np.array([_plausible(key) for key in keys[len(keys) - rival :]])
    here = found.final.predictions[index].shapes
    values = specimen_values(found.final.values, index)
    base = _normal(d, d.specimen, values, keys, near=here, as_measured=True)
    options: dict[str, Callable[[], Floats]] = {
        _ALONE: lambda: base,
        _LOW: lambda: (
            base + _normal(d, _with_pressures(d, np.geomspace(5e-4, 5e-3, 6)), values, keys, more=6)
        ),
        _RIM: lambda: base + _normal(d, _with_rim_points(d), values, keys, near=here),
        _TURNED: lambda: base + _normal(d, _turned(d.specimen), values, keys, as_measured=True),
        Further.AT_REST: lambda: base + _told(keys, Further.AT_REST),
        Further.SHAPE: lambda: base + _told(keys, Further.SHAPE),
        Further.HOLD: lambda: base + _told(keys, Further.HOLD),
        # half as many frames again, too
        Further.UNLOADING: lambda: base + _told(keys, Further.UNLOADING) + 0.5 * base,
    }
    ranked = []
    for name, normal in options.items():
        with suppress(BulgefitError):  # where nothing balances, there is nothing to measure
            told = _separation(normal(), size)
            ranked.append(Advice(str(name), told, (first, second), index, _WHY[name]))
    return [ranked[0], *sorted(ranked[1:], key=lambda a: -a.separation)]


def _leading(found: Explanation) -> tuple[Owned, Owned] | None:
    """The least sure cause with a rival, and that; else the least sure, and what was left out."""
    causes = {g: e for g, e in found.evidence.items() if not is_field(g)}
    for group in sorted(causes, key=lambda g: causes[g].probability):
        rival = next(iter(causes[group].rivals), group)
        if rival.effect != group.effect and not is_field(rival):
            return group, rival
    others = {g: p for g, p in found.others.items() if not is_field(g)}
    if not causes or not others:
        return None
    doubted = min(causes, key=lambda g: causes[g].probability)
    rest = {g: p for g, p in others.items() if g.effect != doubted.effect}
    return (doubted, max(rest, key=lambda g: rest[g])) if rest else None


def _first_group(effect: str) -> tuple[Key, ...]:
    return tuple(Key.of(name) for name in CATALOGUE[effect].groups()[0])


def _plausible(key: Key) -> float:
    """A tenth of the plausible range of an effect's parameter."""
    parameter = parameter_of(key)
    return 0.1 * (parameter.upper - parameter.lower)


def _normal(
    d: Data,
    specimen: Specimen,
    values: Mapping[str, float],
    keys: Sequence[Key],
    *,
    near: Shapes | None = None,
    more: int | None = None,
    as_measured: bool = False,
) -> Floats:
    """Normal matrix of a (further) measurement, or its first frames, with the final parameters.

    Of all its rows, or of those that were measured, with as much doubt.
    """
    rows = specimen.predict(values, [key.name for key in keys], near).derivative[:, :more]
    rows *= np.array([by_value(key.name, values) for key in keys])[:, None, None, None]
    rows = rows * (d.weight if as_measured else 1.0 / d.sigma)
    flat = rows.reshape(len(keys), -1)
    return flat @ flat.T / d.inflation


def _turned(specimen: Specimen) -> Specimen:
    """The specimen mounted with its warp 90° further."""
    test = specimen.test
    return specimen.of(replace(test, warp_angle=(test.warp_angle or 0.0) + 90.0))


def _with_pressures(d: Data, pressure: Floats) -> Specimen:
    """The specimen at other pressures, at the times that its own frames suggest.

    The last frame is at its highest pressure, by which effects and fields count theirs.
    """
    highest = d.specimen.recorded.max()
    return _elsewhere(d, d.specimen.reference, np.append(pressure, highest))


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
    if specimen.clock is not None:
        order = np.argsort(specimen.recorded)
        time = np.interp(pressure, specimen.recorded[order], specimen.clock.time[order])
    made = BulgeTest.from_arrays(
        points,
        np.zeros((len(pressure), len(points), 3)),
        pressure,
        radius=specimen.test.radius,
        ellipticity=specimen.test.ellipticity,
        thickness=specimen.test.thickness,
        poisson_ratio=specimen.test.poisson_ratio,
        warp_angle=specimen.test.warp_angle,
        time=time,
    )
    return specimen.of(replace(made, schedule=specimen.test.schedule))


def _told(keys: Sequence[Key], by: Further) -> Floats:
    """Normal matrix of a measurement that tells parameters directly."""
    errors = {
        Key(effect.id, name): told.error
        for effect in CATALOGUE.values()
        for told in effect.told
        if told.by is by
        for name in told.names
    }
    return np.diag([errors[key] ** -2 if key in errors else 0.0 for key in keys])


def _separation(h: Floats, size: Floats) -> float:
    """Largest signal of the second effect, at a plausible size, that the rest cannot imitate.

    Its parameters are the last of the normal matrix.
    """
    first = len(h) - len(size)
    rest, own = slice(0, first), slice(first, None)
    left = h[own, own] - h[own, rest] @ np.linalg.pinv(h[rest, rest], hermitian=True) @ h[rest, own]
    signal = np.linalg.eigvalsh(left * np.outer(size, size)).max()
    return float(np.sqrt(max(signal, 0.0)))
