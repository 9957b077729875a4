"""Where is the gap: azimuthal modes of the residual, and how each grows with pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.gap.regress import Regression

__all__ = ["Growth", "Mode", "azimuthal_modes", "growth_shapes"]

Floats = NDArray[np.float64]

ORDERS = (0, 1, 2, 3, 4)
#: Share of an amplitude's sum of squares that the law it follows may miss.
FOLLOWED = 0.05
_NAMES = ("radial", "hoop", "dz")


class Growth(StrEnum):
    """How an amplitude goes with pressure: in short, and in words."""

    CONSTANT = "constant", "constant in pressure"
    CUBE_ROOT = "p^(1/3)", "growing like the bulge itself, as p^(1/3)"
    LINEAR = "growing", "growing in proportion to pressure"
    MIXED = "mixed", "changing with pressure in no simple way"
    NONE = "within noise", "within the noise"

    words: str

    def __new__(cls, short: str, words: str) -> Growth:
        """A member that is its short name."""
        member = str.__new__(cls, short)
        member._value_, member.words = short, words
        return member


@dataclass(frozen=True, eq=False)
class Mode:
    """One azimuthal mode of one component of the residual.

    Attributes
    ----------
    test, component : str
        "radial", "hoop" (in-plane displacement) or "dz".
    order : int
    pressure : (frames,) array, bar
    amplitude : (frames,) array, mm
        Of the residual's mode at the annulus 0.3 to 0.9 of the radius, signed along the mode's
        mean direction.
    growth : Growth
    noise : float, mm
        Standard error of an amplitude.
    """

    test: str
    component: str
    order: int
    pressure: Floats
    amplitude: Floats
    growth: Growth
    noise: float

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "test": self.test,
            "component": self.component,
            "order": self.order,
            "growth": self.growth,
            "largest_mm": float(np.abs(self.amplitude).max()),
            "noise_mm": self.noise,
            "pressure_bar": self.pressure.tolist(),
            "amplitude_mm": self.amplitude.tolist(),
        }


def azimuthal_modes(data: Sequence[Data], fit: Regression) -> list[Mode]:
    """Modes m = 0..4 of the residual (measured minus modelled) of every test.

    Of an elliptic clamp, by ring and angle where it is a circle.
    """
    modes = []
    for d, p in zip(data, fit.predictions, strict=True):
        residual = np.where(d.used, d.specimen.measured - p.displacement, np.nan)
        x, y = d.specimen.test.on_circle(d.specimen.reference).T
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        ring = (radius > 0.3 * d.specimen.test.radius) & (radius < 0.9 * d.specimen.test.radius)
        outwards = np.arctan2(*d.specimen.reference[:, 1::-1].T)
        cos, sin = np.cos(outwards), np.sin(outwards)
        components = (
            residual[..., 0] * cos + residual[..., 1] * sin,
            -residual[..., 0] * sin + residual[..., 1] * cos,
            residual[..., 2],
        )
        sigma = (d.sigma[:2].mean(), d.sigma[:2].mean(), d.sigma[2])
        order = np.argsort(d.specimen.recorded)
        bars = 10.0 * d.specimen.recorded[order]
        for name, component, s in zip(_NAMES, components, sigma, strict=True):
            for m, both in zip(
                ORDERS, _amplitudes(component[order][:, ring], angle[ring]), strict=True
            ):
                mean = both.mean(axis=0)
                length = np.linalg.norm(mean)
                direction = mean / length if length > 0 else np.array([1.0, 0.0])
                signed = both @ direction
                # of a mean, and of the amplitude of a wave
                share = 1.0 if m == 0 else 2.0
                error = float(s * np.sqrt(share * d.in_a_frame / max(ring.sum(), 1)))
                modes.append(
                    Mode(
                        d.specimen.test.name,
                        name,
                        m,
                        bars,
                        signed,
                        _growth(bars, signed, error),
                        error,
                    )
                )
    return modes


def _amplitudes(field: Floats, angle: Floats) -> list[Floats]:
    """Cosine and sine coefficients (frames, 2) of each order, by least squares a frame."""
    columns = [np.ones_like(angle)]
    for m in ORDERS[1:]:
        columns += [np.cos(m * angle), np.sin(m * angle)]
    basis = np.stack(columns, axis=1)
    found = np.zeros((len(field), basis.shape[1]))
    for k, row in enumerate(field):
        seen = np.isfinite(row)
        if seen.sum() > basis.shape[1]:
            found[k] = np.linalg.lstsq(basis[seen], row[seen], rcond=None)[0]
    pairs = [np.stack([found[:, 0], np.zeros(len(field))], axis=1)]
    pairs += [found[:, 2 * m - 1 : 2 * m + 1] for m in ORDERS[1:]]
    return pairs


def growth_shapes(bars: Floats) -> dict[Growth, Floats]:
    """How an amplitude may go with pressure."""
    return {
        Growth.CONSTANT: np.ones_like(bars),
        Growth.CUBE_ROOT: np.cbrt(bars),
        Growth.LINEAR: bars,
    }


def _growth(bars: Floats, amplitude: Floats, error: float) -> Growth:
    """Which of constant, p^(1/3) or a line through zero the amplitude follows; or none of them."""
    if np.abs(amplitude).max() < 3.0 * error:
        return Growth.NONE
    misfit = {
        name: float(((amplitude - shape * (shape @ amplitude) / (shape @ shape)) ** 2).sum())
        for name, shape in growth_shapes(bars).items()
    }
    best = min(misfit, key=lambda name: misfit[name])
    missed = misfit[best] - len(bars) * error**2
    return best if missed < FOLLOWED * float(amplitude @ amplitude) else Growth.MIXED
