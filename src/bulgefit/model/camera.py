"""The camera's place: from displacements of the fabric to what the DIC reports.

In order: average over the correlation window (`dic_smoothing`), scale (`dic_scale`), take off
what the reference image already showed and pressure has flattened (`reference_state`), move the
frame (`rigid_motion`,
`fixture_motion`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

__all__ = [
    "CAMERA",
    "FLATTENING",
    "REFERENCE_MODES",
    "flattened",
    "flattened_rate",
    "flattened_slope",
    "material_points",
    "reference_modes",
    "seen",
]

Floats = NDArray[np.float64]

AXES = ("x", "y", "z")

#: Degrees (i, j) of the modes P_i(x/a) P_j(y/a) of `reference_state`, Legendre's polynomials, up to
#: the fifth degree in all.
REFERENCE_MODES = tuple((n - j, j) for n in range(6) for j in range(n + 1))

_RIGID = tuple(f"rigid_motion.{k}_{a}" for k in ("rotation", "shift") for a in AXES)
_FIXTURE = tuple(f"fixture_motion.{k}_{a}" for k in ("rotation", "shift") for a in AXES)
FLATTENING = "reference_state.flattening"
_STATE = tuple(f"reference_state.{a}{i}{j}" for a in AXES for i, j in REFERENCE_MODES)

#: Parameters that move the measured points over the fabric.
POINTS = ("registration.x0", "registration.y0", "dic_scale.scale")
CAMERA = (*_RIGID, *_FIXTURE, *_STATE, FLATTENING, *POINTS, "dic_smoothing.window")


def material_points(reference: Floats, values: Mapping[str, float]) -> Floats:
    """Positions (n, 2) mm on the fabric of points seen at `reference` (n, 3) mm.

    The clamp's centre is seen at (x0, y0), and positions are seen × (1 + scale).
    """
    centre = np.array([values.get("registration.x0", 0.0), values.get("registration.y0", 0.0)])
    return reference[:, :2] / (1.0 + values.get("dic_scale.scale", 0.0)) - centre


def reference_modes(reference: Floats, radius: float) -> Floats:
    """Modes (modes, n) of `reference_state` at points (n, 3)."""
    highest = max(sum(mode) for mode in REFERENCE_MODES)
    along_x, along_y = (legvander(reference[:, k] / radius, highest) for k in (0, 1))
    return np.stack([along_x[:, i] * along_y[:, j] for i, j in REFERENCE_MODES])


def flattened(pressure: Floats, values: Mapping[str, float]) -> Floats:
    """Share (frames,) of the reference state that pressure (frames,) MPa has flattened.

    p/(p + p0) with p0 the `flattening` pressure (bar), at which half of it is gone; without one a
    fabric is smooth at once.
    """
    bar = 10.0 * np.maximum(pressure, 1e-6)
    return bar / (bar + values.get(FLATTENING, 0.0))


def flattened_slope(pressure: Floats, values: Mapping[str, float]) -> Floats:
    """∂(flattened share)/∂p0, (frames,) 1/bar."""
    bar = 10.0 * np.maximum(pressure, 1e-6)
    return -bar / (bar + values.get(FLATTENING, 0.0)) ** 2


def flattened_rate(pressure: Floats, values: Mapping[str, float]) -> Floats:
    """∂(flattened share)/∂p, (frames,) 1/MPa."""
    bar = 10.0 * np.maximum(pressure, 1e-6)
    half = values.get(FLATTENING, 0.0)
    return 10.0 * half / (bar + half) ** 2


def _motion(values: Mapping[str, float], pressure_bar: float) -> tuple[Floats, Floats]:
    """Rotation vector (degree) and shift (mm) of the frame at a pressure."""
    rigid = np.array([values.get(name, 0.0) for name in _RIGID])
    fixture = np.array([values.get(name, 0.0) for name in _FIXTURE])
    both = rigid + pressure_bar * fixture
    return both[:3], both[3:]


def seen(
    moved: Floats, reference: Floats, pressure: Floats, radius: float, values: Mapping[str, float]
) -> Floats:
    """Displacements (frames, n, 3) mm as reported, of fabric displacements `moved`.

    Parameters
    ----------
    moved : (frames, n, 3) array, mm
        At the material points, averaged over the window.
    reference : (n, 3) array, mm
    pressure : (frames,) array, MPa
        On the clamp, which moves in proportion to it.
    """
    out = (1.0 + values.get("dic_scale.scale", 0.0)) * moved
    state = _state(reference, radius, values)
    if state is not None:
        out = out - flattened(pressure, values)[:, None, None] * state
    for k, p in enumerate(10.0 * pressure):
        turn, shift = _motion(values, p)
        if turn.any() or shift.any():
            rotation = Rotation.from_rotvec(turn, degrees=True).as_matrix()
            out[k] = (reference + out[k]) @ rotation.T + shift - reference
    return out


def _state(reference: Floats, radius: float, values: Mapping[str, float]) -> Floats | None:
    coefficients = np.array([values.get(name, 0.0) for name in _STATE]).reshape(3, -1)
    if not coefficients.any():
        return None
    return (coefficients @ reference_modes(reference, radius)).T


def through(change: Floats, pressure: Floats, values: Mapping[str, float]) -> Floats:
    """Change (frames, n, 3) of the reported displacement for a change of the fabric's."""
    out = (1.0 + values.get("dic_scale.scale", 0.0)) * change
    for k, p in enumerate(10.0 * pressure):
        turn, _ = _motion(values, p)
        if turn.any():
            out[k] = out[k] @ Rotation.from_rotvec(turn, degrees=True).as_matrix().T
    return out


