"""How stiff the cloth is, and where: its law, what varies over it, and its plies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.geometry import SHAPE, ReferenceSurface
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh
from bulgefit.trial.draw import Draw
from bulgefit.trial.rim import degrees_apart

__all__ = ["evenness", "laminate", "law_of", "moduli_about", "stiffness", "turn_ply"]

Floats = NDArray[np.float64]


def stiffness(drawn: Draw) -> Floats:
    """Plane-stress stiffness (4,) MPa."""
    m = drawn.moduli
    return orthotropic_stiffness(m["E1"], m["E2"], m["G12"], drawn.nu12)


def laminate(drawn: Draw) -> Floats:
    """Plane-stress stiffness (3, 3) MPa about the warp, of all plies by their thickness."""
    d11, d22, d12, d33 = stiffness(drawn)
    ply = np.array([[d11, d12, 0.0], [d12, d22, 0.0], [0.0, 0.0, d33]])
    share = drawn.get("rotated_ply.share")
    return (1.0 - share) * ply + share * _about(ply, -drawn.get("rotated_ply.angle"))


def moduli_about(whole: Floats, angle: float) -> dict[str, float]:
    """E1, E2, G12 (MPa) of a stiffness (3, 3) MPa about axes that are turned by degrees.

    Those of the orthotropic part of it: what couples shear with extension is no modulus' business.
    """
    turned = _about(whole, angle)
    even = 1.0 - turned[0, 1] ** 2 / (turned[0, 0] * turned[1, 1])
    return {"E1": turned[0, 0] * even, "E2": turned[1, 1] * even, "G12": turned[2, 2]}


def _about(whole: Floats, angle: float) -> Floats:
    """The same stiffness about axes that are turned by degrees (Jones, 1999, section 2.6).

    Strains (e1, e2, 2 e12) about the given axes from those about the turned ones; the energy stays.
    """
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    back = np.array(
        [[c * c, s * s, -c * s], [s * s, c * c, c * s], [2 * c * s, -2 * c * s, c * c - s * s]]
    )
    return back.T @ whole @ back


def law_of(drawn: Draw) -> dict[str, Any]:
    """Slack, gains, bends and knees along warp and fill, as `fem.membrane.Fabric` takes them."""

    def both(name: str, null: float = 0.0) -> tuple[float, float]:
        first, second = (drawn.get(f"{name}_{axis}", null) for axis in "xy")
        return first, second

    moduli = drawn.moduli["E1"], drawn.moduli["E2"]
    gain, bend = both("nonlinear_material.k"), both("nonlinear_material.s")
    return {
        "slack": both("prestrain.slack"),
        "gain": (gain[0] * moduli[0], gain[1] * moduli[1]),
        "bend": (bend[0] * moduli[0], bend[1] * moduli[1]),
        "knee": both("nonlinear_material.knee", 1.0),
    }


def evenness(drawn: Draw, mesh: Mesh, radius: float) -> Floats:
    """Stiffness over the nominal one at the Gauss points of a unit mesh, (cells, 4)."""
    at = np.einsum("ga,max->mgx", SHAPE, mesh.nodes[mesh.cells])
    gradient = drawn.get("stiffness_gradient.g_x"), drawn.get("stiffness_gradient.g_y")
    even = 1.0 + at @ np.array(gradient)
    return even * _patched(drawn, at * radius) * _sewn(drawn, at * radius) * _stitched(drawn, at)


def _patched(drawn: Draw, at: Floats) -> Floats:
    """A soft patch: factors at points (..., 2) mm from the centre."""
    centre = np.array([drawn.get("soft_patch.x"), drawn.get("soft_patch.y")])
    square = ((at - centre) ** 2).sum(axis=-1)
    return 1.0 - drawn.get("soft_patch.drop") * _bell(square, drawn.get("soft_patch.width", 1.0))


def _sewn(drawn: Draw, at: Floats) -> Floats:
    """A stiff seam: factors at points (..., 2) mm from the centre."""
    turn = np.deg2rad(drawn.get("stiff_seam.normal"))
    away = at @ np.array([np.cos(turn), np.sin(turn)]) - drawn.get("stiff_seam.distance")
    return 1.0 + drawn.get("stiff_seam.rise") * _bell(away**2, drawn.get("stiff_seam.width", 1.0))


def _stitched(drawn: Draw, at: Floats) -> Floats:
    """A stitched sector: factors at points (..., 2) of the unit disc."""
    degrees = np.rad2deg(np.arctan2(at[..., 1], at[..., 0]))
    away = degrees_apart(degrees, drawn.get("stitched_sector.middle"))
    half = drawn.get("stitched_sector.half_width", 1.0)
    share = np.cos(0.5 * np.pi * np.minimum(away / half, 1.0)) ** 2 * (at**2).sum(axis=-1)
    return 1.0 + drawn.get("stitched_sector.rise") * share


def _bell(square: Floats, width: float) -> Floats:
    """exp(-d²/2w²) of squared distances (mm²)."""
    return np.exp(-0.5 * square / width**2)


def turn_ply(membrane: Membrane, drawn: Draw) -> None:
    """Turn the second ply of a membrane of `TwoPlies`, and share thickness and load out."""
    first, second = np.split(membrane.mesh.cells, 2)
    turned = membrane.angle + np.deg2rad(drawn.get("rotated_ply.angle"))
    plies = [
        ReferenceSurface.of(membrane.reference, cells, angle)
        for cells, angle in ((first, membrane.angle), (second, turned))
    ]
    gradient = np.concatenate([ply.gradient for ply in plies])
    membrane.surface = ReferenceSurface(gradient, membrane.surface.area)
    share = drawn.get("rotated_ply.share")
    shares = np.repeat([1.0 - share, share], len(first))
    membrane.weight = membrane.weight * shares[:, None]
    membrane.share = shares  # of the pressure's work, which counts once
