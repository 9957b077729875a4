"""How noisy is the test: per component, and how far the noise is correlated in space."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.mixtures import independent_frames
from bulgefit.dic.reference_image import RESOLVED, shows_nothing

__all__ = ["Noise", "Source", "among", "estimate_noise", "noise_of", "outliers", "rough_part"]

Floats = NDArray[np.float64]

#: Distance (mm) beyond which noise is taken as independent.
REACH = 40.0
_NEIGHBOURS = 24
#: Values of a component, of a frame or of images at rest, that tell its noise.
_LEAST_VALUES = 2 * _NEIGHBOURS
#: Points that tell the noise of a test with more.
MOST_POINTS = 4000
#: Points around one that say whether it strays, and by how many noise units and spreads of theirs.
_CIRCLE, _ASTRAY = 32, 12.0
#: Frames from which they tell noise from what goes smoothly with pressure.
_LEAST_FRAMES = 8


class Source(StrEnum):
    """What told the noise."""

    AT_REST = "static images"
    FRAMES = "frame to frame"
    FIELD = "the field itself"


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one test.

    Attributes
    ----------
    sigma : (3,) array, mm
    correlation_length : float, mm
        Distance at which the correlated share has fallen to 1/e; 0 where none was found.
    inflation : float
        Variance of a mean of neighbouring points over that of independent ones: points divided
        by it are the effective number of points.
    persistent : float
        Share of the variance that is the same in every frame: bins whose mean lies off their
        centre, marks on the lens. Averaging over frames does not lower it.
    source : Source
    """

    sigma: Floats
    correlation_length: float
    inflation: float
    source: Source
    persistent: float = 0.0


def noise_of(test: BulgeTest, residual: Floats | None = None) -> Noise | None:
    """Noise of any test: from some of very many points, or from the fullest of several blocks.

    Parameters
    ----------
    test : BulgeTest
    residual : (frames, n, 3) array, mm, optional
        Measured minus modelled, of a test of one block; see `estimate_noise`.

    Returns
    -------
    Noise or None
        None where too few points, or not all components, were measured to tell, in frames or in
        images at rest.
    """
    if not test.blocks:
        return None
    if len(test.blocks) > 1:
        # the reference itself is exact, and often the fullest
        noisy = [block for block in test.blocks if not shows_nothing(block.displacement)]
        if not noisy:
            return None
        test, residual = _of_block(test, max(noisy, key=lambda b: b.measured.sum())), None
    together = np.isfinite(test.blocks[0].displacement).all(axis=2).sum(axis=1)
    if together.max(initial=0) < _LEAST_VALUES and not len(_static_images(test)):
        return None
    count = len(test.blocks[0].reference)
    if count <= MOST_POINTS:
        return estimate_noise(test, residual)
    some = np.zeros(count, dtype=bool)
    some[np.random.default_rng(0).permutation(count)[:MOST_POINTS]] = True
    found = estimate_noise(
        test.select(points=some), None if residual is None else residual[:, some]
    )
    return among(found, count / MOST_POINTS, len(test.blocks[0].displacement))


def among(noise: Noise, times: float, frames: int) -> Noise:
    """The noise where so many times more points lie within the reach of its correlation.

    What comes back in every frame is independent from point to point: it counts by the frames.

    Parameters
    ----------
    noise : Noise
        As some of the points show it.
    times : float
        All points over those.
    frames : int
        By which the persistent share was counted.
    """
    alone = noise.persistent * frames + (1.0 - noise.persistent)  # without any neighbours
    return replace(noise, inflation=alone + times * (noise.inflation - alone))


def _of_block(test: BulgeTest, block: Block) -> BulgeTest:
    """The frames of one block alone, at whatever pressure they are."""
    alone = replace(block, frames=np.arange(len(block.frames)))
    pressure = test.pressure[block.frames]
    return replace(
        test, blocks=(alone,), pressure=pressure, time=None, schedule=None, static_displacement=None
    )


def estimate_noise(test: BulgeTest, residual: Floats | None = None) -> Noise:
    """Noise from static images, else from frame to frame, else from what a local surface leaves.

    Parameters
    ----------
    test : BulgeTest
        Of one block.
    residual : (frames, n, 3) array, mm, optional
        Measured minus modelled. What the model misses goes smoothly with pressure, while noise is
        drawn anew for every frame: the difference between a frame and what its neighbours in
        pressure say of it is noise, and keeps its correlation in space. Of frames that are
        mixtures the neighbours hold the same noise, and what a local surface leaves is it.
    """
    (block,) = test.blocks
    points = np.asarray(block.reference[:, :2], dtype=float)
    field = _static_images(test)
    if len(field):
        return _describe(points, field, _robust(field), Source.AT_REST)
    rough = rough_part(points, np.asarray(block.displacement if residual is None else residual))
    if residual is None or len(residual) < _LEAST_FRAMES:
        return _describe(points, rough, _robust(rough), Source.FIELD)
    pressure = np.asarray(test.pressure, dtype=float)
    if independent_frames(test) < test.n_frames:
        noise = _describe(points, rough, _robust(rough), Source.FIELD)
        return _with_persistent(noise, _share_of_both_halves(pressure, rough), len(rough))
    field = _flattened(points, _frame_differences(pressure, residual))
    noise = _describe(points, field, _robust(field), Source.FRAMES)
    return _beside_persistent(noise, _robust(rough), len(residual))


