"""Is there structure in a residual that noise does not make?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.keys import has_offsets
from bulgefit.gap.specimen import Specimen
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
#: Products below which nothing is said of them, and values below which none is of their mean.
_FEW, _LEAST_VALUES = 100, 5
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
        Square of the cells' means by the inverse of their covariance, and what noise stays under.
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

    What parameters take off only lessens the sum of squares. How much of it they do
    is not known by their number: most of a field's bumps are finer than the regions are.
    """
    cells, statistic = list[Cell](), 0.0
    shares = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        residual = (d.specimen.measured - p.displacement) / d.sigma
        residual = np.where(d.used, residual, np.nan)
        # an offset of every point takes away what persists of the noise as well
        of_noise = 0.0 if has_offsets(fit.keys, index) else d.persistent
        found, squares = _judged(d, residual, of_noise)
        cells, statistic = cells + found, statistic + squares
        residual *= d.share[:, None, None]
        residual = residual[np.argsort(d.specimen.recorded, kind="stable")]
        shares.append(_persistent(d, residual, of_noise))
    persistent, allowed = max(shares, key=lambda pair: pair[0] - pair[1])
    threshold = float(chi2.ppf(1 - LEVEL, max(len(cells), 1)))
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
    return _judged(data, residual, data.persistent)[0]


def _judged(data: Data, residual: Floats, persistent: float) -> tuple[list[Cell], float]:
    """Cells of a residual, and the squares of their means by the inverse of their covariance.

    Noise of which a share persists is the same in all bands of a region, point by point.
    """
    specimen = data.specimen
    band = np.argsort(np.argsort(specimen.recorded)) * BANDS // len(specimen.recorded)
    inside = np.eye(BANDS)[band]
    bars = [10.0 * specimen.recorded[band == b] for b in range(BANDS)]
    whole = float(np.nansum(residual**2))
    cells, statistic = list[Cell](), 0.0
    for region, points in _regions(specimen):
        for c, name in enumerate(_NAMES):
            part = residual[:, points, c]
            number = inside.T @ np.isfinite(part)
            found = np.flatnonzero(number.sum(axis=1) >= _LEAST_VALUES)
            if not len(found):
                continue
            values = number[found].sum(axis=1)
            shares = number[found] / values[:, None]
            covariance = persistent * shares @ shares.T
            covariance += np.diag(data.drawn_anew / values + MODEL_FLOOR**2)
            part = np.where(np.isfinite(part), part, 0.0)
            means, squares, trusted = (
                (inside.T @ over.sum(axis=1))[found]
                for over in (part, part**2, data.share[:, None] * part)
            )
            trusted /= values
            statistic += float(trusted @ np.linalg.solve(covariance, trusted))
            cells += [
                Cell(
                    specimen.test.name,
                    name,
                    region,
                    (float(bars[b].min()), float(bars[b].max())),
                    float(means[k] / values[k] * data.sigma[c]),
                    float(squares[k] / whole) if whole else 0.0,
                    float(trusted[k] / np.sqrt(covariance[k, k])),
                )
                for k, b in enumerate(found)
            ]
    return cells, statistic


def _regions(specimen: Specimen) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names of the apex and of the sectors of rings, and which points lie there."""
    x, y = specimen.test.on_circle(specimen.reference).T
    radius = np.hypot(x, y) / specimen.test.radius
    sector = (np.round(np.arctan2(y, x) * SECTORS / (2 * np.pi)).astype(int)) % SECTORS
    for low, high, ring in RINGS:
        in_ring = (radius >= low) & (radius < high)
        if ring == "apex":
            yield ring, in_ring
        else:
            yield from (
                (f"{ring} {360 * s // SECTORS}°", in_ring & (sector == s)) for s in range(SECTORS)
            )
