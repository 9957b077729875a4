"""Make a test ready for judgement: fewer points, usable frames, noise, and the mesh's own error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.cut_bins import of_whole_bins
from bulgefit.dic.mixtures import independent_frames
from bulgefit.dic.noise import Noise, Source, estimate_noise, outliers
from bulgefit.dic.unmix import recorded_frames
from bulgefit.errors import InputError
from bulgefit.gap.bands import first_with_bands
from bulgefit.gap.data import Data
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.specimen import Specimen
from bulgefit.model.balancing import at_rest
from bulgefit.model.inflation import Shapes
from bulgefit.model.mesh_error import correct_mesh, mesh_remainder

__all__ = [
    "Prepared",
    "correct_anew",
    "correct_discretisation",
    "drop_outliers",
    "fix_units",
    "judge_mesh",
    "prepare",
    "renew_noise",
    "settle",
]

Floats = NDArray[np.float64]

MOST_POINTS, MOST_FRAMES = 2000, 24
LEAST_POINTS, LEAST_FRAMES = 60, 5
#: Standard deviation of the points across their longest direction, relative to the clamp radius;
#: points all over the disc have 0.5.
LEAST_WIDTH = 0.02


@dataclass(eq=False)
class Prepared:
    """A test made ready.

    Attributes
    ----------
    data : Data
    noise : Noise
    rough_from : float or None
        Pressure (bar) from which frames were left out, because the fabric deforms in bands that
        no smooth model follows.
    discretisation : (3,) array, mm
        Root mean square of the mesh's error that was corrected.
    mesh_error : (3,) array, mm, or None
        Root mean square of what the correction leaves of it; None where it could not be found.
    strays : int
        Points of frames that were left out because they depart from those around them.
    cut : int
        Points that were left out since they stand at the centres of bins that are cut.
    interpolated : int or None
        Frames of the file, where they were interpolated from those that are judged.
    """

    data: Data
    noise: Noise
    rough_from: float | None
    discretisation: Floats
    mesh_error: Floats | None = None
    strays: int = 0
    cut: int = 0
    interpolated: int | None = None


def prepare(
    test: BulgeTest,
    law: str = "hencky",
    threads: int = 1,
    held: Mapping[str, float] | None = None,
) -> Prepared:
    """Thin, clean and describe one test, whose frames so many threads will balance.

    Parameters
    ----------
    held : mapping of str to float, optional
        Parameters (`effect.parameter`) that are known.

    Raises
    ------
    InputError
        Too few points or frames to judge, points in a line, or a component that was never measured.
    """
    test = _one_block(test)
    (block,) = test.blocks
    lost = ~np.isfinite(block.displacement).any(axis=(0, 1))
    if lost.any():
        raise InputError(
            f"{test.name}: {', '.join(np.array(['dx', 'dy', 'dz'])[lost])} was never measured; a "
            "gap is judged by all three components (bulgefit fit compares those that were measured)"
        )
    _need_field(test)
    recorded, interpolated = recorded_frames(test), None
    if recorded is not None and recorded.n_frames >= LEAST_FRAMES:
        test, interpolated = recorded, test.n_frames
    test, cut = of_whole_bins(test)
    _need_field(test)
    frames, rough_from = _usable_frames(test)
    if len(frames) < LEAST_FRAMES:
        dropped = (
            f" (those from {rough_from:.3g} bar on deform in bands and were left out)"
            if rough_from is not None
            else ""
        )
        raise InputError(
            f"{test.name}: {len(frames)} usable frames are too few to judge a gap; "
            f"{LEAST_FRAMES} or more are needed{dropped}"
        )
    test = _thinned(test.select(frames=frames))
    (block,) = test.blocks
    noise = estimate_noise(test)
    specimen = Specimen(test, law=law, threads=threads, held=held)
    used = np.isfinite(block.displacement)
    mixture = len(test.pressure) / independent_frames(test)
    data = Data(specimen, noise.sigma, used, mixture * noise.inflation, mixture=mixture)
    return Prepared(data, noise, rough_from, np.zeros(3), cut=cut, interpolated=interpolated)


def _one_block(test: BulgeTest) -> BulgeTest:
    if len(test.blocks) == 1:
        return test
    raise InputError(
        f"{test.name}: its frames have points of their own; a gap is judged at points that all "
        "frames share, so bring the frames to one set of points first"
    )


def _need_field(test: BulgeTest) -> None:
    """Refuse points that are few, in a line or at one place."""
    (block,) = test.blocks
    points = block.reference[_complete(block).any(axis=0), :2]
    if len(points) < LEAST_POINTS:
        raise InputError(
            f"{test.name}: {len(points)} points are too few to judge a gap; "
            f"{LEAST_POINTS} or more are needed"
        )
    width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(points))
    if width < LEAST_WIDTH * test.radius:
        raise InputError(
            f"{test.name}: the points lie in a line or at one place (across it they scatter by "
            f"{width:.2g} mm), and a gap is judged by a field; check x and y of the points"
        )


def _complete(block: Block) -> NDArray[np.bool_]:
    """Points of frames (frames, n) of which all three components were measured."""
    return np.asarray(np.isfinite(block.displacement).all(axis=2))


def _usable_frames(test: BulgeTest) -> tuple[NDArray[np.intp], float | None]:
    """Frames with pressure, up to the one where bands begin; thinned evenly."""
    (block,) = test.blocks
    order = np.argsort(test.pressure, kind="stable")
    frames = order[~at_rest(test.pressure[order])]
    frames = frames[_complete(block)[frames].sum(axis=1) >= LEAST_POINTS]
    if len(frames) < LEAST_FRAMES:
        return frames, None
    points = np.asarray(block.reference[:, :2], dtype=float)
    wild = first_with_bands(points, np.asarray(block.displacement[frames], dtype=float))
    rough_from = None
    if wild is not None:
        first = max(wild - 1, 0)  # the frame before may already begin to
        rough_from = 10.0 * float(test.pressure[frames[first]])
        frames = frames[:first]
    if len(frames) > MOST_FRAMES:
        frames = frames[np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).round().astype(int))]
    return frames, rough_from


def _thinned(test: BulgeTest) -> BulgeTest:
    """About MOST_POINTS, spread evenly: the point nearest each centre of a square grid."""
    (block,) = test.blocks
    count = len(block.reference)
    if count <= MOST_POINTS:
        return test
    points = np.asarray(block.reference[:, :2], dtype=float)
    side = np.sqrt(np.pi * test.radius**2 / MOST_POINTS)
    cell = np.round(points / side).astype(int)
    away = np.linalg.norm(points - cell * side, axis=1)
    order = np.argsort(away, kind="stable")
    _, first = np.unique(cell[order], axis=0, return_index=True)
    mask = np.zeros(count, dtype=bool)
    mask[order[first]] = True
    return test.select(points=mask)


def renew_noise(prepared: Prepared, modelled: Floats) -> None:
    """Without images at rest, take the noise from the residual: it is smoother than the field."""
    data = prepared.data
    test = data.specimen.test
    if prepared.noise.source is Source.AT_REST:
        return
    residual = np.where(data.used, data.specimen.measured - modelled, np.nan)
    prepared.noise = estimate_noise(test, residual)
    data.take_noise(prepared.noise)


def drop_outliers(prepared: Prepared, modelled: Floats) -> None:
    """Leave out points of frames that depart from those around them far beyond the noise.

    Of all that was measured: what a poorer model left out before is looked at again.
    """
    data = prepared.data
    measured = np.isfinite(data.specimen.measured)
    residual = np.where(measured, data.specimen.measured - modelled, np.nan)
    strays = outliers(data.specimen.reference[:, :2], residual, data.sigma)
    data.used = measured & ~strays[..., None]
    prepared.strays = int(strays.sum())


def correct_discretisation(prepared: Prepared, shapes: Shapes) -> None:
    """Take the mesh's error off the model: one pair of meshes serves a whole diagnosis."""
    specimen = prepared.data.specimen
    correct_mesh(specimen, shapes)
    prepared.discretisation = _size(specimen.correction)