def _static_images(test: BulgeTest) -> Floats:
    """Images at rest (m, n, 3), mm, less how the camera moved between them, which is no noise.

    Those that show all three components, as a noise needs; none where they have too few values.
    """
    none = np.empty((0, 0, 3))
    if test.static_displacement is None:
        return none
    field = np.asarray(test.static_displacement, dtype=float)
    seen = np.isfinite(field).sum(axis=1)
    field, seen = field[(seen > 1).all(axis=1)], seen[(seen > 1).all(axis=1)]
    if (seen - 1).sum(axis=0).min() < _LEAST_VALUES:
        return none
    # the mean of few points follows their noise
    left = np.sqrt(seen / (seen - 1.0))[:, None]
    return np.asarray((field - np.nanmean(field, axis=1, keepdims=True)) * left)


def _beside_persistent(noise: Noise, rough: Floats, frames: int) -> Noise:
    """What is rough in space beyond the noise of a frame comes back in every frame."""
    sigma = np.maximum(noise.sigma, rough)
    share = float(np.mean(1.0 - (noise.sigma / sigma) ** 2))
    found = _with_persistent(noise, share, frames)
    return replace(found, sigma=sigma) if found.persistent else noise


def _with_persistent(noise: Noise, share: float, frames: int) -> Noise:
    """Noise of which a share of the variance comes back in every frame."""
    if share < 0.1:  # within what the two estimates differ by on the same noise
        return noise
    inflation = share * frames + (1.0 - share) * noise.inflation
    return replace(noise, inflation=inflation, persistent=share)


def _share_of_both_halves(pressure: Floats, rough: Floats) -> float:
    """Share of the variance that a frame has in common with one half of all frames away.

    So far apart two mixtures of frames hold none in common.
    """
    ordered = rough[np.argsort(pressure, kind="stable")]
    half = len(ordered) // 2
    ordered = ordered / np.maximum(np.sqrt(np.nanmean(ordered**2, axis=(0, 1))), RESOLVED)
    return max(0.0, float(np.nanmean(ordered[half:] * ordered[:-half])))


def _frame_differences(pressure: Floats, field: Floats) -> Floats:
    """Each frame minus its neighbours' cubic in p^(1/3), (frames - 4, n, 3).

    Scaled to the variance of a single frame.
    """
    order = np.argsort(pressure, kind="stable")
    # equal pressures are set apart a little: only their order matters then
    t = np.cbrt(pressure[order])
    t = t + 1e-3 * (t[-1] - t[0] + 1e-9) * np.arange(len(t)) / len(t)
    out = []
    for k in range(2, len(t) - 2):
        around = [k - 2, k - 1, k + 1, k + 2]
        weights = np.array(
            [np.prod([(t[k] - t[j]) / (t[i] - t[j]) for j in around if j != i]) for i in around]
        )
        left = field[order[k]] - np.tensordot(weights, field[order[around]], 1)
        out.append(left / np.sqrt(1.0 + weights @ weights))
    return np.array(out)


def _flattened(points: Floats, field: Floats) -> Floats:
    """The field less a quadratic surface over the whole disc, frame by frame.

    Noise is short against the disc; what the frames' differences keep of the model's gap is not.
    """
    x, y = points.T / max(float(np.abs(points).max()), 1e-9)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    out = np.array(field)
    for frame in out:
        for component in frame.T:
            seen = np.isfinite(component)
            if seen.sum() > 2 * basis.shape[1]:
                found = np.linalg.lstsq(basis[seen], component[seen], rcond=None)[0]
                component -= basis @ found
    return out


def _robust(field: Floats) -> Floats:
    """Standard deviation per component from the median absolute deviation, mm."""
    from scipy.stats import median_abs_deviation

    flat = field.reshape(-1, 3)
    return np.maximum(
        median_abs_deviation(flat, axis=0, scale="normal", nan_policy="omit"), RESOLVED
    )


def rough_part(points: Floats, field: Floats) -> Floats:
    """What a quadratic surface through the neighbours leaves, scaled to the noise's variance.

    Neighbours are those that were measured in the same frame; NaN where a point was not.
    """
    out = np.full(field.shape, np.nan)
    seen = np.isfinite(field).all(axis=2)
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    for index, here in enumerate(patterns):
        frames = np.flatnonzero(which == index)
        if here.sum() >= _NEIGHBOURS:
            out[np.ix_(frames, here)] = _beyond_surface(points[here], field[np.ix_(frames, here)])
    return out


