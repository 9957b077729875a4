"""Which effects does no catalogue know, how large may each be, and where does it sit?

A diagnosis cannot name them. It can tell their place, and for those that sit somewhere on the
specimen also where.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from bulgefit.trial.dice import Sizes, either, size, vector

__all__ = ["FOREIGN", "GAUGE_RANGE", "Foreign"]

#: Full scale of the pressure gauge, bar.
GAUGE_RANGE = 3.0


def _everywhere(_: Mapping[str, float]) -> None:
    """What has no spot of its own."""


@dataclass(frozen=True)
class Foreign:
    """An effect from outside the catalogue.

    Attributes
    ----------
    place : str
        Where a diagnosis should look: shape, clamp, material, load or camera.
    sizes : callable
        Draws its parameters.
    where : callable
        Its spot from its parameters: `x_mm`, `y_mm` of a point; `normal_degree`, `distance_mm` of
        a line; `angle_degree`, `half_width_degree` of a sector; or None.
    """

    place: str
    sizes: Sizes
    where: Callable[[Mapping[str, float]], dict[str, float] | None] = _everywhere


def _patch(rng: Generator) -> dict[str, float]:
    reach, turn = 60.0 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    return {
        "drop": float(rng.uniform(0.2, 0.5)),
        "width": float(rng.uniform(12.0, 22.0)),
        "x": float(reach * np.cos(turn)),
        "y": float(reach * np.sin(turn)),
    }


def _seam(rng: Generator) -> dict[str, float]:
    return {
        "rise": float(rng.uniform(0.3, 1.0)),
        "width": float(rng.uniform(4.0, 8.0)),
        "normal": float(rng.uniform(0.0, 180.0)),
        "distance": float(rng.uniform(-50.0, 50.0)),
    }


def _slipping(rng: Generator) -> dict[str, float]:
    return {
        "compliance": size(rng, 0.02, 0.08),
        "middle": float(rng.uniform(0.0, 360.0)),
        "half_width": float(rng.uniform(30.0, 55.0)),
    }


def _stitched(rng: Generator) -> dict[str, float]:
    return {
        "rise": float(rng.uniform(0.3, 1.0)),
        "middle": float(rng.uniform(0.0, 360.0)),
        "half_width": float(rng.uniform(25.0, 45.0)),
    }


def _ply(rng: Generator) -> dict[str, float]:
    # with half of the thickness, two plies would be orthotropic again, about their mean axis
    return {"angle": either(rng, 30.0, 60.0), "share": float(rng.uniform(0.25, 0.4))}


def _frame_bend(rng: Generator) -> dict[str, float]:
    return {
        "bend": size(rng, 0.05, 0.3),
        "direction": float(rng.uniform(0.0, 360.0)),
        "cycles": float(rng.uniform(0.5, 2.0)),
        "phase": float(rng.uniform(0.0, 360.0)),
    }


def _point(told: Mapping[str, float]) -> dict[str, float]:
    return {"x_mm": told["x"], "y_mm": told["y"]}


def _line(told: Mapping[str, float]) -> dict[str, float]:
    return {"normal_degree": told["normal"], "distance_mm": told["distance"]}


def _sector(told: Mapping[str, float]) -> dict[str, float]:
    return {"angle_degree": told["middle"], "half_width_degree": told["half_width"]}


#: Effects that no catalogue entry describes.
FOREIGN: dict[str, Foreign] = {
    # stiffness × (1 - drop exp(-d²/2 width²)), d the distance (mm) from (x, y)
    "soft_patch": Foreign("material", _patch, _point),
    # stiffness × (1 + rise exp(-d²/2 width²)), d the distance (mm) from a straight line: the
    # points whose component along its normal is `distance`
    "stiff_seam": Foreign("material", _seam, _line),
    # stiffness × (1 + rise cos²) over a sector of angles, growing with r²/a² from the centre
    "stitched_sector": Foreign("material", _stitched, _sector),
    # this share of the thickness has its warp turned by an angle against the rest
    "rotated_ply": Foreign("material", _ply),
    # the clamp slips in a sector alone: compliance × cos² towards its ends; degrees
    "slipping_sector": Foreign("clamp", _slipping, _sector),
    # the clamp holds at first and gives way by this compliance a decade of time
    "clamp_creep": Foreign("clamp", lambda rng: {"compliance": size(rng, 0.01, 0.04)}),
    # while pressure rises the gauge reads too little, by `bow` (bar) in the middle of its range
    "gauge_hysteresis": Foreign("load", lambda rng: {"bow": size(rng, 0.02, 0.08)}),
    # the frame shifts in proportion to time; mm over the whole test
    "camera_drift": Foreign("camera", lambda rng: vector(rng, "shift", 0.3, 1.5)),
    # each frame is bent in its plane by its own amount, up to `bend` (mm) at the rim
    "frame_bend": Foreign("camera", _frame_bend),
}