def correct_anew(prepared: Prepared, shapes: Shapes) -> None:
    """The same at a better fit; where the finer mesh finds nothing there, as it was.

    Everything at once fits as well by moduli that are some per cent off. From there to here the
    mesh's error changes by less than the noise of a point, but moduli are known to as little.
    """
    specimen = prepared.data.specimen
    before = specimen.correction
    correct_mesh(specimen, shapes)
    if specimen.correction is None:
        specimen.correction = before
    prepared.discretisation = _size(specimen.correction)


def judge_mesh(prepared: Prepared, shapes: Shapes) -> None:
    """How far the corrected model still is from a mesh without end."""
    left = mesh_remainder(prepared.data.specimen, shapes)
    prepared.mesh_error = None if left is None else _size(left)


def fix_units(prepared: Prepared, shapes: Shapes) -> None:
    """The mesh's error, what is left of it, noise and outliers as they are at a good fit.

    All models are then compared in these units.
    """
    data = prepared.data
    specimen = data.specimen
    correct_discretisation(prepared, shapes)
    modelled = specimen.observe(shapes).displacement
    renew_noise(prepared, modelled)
    drop_outliers(prepared, modelled)
    left = mesh_remainder(specimen, shapes)
    data.mesh = None
    if left is not None and specimen.correction is not None:
        once = specimen.correction
        specimen.correction = once + left
        data.mesh = specimen.observe(shapes).displacement - modelled
        specimen.correction = once
    data.trust = _trust(data, modelled, shapes)


def _trust(data: Data, modelled: Floats, shapes: Shapes) -> Floats:
    """Noise over noise and the model's own doubt, (frames,).

    Where part of the fabric is slack, tension-field theory says which tension it has but not where
    its wrinkles lie. Those of wavelength λ that take up a strain e stand (λ/π)√e beside the mean
    surface (Cerda and Mahadevan, 2003): 10 mm and a thousandth make 0.1 mm, twenty times the
    noise, so that little of the area is enough. What the best model leaves in such a frame, every
    effect being free, is variance of the model. So it is where what is left of the mesh's error is
    more than the noise: near a limit of stability shapes hang on all that is small.
    """
    doubtful = data.hangs_on_mesh
    if shapes.wrinkled is not None:
        doubtful |= shapes.wrinkled > 0.0
    units = np.where(data.used, (data.specimen.measured - modelled) / data.sigma, np.nan)
    seen = data.used.any(axis=(1, 2))
    square = np.ones(len(units))
    square[seen] = np.nanmean(units[seen] ** 2, axis=(1, 2))
    return np.where(doubtful, 1.0 / np.sqrt(np.maximum(square, 1.0)), 1.0)


def _size(field: Floats | None) -> Floats:
    """Root mean square (3,) mm over frames and nodes."""
    if field is None:
        return np.zeros(3)
    return np.asarray(np.sqrt((field**2).mean(axis=(0, 1))))


def settle(prepared: Sequence[Prepared], fit: Regression) -> Regression:
    """Noise and the mesh's error as they are at this fit, and the fit once more with them."""
    shapes = [p.shapes for p in fit.predictions]
    for p, here in zip(prepared, shapes, strict=True):
        correct_discretisation(p, here)
        renew_noise(p, p.data.specimen.observe(here).displacement)
    return regress([p.data for p in prepared], fit.keys, fit.values, shapes)