def _beyond_surface(points: Floats, field: Floats) -> Floats:
    """`rough_part` of points that were all measured."""
    away, near = KDTree(points).query(points, k=_NEIGHBOURS)
    local = (points[near] - points[:, None]) / np.maximum(away[:, -1:, None], 1e-9)
    x, y = local[..., 0], local[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    normal = basis.swapaxes(1, 2) @ basis + 1e-9 * np.eye(6)  # points may be in a line
    # (n, neighbours): the surface's value at the point
    projector = (basis @ np.linalg.inv(normal)[:, 0, :, None])[..., 0]
    smooth = (projector[:, None] @ field[:, near])[..., 0, :]
    left = np.sqrt(np.maximum(1.0 - projector[:, 0], 0.05))  # hat value of the point itself
    return np.asarray((field - smooth) / left[None, :, None])


def _describe(points: Floats, field: Floats, sigma: Floats, source: Source) -> Noise:
    """Correlation against distance, and what it does to the variance of a mean."""
    unit = np.clip(field / sigma, -4.0, 4.0)
    unit = np.where(np.isfinite(unit), unit, 0.0)
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(points))[: min(len(points), 1200)]
    distance = np.linalg.norm(points[chosen][:, None] - points[chosen][None], axis=-1)
    samples = np.moveaxis(unit[:, chosen], 1, 0).reshape(len(chosen), -1)
    product = samples @ samples.T / samples.shape[1]
    edges = np.linspace(0.0, REACH, 17)
    own = float(np.mean(np.diag(product)))
    if own == 0.0:
        return Noise(sigma, 0.0, 1.0, source)
    off = ~np.eye(len(chosen), dtype=bool)
    centres, correlation, weight = [], [], []
    for low, high in pairwise(edges):
        inside = off & (distance >= low) & (distance < high)
        if inside.sum() > 50:
            centres.append(0.5 * (low + high))
            correlation.append(float(product[inside].mean()) / own)
            weight.append(float(inside.sum()))
    if len(centres) < 4:
        return Noise(sigma, 0.0, 1.0, source)
    length, area = _fit_correlation(np.array(centres), np.array(correlation), np.array(weight))
    # density of measured points times the area under the correlation
    around = min(_NEIGHBOURS, len(points) - 1)
    away = KDTree(points).query(points, k=around + 1)[0][:, -1]
    density = (around + 0.5) / (np.pi * float(np.median(away)) ** 2)
    inflation = 1.0 + density * area
    return Noise(sigma, length, float(np.clip(inflation, 1.0, 200.0)), source)


def _fit_correlation(distance: Floats, correlation: Floats, weight: Floats) -> tuple[float, float]:
    """Length and area (mm²) of the best share exp(-(d/length)^k), lengths to 30 mm.

    k = 1 and 2: subsets that overlap, and noise that was smoothed, lie between.
    """
    best, least = (0.0, 0.0), np.inf
    for length in np.geomspace(2.0, 30.0, 28):
        for power, area in ((1, 2.0 * np.pi), (2, np.pi)):
            shape = np.exp(-((distance / length) ** power))
            share = float((weight * shape * correlation).sum() / (weight * shape**2).sum())
            share = min(max(share, 0.0), 1.0)
            miss = float((weight * (correlation - share * shape) ** 2).sum())
            # a length that the nearest points do not show would be a guess
            if miss < least and share * shape[0] > 0.02:
                best, least = (float(length), share * area * float(length) ** 2), miss
    return best


def outliers(points: Floats, residual: Floats, sigma: Floats) -> NDArray[np.bool_]:
    """Points of a frame that depart from those around them by far more than those differ.

    First as they are, then in what a point does not show all the time: creases of the reference
    image do not hide what passes. Images that lose the pattern lose it over several points at once,
    so the circle is wide, and is looked at until nothing more is found.

    Parameters
    ----------
    points : (n, 2) array, mm
    residual : (frames, n, 3) array, mm
    sigma : (3,) array, mm

    Returns
    -------
    strays : (frames, n) array
    """
    strays = np.asarray(np.isnan(residual).any(axis=2))
    lost = strays.copy()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # points that are never measured
        always = np.nanmedian(residual, axis=0)
    for field in (residual, residual - always):
        for frame, stray in zip(field, strays, strict=True):
            while len(left := np.flatnonzero(~stray)) > _CIRCLE:
                apart = _apart(points[left], frame[left], sigma)
                if not apart.any():
                    break
                stray[left[apart]] = True
    return strays & ~lost


def _apart(points: Floats, field: Floats, sigma: Floats) -> NDArray[np.bool_]:
    """Points at which a field (n, 3) departs from its median around them."""
    from scipy.stats import median_abs_deviation

    around = field[KDTree(points).query(points, k=_CIRCLE + 1)[1][:, 1:]]
    centre = np.median(around, axis=1)
    spread = median_abs_deviation(around, axis=1, scale="normal")
    apart = np.abs(field - centre) > _ASTRAY * np.maximum(sigma, spread)
    return np.asarray(apart.any(axis=1))
