"""Which force takes the cloth, pulled along warp or fill, and how sure is that?

The law is told as the Kirchhoff resultant N = t0 ∂W/∂e against the logarithmic strain e, nothing
pulling across; slack counts for none of the strain. Errors follow from the posterior of all that is
freed, so they hold what shape, slack and motions leave open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import effect_named
from bulgefit.fem.geometry import ReferenceSurface
from bulgefit.fem.laws import LAWS
from bulgefit.fem.uniaxial import uniaxial
from bulgefit.gap.data import Data
from bulgefit.gap.keys import specimen_values
from bulgefit.gap.level import Level
from bulgefit.gap.regress import Regression
from bulgefit.gap.scatter import AXES, of_the_cloth
from bulgefit.model.description import active_effects, cloth_law, describe
from bulgefit.model.sight import Prediction

__all__ = ["SECANTS", "LawTable", "law_table"]

Floats = NDArray[np.float64]

#: Strains at which secant moduli are told, and spacing of the others.
SECANTS = (0.01, 0.02, 0.03, 0.05)
_SPACING = 0.005
#: Difference by a parameter, in its standard errors and relative to its value at least: the law is
#: smooth on either scale.
_STEP, _LEAST_STEP = 1e-2, 1e-7


@dataclass(frozen=True, eq=False)
class LawTable:
    """The cloth's law under uniaxial tension.

    Attributes
    ----------
    strain : (k,) array
        Logarithmic.
    resultant, stderr : (2, k) arrays, N/mm
        Along warp and fill.
    reached : (2,) array
        Largest elastic strain of any specimen: beyond it the law is what its form makes of it.
    thickness : float, mm
    bent : bool
        Whether stress is not proportional to strain by the law's own measure.
    """

    strain: Floats
    resultant: Floats
    stderr: Floats
    reached: Floats
    thickness: float
    bent: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "strain": self.strain.tolist(),
            "warp_N_per_mm": self.resultant[0].tolist(),
            "fill_N_per_mm": self.resultant[1].tolist(),
            "stderr": {
                "warp_N_per_mm": self.stderr[0].tolist(),
                "fill_N_per_mm": self.stderr[1].tolist(),
            },
            "reached": {"warp": float(self.reached[0]), "fill": float(self.reached[1])},
        }

    def secants(self) -> dict[str, Any]:
        """Secant moduli (MPa) at `SECANTS`, as JSON types."""
        places = [int(np.argmin(np.abs(self.strain - s))) for s in SECANTS]
        per = 1.0 / (self.thickness * np.array(SECANTS))
        return {
            "strain": list(SECANTS),
            **{
                modulus.name: {
                    "value": (per * self.resultant[axis, places]).tolist(),
                    "stderr": (per * self.stderr[axis, places]).tolist(),
                    "unit": "MPa",
                }
                for axis, modulus in enumerate(AXES)
            },
        }


def law_table(data: Sequence[Data], final: Regression, level: Level) -> LawTable:
    """The law of a fitted model's cloth.

    Parameters
    ----------
    data : sequence of Data
        Specimens of the cloth; the thickness, law and Poisson's ratio are the first one's.
    final : Regression
    level : Level
        What the law's moduli are multiplied by in most places.
    """
    reached = _reached(data, final.predictions)
    steps = np.arange(1, int(reached.max() / _SPACING) + 1)
    strain = np.union1d(np.round(steps * _SPACING, 6), SECANTS)
    specimen = data[0].specimen

    def told(values: Mapping[Key, float]) -> Floats:
        return level.value * _resultants(data[0], of_the_cloth(values), strain)

    errors = final.standard_errors()
    keys = [k for k in final.columns if _is_of_cloth(k)]
    rows = np.empty((len(keys) + len(level.slopes), 2, len(strain)))
    for row, key in zip(rows[: len(keys)], keys, strict=True):
        at = final.values[key]
        step = max(_STEP * errors[key], _LEAST_STEP * abs(at))
        ends = [told({**final.values, key: at + sign * step}) for sign in (1.0, -1.0)]
        row[...] = (ends[0] - ends[1]) / (2.0 * step)
    resultant = told(final.values)
    rows[len(keys) :] = np.multiply.outer(list(level.slopes.values()), resultant)
    place = [final.columns.index(k) for k in (*keys, *level.slopes)]
    covariance = final.covariance[np.ix_(place, place)]
    variance = np.einsum("iak,ij,jak->ak", rows, covariance, rows)
    variance += (level.error * resultant) ** 2
    _, fabric = cloth_law(_with_ratio(data[0], of_the_cloth(final.values)), specimen.nulls())
    return LawTable(
        strain,
        resultant,
        np.sqrt(variance),
        reached,
        float(specimen.test.thickness),
        not fabric.is_straight,
    )


def _is_of_cloth(key: Key) -> bool:
    """Whether the cloth's law depends on a freed parameter, or is told about it."""
    if not key.effect:
        return True
    effect = effect_named(key.effect)
    return effect.scatters or (effect.shared and effect.uses("material"))


def _with_ratio(d: Data, values: Mapping[Key, float]) -> dict[str, float]:
    return d.specimen.given(specimen_values(values, 0))


def _resultants(d: Data, values: Mapping[Key, float], strain: Floats) -> Floats:
    """(2, k) N/mm along warp and fill."""
    specimen = d.specimen
    stiffness, fabric = cloth_law(_with_ratio(d, values), specimen.nulls())
    law, q = LAWS[specimen.setup.law], fabric.law_parameters(stiffness)
    thickness = float(specimen.test.thickness)
    return thickness * np.array([uniaxial(law, q, strain, axis) for axis in (0, 1)])


def _reached(data: Sequence[Data], predictions: Sequence[Prediction]) -> Floats:
    """Largest elastic strain (2,) along warp and fill, over specimens, frames and cells."""
    return np.max([_largest_strain(d, p) for d, p in zip(data, predictions, strict=True)], axis=0)


def _largest_strain(d: Data, prediction: Prediction) -> Floats:
    specimen, shapes = d.specimen, prediction.shapes
    values = {"nu12": specimen.test.poisson_ratio, **shapes.values}
    active = active_effects(values, specimen.nulls())
    here = describe(
        specimen.mesh, specimen.test.radius, specimen.recorded, specimen.clock, values, active,
        stretch=specimen.test.stretch, warp=specimen.test.warp_angle,
    )  # fmt: skip
    flat = np.column_stack([specimen.mesh.nodes, np.zeros(len(specimen.mesh.nodes))])
    rest = flat if here.fabric.surface is None else here.fabric.surface
    surface = ReferenceSurface.of(rest, specimen.mesh.cells, here.angle)
    last = rest + shapes.displacement[np.argmax(here.load.balanced)]
    stretch = np.einsum("mai,mgax->mgix", last[specimen.mesh.cells], surface.gradient)
    c = np.einsum("mgix,mgiy->xymg", stretch, stretch)
    strain = 0.5 * np.log(np.array([c[0, 0], c[1, 1]]))
    return np.asarray(strain.max(axis=(1, 2)) - np.array(here.fabric.slack))
