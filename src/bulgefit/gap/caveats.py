"""What must be said beside a diagnosis: what was left out, and what is not as it should be?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE
from bulgefit.gap.evidence.coordinates import is_field
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.prepare import Prepared
from bulgefit.model.inflation import Shapes
from bulgefit.shown import number_of

__all__ = ["in_doubt", "lacked_by", "left_of_the_mesh", "left_out", "of_the_fits"]


def left_out(prepared: Sequence[Prepared]) -> list[str]:
    """Frames and points that were not judged."""
    out = []
    for p in prepared:
        name = p.data.specimen.test.name
        if p.rough_from is not None:
            out.append(
                f"{name}: frames from {p.rough_from:.3g} bar on were left out: the fabric deforms "
                "in bands there (soft shear), which no mesh-independent model follows"
            )
        if p.interpolated is not None:
            at = ", ".join(f"{10.0 * one:.3g}" for one in p.data.specimen.recorded)
            out.append(
                f"{name}: its {p.interpolated} frames were interpolated straight in pressure; it "
                f"was judged by the recorded ones, which they tell, at {at} bar"
            )
        if p.data.mixture > 1.0:
            frames = len(p.data.used)
            out.append(
                f"{name}: its {frames} frames are linear mixtures of "
                f"{round(frames / p.data.mixture)} and count as so many; interpolation between "
                "frames that are far apart is off, which may look like a cause at light pressure"
            )
        if p.cut:
            out.append(
                f"{name}: {number_of(p.cut, 'point')} at the edge of its grid were left out: they "
                "stand at the centres of bins of which only a part was measured"
            )
        if p.strays:
            out.append(
                f"{name}: {p.strays} of {p.data.used.any(axis=2).sum() + p.strays} points of all "
                "frames depart far from those around them and were left out"
            )
    return out


def in_doubt(prepared: Sequence[Prepared], found: Explanation) -> list[str]:
    """Frames that count by less, since the model itself is in doubt there, by every reason."""
    out = []
    for p, prediction in zip(prepared, found.final.predictions, strict=True):
        for reason, frames in _doubts(p.data, prediction.shapes).items():
            if frames.any():
                out.append(
                    f"{p.data.specimen.test.name}: in {number_of(int(frames.sum()), 'frame')} "
                    f"{reason}; what no model follows there counts as noise"
                )
    return out


def _doubts(data: Data, shapes: Shapes) -> dict[str, NDArray[np.bool_]]:
    """Which frames are in doubt for which reason, (frames,) each."""
    doubted = data.share < 1.0
    on_mesh = doubted & data.hangs_on_mesh
    # what does not hang on the mesh wrinkled where units were fixed, if not in the best model
    slack = doubted & ~on_mesh
    if shapes.wrinkled is not None:
        slack |= doubted & (shapes.wrinkled > 0.0)
    return {
        "part of the fabric is slack and wrinkles": slack,
        "more than the noise is left of the mesh's error, as near a limit of stability": on_mesh,
    }


def left_of_the_mesh(prepared: Sequence[Prepared]) -> list[str]:
    """Where the mesh's error is not known, or not below a third of the noise."""
    out = []
    for p in prepared:
        name = p.data.specimen.test.name
        if p.mesh_error is None:
            out.append(f"{name}: the mesh's error could not be estimated; small gaps may be its")
        elif (p.mesh_error > p.noise.sigma / 3.0).any():
            sizes = ", ".join(f"{1000 * e:.1f}" for e in p.mesh_error)
            out.append(
                f"{name}: the mesh's error could not be brought below a third of the noise; about "
                f"{sizes} µm of dx, dy, dz are left of it, and small gaps may be its"
            )
    return out


def of_the_fits(found: Explanation) -> list[str]:
    """Of which fits values and errors are not those of an optimum."""
    out = []
    if found.baseline.held:
        out.append(
            "with the moduli alone, G12 is an upper limit: the fit asks for a softer one, by which "
            "the fabric would lose its stability; its standard error says nothing"
        )
    if not found.final.converged:
        out.append(
            "the descent to the most probable values did not come to its end: by its derivatives "
            f"they lie up to {found.final.short:.2g} standard errors from those told, and its "
            "steps did not lead there"
        )
    return out


def lacked_by(kept_out: Prepared, found: Explanation) -> list[str]:
    """Shared effects that a held-out test was met without, since it lacks what they need."""
    effects = [CATALOGUE[group.effect] for group in found.groups if not is_field(group)]
    return [
        f"the held-out test has no {need}: it was met without {effect.id}"
        for effect in effects
        for need in effect.needs
        if getattr(kept_out.data.specimen.test, need) is None
    ]