def camera_derivative(
    name: str,
    moved: Floats,
    reference: Floats,
    pressure: Floats,
    radius: float,
    values: Mapping[str, float],
) -> Floats:
    """∂(reported)/∂(a camera parameter) at fixed fabric displacements, (frames, n, 3).

    `dic_scale` and `registration` also move the points over the fabric; that part is the
    gradient of the field and is added by the caller.
    """
    if name == FLATTENING:
        state = _state(reference, radius, values)
        if state is None:
            return np.zeros_like(moved)
        change = -flattened_slope(pressure, values)[:, None, None] * state
        return through(change / (1.0 + values.get("dic_scale.scale", 0.0)), pressure, values)
    if name.startswith("reference_state."):
        axis, mode = divmod(_STATE.index(name), len(REFERENCE_MODES))
        x_degree, y_degree = REFERENCE_MODES[mode]
        along_x = legvander(reference[:, 0] / radius, x_degree)[:, -1]
        along_y = legvander(reference[:, 1] / radius, y_degree)[:, -1]
        change = np.zeros_like(moved)
        change[..., axis] = -np.outer(flattened(pressure, values), along_x * along_y)
        scale = 1.0 + values.get("dic_scale.scale", 0.0)
        return through(change / scale, pressure, values)
    if name == "dic_scale.scale":
        scale = 1.0 + values.get("dic_scale.scale", 0.0)
        return through(moved / scale, pressure, values)
    if name.startswith("registration."):
        return np.zeros_like(moved)
    # motions: exact to rounding by a central difference of closed formulas
    step = 1e-4
    up, down = dict(values), dict(values)
    up[name], down[name] = values.get(name, 0.0) + step, values.get(name, 0.0) - step
    difference = seen(moved, reference, pressure, radius, up) - seen(
        moved, reference, pressure, radius, down
    )
    return difference / (2.0 * step)


def pressure_derivative(
    moved: Floats, reference: Floats, pressure: Floats, radius: float, values: Mapping[str, float]
) -> Floats:
    """∂(reported)/∂(pressure on the clamp) at fixed fabric displacements, (frames, n, 3) mm/MPa."""
    step = 1e-3 * pressure
    ahead, behind = (seen(moved, reference, pressure + h, radius, values) for h in (step, -step))
    return (ahead - behind) / (2.0 * step)[:, None, None]
