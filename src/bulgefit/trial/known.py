"""Which effects does the catalogue know, and how large may each be?

Names, units and signs are those of docs/house.md; each null is 0, but for `poisson_ratio`.
"""

from __future__ import annotations

from numpy.random import Generator

from bulgefit.trial.dice import Sizes, either, motion, plane, size, vector

__all__ = ["FORMS", "KNOWN", "NOT_TOGETHER", "OF_CLOTH", "SILENT"]

#: Pairs that no test tells apart: never drawn together.
NOT_TOGETHER = (
    {"clamp_shape", "dic_scale"},
    {"rigid_motion", "reference_state"},
)
#: Effects that no test, or next to none, can show beside the moduli: never drawn beside others, and
#: silence about them is right.
SILENT = ("pressure_gain", "poisson_ratio")
#: Effects that specimens of one cloth share.
OF_CLOTH = ("nonlinear_material", "creep", "surface_offset")


def _initial_shape(rng: Generator) -> dict[str, float]:
    # a dome against the inflation would snap through: most are with it
    h0 = size(rng, 0.5, 5.0) * float(rng.choice([1.0, -1.0], p=[0.8, 0.2]))
    names = ("hx", "hy", "c2", "s2", "h2")
    uneven = rng.uniform(-0.4, 0.4, size=5) * abs(h0) * (rng.random() < 0.5)
    return {"h0": h0, **{n: float(v) for n, v in zip(names, uneven, strict=True)}}


def _clamp_shape(rng: Generator) -> dict[str, float]:
    radius_error = either(rng, 0.003, 0.01) if rng.random() < 0.5 else 0.0
    return {"ellipticity": either(rng, 0.003, 0.015), "radius_error": radius_error}


def _rim_lift(rng: Generator) -> dict[str, float]:
    # a plate under bolts: up to 0.6 mm/bar at first, and less the farther it is off
    return {
        "amplitude": size(rng, 0.1, 0.6),
        "direction": float(rng.uniform(-180.0, 180.0)),
        "shape": 1.0 / size(rng, 1.5, 6.0),
    }


def _fixture_motion(rng: Generator) -> dict[str, float]:
    # half of them less and less, as a rim that lifts
    drawn = motion(rng, 0.3, 0.3, 6.0)
    return {**drawn, "shape": 1.0 / size(rng, 1.5, 6.0)} if rng.random() < 0.5 else drawn


def _poisson_ratio(rng: Generator) -> dict[str, float]:
    low, high = ((0.1, 0.17), (0.31, 0.4))[int(rng.integers(2))]
    return {"nu12": float(rng.uniform(low, high))}


#: Sizes of the catalogue's effects.
KNOWN: dict[str, Sizes] = {
    "initial_shape": _initial_shape,
    "clamp_shape": _clamp_shape,
    "prestrain": lambda rng: {n: either(rng, 0.001, 0.008) for n in ("slack_x", "slack_y")},
    "clamp_slip": lambda rng: {"compliance": size(rng, 0.005, 0.05)},
    "axis_misalignment": lambda rng: {"angle": either(rng, 2.0, 15.0)},
    "poisson_ratio": _poisson_ratio,
    "nonlinear_material": lambda rng: {n: float(rng.uniform(1.0, 5.0)) for n in ("k_x", "k_y")},
    "stiffness_gradient": lambda rng: plane(rng, ("g_x", "g_y"), 0.05, 0.25),
    "creep": lambda rng: {"rate": float(rng.uniform(0.02, 0.1))},
    "pressure_offset": lambda rng: {"offset": either(rng, 0.01, 0.05)},
    "pressure_gain": lambda rng: {"gain": either(rng, 0.01, 0.04)},
    "rigid_motion": lambda rng: motion(rng, 0.5, 1.0, 10.0),
    "fixture_motion": _fixture_motion,
    "reference_state": lambda rng: {},  # its waves are drawn apart
    "registration": lambda rng: plane(rng, ("x0", "y0"), 0.5, 3.0),
    "dic_scale": lambda rng: {"scale": either(rng, 0.003, 0.015)},
    "dic_smoothing": lambda rng: {"window": float(rng.uniform(4.0, 12.0))},
    # a position p in the plane, from the axis, is seen at p (1 + k1 |p|²/a²)
    "lens_distortion": lambda rng: {"k1": either(rng, 0.004, 0.015)},
    # heights are seen × (1 + scale_z)
    "depth_scale": lambda rng: {"scale_z": either(rng, 0.005, 0.02)},
    # the face that is seen lies above the middle by a share of the thickness, and turns with it
    "surface_offset": lambda rng: {"share": float(rng.uniform(0.2, 0.6))},
    # rim radius a (1 + c3 cos 3φ + s3 sin 3φ)
    "clamp_lobes": lambda rng: plane(rng, ("c3", "s3"), 0.004, 0.015),
    # the axes of the reported displacement are turned: u_seen = R u
    "frame_misalignment": lambda rng: vector(rng, "rotation", 0.1, 1.5),
    # the edge rises by amplitude × max(0, cos(φ - direction)) (1 - exp(-s p)) / s, s = shape, 1/bar
    "rim_lift": _rim_lift,
}


def _knee(rng: Generator) -> dict[str, float]:
    slopes = {n: float(rng.uniform(-0.7, -0.3)) for n in ("s_x", "s_y")}
    return {**slopes, **{n: float(rng.uniform(0.008, 0.02)) for n in ("knee_x", "knee_y")}}


#: Forms of catalogue effects that the ordinary kinds do not take: the effect, and its sizes.
FORMS: dict[str, tuple[str, Sizes]] = {
    # the fabric lay in creases on the reference image, and pressure flattens them by and by
    "creases": ("reference_state", lambda rng: {"flattening": size(rng, 0.02, 0.3)}),
    "knee": ("nonlinear_material", _knee),
}
