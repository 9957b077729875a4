"""What did the reference image already show? An offset of every point, as smooth as creases are.

Offsets c(x, y), which all frames share, are a Gaussian process over the specimen with covariance

    s² (1 + q + q²/3) exp(-q),    q = √5 d/l

in each component, d being how far two points are apart (Rasmussen and Williams, 2006, "Gaussian
processes for machine learning", eq. 4.17, Matérn's of order 5/2): what it draws has a curvature
everywhere, as a sheet has, and no more than that. They are no coordinates: they are integrated out.
With rows in noise units of variance v, H what an offset adds to them, HᵀH = N (frames that count,
by point) and K the covariance of the offsets in noise units,

    v (v 1 + H K Hᵀ)⁻¹ = 1 - U (1 - (1 + N^½ K N^½/v)⁻¹) Uᵀ,    U = H N^-½, UᵀU = 1

(Woodbury), which the eigenvectors of N^½ K N^½ take the root of.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from bulgefit.gap.data import Data
from bulgefit.gap.evidence.heights import shown

__all__ = ["Creases", "likeliest_offsets", "on_points"]

Floats = NDArray[np.float64]

#: Length of the widest creases over the clamp radius: wider ones have a name.
_WIDEST = 0.25
#: Points by which size and length are told, and powers of p^(1/3) that courses are compared of.
_TOLD, _COURSES = 400, 4
#: Variances over the noise's of a mean between which a size is looked for.
_LEAST, _MOST = 1e-6, 1e6


@dataclass(frozen=True, eq=False)
class _Modes:
    """Eigenvalues (n,) and vectors (n, n) of N^½ R N^½, R being what offsets correlate by.

    Without vectors, points are the modes: their offsets have nothing to do with each other.
    """

    values: Floats
    vectors: Floats | None

    @classmethod
    def of(cls, number: Floats, correlation: Floats | None) -> _Modes:
        if correlation is None:
            return cls(number, None)
        root = np.sqrt(number)
        values, vectors = np.linalg.eigh(correlation * np.outer(root, root))
        return cls(np.maximum(values, 0.0), vectors)

    def seen(self, sums: Floats) -> Floats:
        """Of sums (k, n) by points, those by modes."""
        return sums if self.vectors is None else sums @ self.vectors

    def back(self, seen: Floats) -> Floats:
        """Of sums (k, n) by modes, those by points."""
        return seen if self.vectors is None else seen @ self.vectors.T


@dataclass(frozen=True, eq=False)
class Creases:
    """Offsets of a specimen's points.

    Attributes
    ----------
    sizes : (3,) array, mm
        Standard deviations s.
    length : float, mm
        l; 0 where each point has an offset of its own.
    variances : (3,) array
        s² in noise units.
    number : (points, 3) array
        Frames that count.
    modes : tuple of _Modes
        By component.
    """

    sizes: Floats
    length: float
    variances: Floats
    number: Floats
    modes: tuple[_Modes, ...]

    @classmethod
    def of(cls, d: Data, sizes: Floats, length: float) -> Creases:
        """Of these sizes and this length (mm), over a specimen's points."""
        number = np.asarray((shown(d) ** 2).sum(axis=0))
        correlation = _correlation(d.specimen.reference[:, :2], length)
        alike = [_Modes.of(number[:, 0], correlation)]
        for c in (1, 2):
            same = next((k for k in range(c) if np.array_equal(number[:, k], number[:, c])), None)
            alike.append(_Modes.of(number[:, c], correlation) if same is None else alike[same])
        return cls(sizes, length, (sizes / d.sigma) ** 2, number, tuple(alike))

    @classmethod
    def likeliest(cls, d: Data, displacement: Floats) -> Creases | None:
        """The most probable ones of what all frames of a residual share; None without any.

        By the evidence of the points' means (MacKay, 1992, "Bayesian interpolation"), at some
        hundred points; lengths from the distance of neighbours up by factors of √2. None, too,
        where what grows with p^(1/3), p^(2/3) or p explains more: that is no crease, but something
        that the fabric does, and offsets would only take a part of it.

        Parameters
        ----------
        d : Data
        displacement : (frames, points, 3) array, mm
            Modelled.
        """
        every = slice(None, None, max(1, len(d.specimen.reference) // _TOLD))
        left = (d.specimen.measured - displacement) * d.weight
        residual = np.where(d.used, left, 0.0)[:, every]
        shares, points = (
            (d.share[:, None, None] * d.used)[:, every],
            d.specimen.reference[every, :2],
        )
        load = np.cbrt(d.specimen.recorded / d.specimen.recorded.max())
        found = []
        for degree in range(_COURSES):
            course = shares * (load**degree)[:, None, None]
            found.append(_most_probable(points, residual, course, d))
        gained, variances, length = found[0]
        if gained == 0.0 or gained < max(other[0] for other in found):
            return None
        return cls.of(d, np.sqrt(variances) * d.sigma, length)

    def on(self, d: Data) -> Creases:
        """The same offsets over the points of other data."""
        return Creases.of(d, self.sizes, self.length)

    def whitened(self, rows: Floats, shown: Floats, inflation: float) -> Floats:
        """Rows (k, frames, points, 3) whose products count as beside offsets of the points.

        Parameters
        ----------
        rows : array
            In noise units.
        shown : (frames, points, 3) array
            H.
        inflation : float
            v.
        """
        unit = shown / np.sqrt(np.maximum(self.number, 1e-300))
        sums = np.einsum("kfnc,fnc->ckn", rows, unit)
        for c, (modes, variance) in enumerate(zip(self.modes, self.variances, strict=True)):
            less = 1.0 - 1.0 / np.sqrt(1.0 + variance * modes.values / inflation)
            sums[c] = modes.back(modes.seen(sums[c]) * less)
        return np.asarray(rows - np.einsum("ckn,fnc->kfnc", sums, unit))

    def cost(self, inflation: float) -> float:
        """ln det(1 + N^½ K N^½/v): what ln det A + 2 Σ ln s is of coordinates."""
        return sum(
            float(np.log1p(variance * modes.values / inflation).sum())
            for modes, variance in zip(self.modes, self.variances, strict=True)
        )


def _most_probable(
    points: Floats, residual: Floats, course: Floats, d: Data
) -> tuple[float, Floats, float]:
    """What a course of all points (frames, n, 3) gains at most, at which variances and length."""
    sums, number = (residual * course).sum(axis=0), (course**2).sum(axis=0)
    sums /= np.sqrt(np.maximum(number, 1e-300))
    best = (0.0, np.zeros(3), 0.0)
    for length in _lengths(points, d.specimen.test.radius):
        correlation, variances, gained = _correlation(points, length), np.zeros(3), 0.0
        for c in range(3):
            modes = _Modes.of(number[:, c], correlation)
            seen = modes.seen(sums[None, :, c])[0] ** 2
            variances[c], gain = _likeliest(modes.values, seen, d.inflation)
            gained += gain
        if gained > best[0]:
            best = (gained, variances, length)
    return best


def _lengths(points: Floats, radius: float) -> list[float]:
    """0, and from the distance (mm) of neighbours on."""
    near, _ = cKDTree(points).query(points, k=2)
    first = float(np.median(near[:, 1]))
    steps = int(np.floor(2.0 * np.log2(_WIDEST * radius / first))) if first > 0.0 else -1
    return [0.0, *(first * 2.0 ** (0.5 * step) for step in range(steps + 1))]


def _correlation(points: Floats, length: float) -> Floats | None:
    if length == 0.0:
        return None
    q = np.sqrt(5.0) * cdist(points, points) / length
    return np.asarray((1.0 + q + q**2 / 3.0) * np.exp(-q))


def _likeliest(values: Floats, square: Floats, inflation: float) -> tuple[float, float]:
    """Variance t of modes with variances v + t λ that is likeliest, and 2 ln of what it gains."""

    def misses(log: float) -> float:
        ratio = np.exp(log) * values / inflation
        return float(np.sum(np.log1p(ratio) - square / inflation * (ratio / (1.0 + ratio))))

    typical = np.log(inflation / max(float(values.max()), 1e-300))
    between = (typical + np.log(_LEAST), typical + np.log(_MOST))
    found = minimize_scalar(misses, bounds=between, method="bounded")
    return (float(np.exp(found.x)), float(-found.fun)) if found.fun < 0.0 else (0.0, 0.0)


def likeliest_offsets(data: Sequence[Data], seen: Iterable[Floats]) -> list[Creases] | None:
    """What the points of each specimen show in all frames, beyond the noise; None without any.

    Parameters
    ----------
    data : sequence of Data
    seen : iterable of (frames, points, 3) array, mm
        Modelled displacements, of each.
    """
    found = [Creases.likeliest(d, displacement) for d, displacement in zip(data, seen, strict=True)]
    if not any(found):
        return None
    return [c or Creases.of(d, np.zeros(3), 0.0) for d, c in zip(data, found, strict=True)]


def on_points(data: Sequence[Data], offsets: Sequence[Creases] | None) -> list[Creases] | None:
    """The same offsets over other points of each specimen."""
    if offsets is None:
        return None
    return [creases.on(d) for d, creases in zip(data, offsets, strict=True)]
