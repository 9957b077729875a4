"""Is there structure in a residual that noise does not make?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.keys import has_offsets
from bulgefit.model.sight import Prediction

__all__ = ["Cell", "Predicted", "Structure", "cells_of", "structure"]

Floats = NDArray[np.float64]

RINGS = ((0.0, 0.35, "apex"), (0.35, 0.75, "middle"), (0.75, 2.0, "rim"))
SECTORS, BANDS = 8, 4
#: What the corrected model may still miss by, in noise units: a mean is not judged below it.
MODEL_FLOOR = 0.2
#: Share of the variance that may persist from frame to frame: the square of what the corrected
#: model may miss by.
PERSISTENT = 0.3**2
#: Standard errors of a persistent share that are put down to chance.
CHANCE = 4.0
#: Chance that noise alone looks like structure.
LEVEL = 1e-3
#: Products below which nothing is said of them.
_FEW = 100
_NAMES = ("dx", "dy", "dz")


class Predicted(Protocol):
    """What a fit predicts of each specimen, and by which keys.

    Attributes
    ----------
    keys : tuple of Key
        Freed parameters, and offsets of points.
    predictions : sequence of Prediction
        With the offsets; derivatives are not asked for.
    """

    @property
    def keys(self) -> tuple[Key, ...]: ...

    @property
    def predictions(self) -> Sequence[Prediction]: ...


@dataclass(frozen=True)
class Cell:
    """Mean residual over one component, region and pressure band.

    Attributes
    ----------
    test, component, region : str
    band : (float, float), bar
    mean : float, mm
        Measured minus modelled.
    share : float
        Of the whole sum of squared residuals.
    significance : float
        Mean over its standard error (correlated noise and the model's own floor).
    """

    test: str
    component: str
    region: str
    band: tuple[float, float]
    mean: float
    share: float
    significance: float

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "test": self.test,
            "component": self.component,
            "region": self.region,
            "pressure_band_bar": list(self.band),
            "mean_mm": self.mean,
            "share": self.share,
            "significance": self.significance,
        }


@dataclass(frozen=True, eq=False)
class Structure:
    """Result of the test for structure.

    Attributes
    ----------
    significant : bool
        Either measure is beyond what noise does.
    statistic, threshold : float
        Sum of squared significances, and what noise stays under.
    persistent, allowed : float
        Largest share of a test's noise variance that persists from frame to frame, and what noise
        and the model's own floor stay under. Noise is drawn anew for each frame; what the model
        misses is not, however fine it is in space.
    cells : list of Cell
        Largest significance first.
    """

    significant: bool
    statistic: float
    threshold: float
    persistent: float
    allowed: float
    cells: list[Cell]


def structure(data: Sequence[Data], fit: Predicted) -> Structure:
    """Test the regional means of the residual against correlated noise, by the trust in each frame.

    What parameters take off only lessens the sum of squared significances. How much of it they do
    is not known by their number: most of a field's bumps are finer than the regions are.
    """
    cells: list[Cell] = []
    shares = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        residual = (d.specimen.measured - p.displacement) / d.sigma
        residual = np.where(d.used, residual, np.nan)
        cells += cells_of(d, residual)
        residual *= d.share[:, None, None]
        residual = residual[np.argsort(d.specimen.recorded, kind="stable")]
        # an offset of every point takes away what persists of the noise as well
        of_noise = 0.0 if has_offsets(fit.keys, index) else d.persistent
        shares.append(_persistent(d, residual, of_noise))
    persistent, allowed = max(shares, key=lambda pair: pair[0] - pair[1])
    z = np.array([c.significance for c in cells])
    statistic = float((z**2).sum())
    threshold = float(chi2.ppf(1 - LEVEL, max(len(z), 1)))
    cells.sort(key=lambda c: -abs(c.significance))
    significant = statistic > threshold or persistent > allowed
    return Structure(significant, statistic, threshold, persistent, allowed, cells)


def _persistent(data: Data, ordered: Floats, of_noise: float) -> tuple[float, float]:
    """Mean product of neighbouring frames' residuals (noise units), and its limit.

    Noise itself persists by the share `of_noise`.
    """
    product = np.clip(ordered[1:], -5.0, 5.0) * np.clip(ordered[:-1], -5.0, 5.0)
    product = product[np.isfinite(product)]
    if len(product) < _FEW:
        return 0.0, 1.0
    chance = CHANCE * float(np.sqrt(data.inflation / len(product)))
    return float(product.mean()), of_noise + PERSISTENT + chance


def cells_of(data: Data, residual: Floats) -> list[Cell]:
    """Means of a residual in noise units (frames, points, 3; NaN unused) over all cells."""
    specimen = data.specimen
    x, y = specimen.test.on_circle(specimen.reference).T
    radius = np.hypot(x, y) / specimen.test.radius
    sector = (np.round(np.arctan2(y, x) * SECTORS / (2 * np.pi)).astype(int)) % SECTORS
    order = np.argsort(np.argsort(specimen.recorded))
    band = order * BANDS // len(order)
    trusted = residual * data.share[:, None, None]
    whole = float(np.nansum(residual**2))
    cells = []
    for low, high, ring in RINGS:
        in_ring = (radius >= low) & (radius < high)
        sectors = [None] if ring == "apex" else list(range(SECTORS))
        for s in sectors:
            points = in_ring if s is None else in_ring & (sector == s)
            for b in range(BANDS):
                frames = band == b
                if not frames.any() or not points.any():
                    continue
                part, counted = residual[np.ix_(frames, points)], trusted[np.ix_(frames, points)]
                bars = 10.0 * specimen.recorded[frames]
                for c, name in enumerate(_NAMES):
                    known = np.isfinite(part[..., c])
                    values = part[known, c]
                    if len(values) < 5:
                        continue
                    error = np.sqrt(data.inflation / len(values) + MODEL_FLOOR**2)
                    cells.append(
                        Cell(
                            specimen.test.name,
                            name,
                            ring if s is None else f"{ring} {360 * s // SECTORS}°",
                            (float(bars.min()), float(bars.max())),
                            float(values.mean()) * float(data.sigma[c]),
                            float((values**2).sum() / whole) if whole else 0.0,
                            float(counted[known, c].mean() / error),
                        )
                    )
    return cells
