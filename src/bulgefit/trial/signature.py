"""How much do the causes of a made test change what is seen?

A cause is worth what is seen with all of them less what is seen without it. What moduli, or other
sizes of the other causes, can imitate of that tells nothing; what they leave does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.elasticity import orthotropic_stiffness_derivative
from bulgefit.trial.camera import Setting, material_points, observe
from bulgefit.trial.draw import Draw, only, without
from bulgefit.trial.fabric import balance, path_of
from bulgefit.trial.hexagon import FINENESS, hexagon
from bulgefit.trial.rim import course_of
from bulgefit.trial.window import NodalField

__all__ = ["noise_free", "of_all", "of_each"]

Floats = NDArray[np.float64]

#: Fineness on which causes are weighed one by one: their differences have hardly a mesh error.
_ROUGH = 8


def noise_free(drawn: Draw, setting: Setting, fineness: int = FINENESS) -> tuple[Floats, Floats]:
    """Reference heights (n,) and displacements (frames, n, 3) mm as seen, without noise.

    Raises
    ------
    UnstableDrawError
    """
    shapes = balance(
        drawn,
        course_of(drawn, setting.pressure, setting.time),
        radius=setting.radius,
        thickness=setting.thickness,
        fineness=fineness,
    )
    return observe(drawn, setting, shapes)


def of_all(drawn: Draw, setting: Setting, seen: Floats, fineness: int) -> dict[str, float]:
    """What all causes change together, rms in mm: all of it, and what the moduli leave.

    Raises
    ------
    UnstableDrawError
    """
    if not drawn.effects:
        return {"signature_mm": 0.0, "signature_left_mm": 0.0}
    clean = without(drawn)
    change = seen - noise_free(clean, setting, fineness)[1]
    return _sizes(change, _by_moduli(clean, setting, fineness))


def of_each(drawn: Draw, setting: Setting) -> dict[str, dict[str, float]]:
    """The same of each cause beside the others; sizes of the others are free, too.

    Raises
    ------
    UnstableDrawError
    """
    if not drawn.effects:
        return {}
    whole = noise_free(drawn, setting, _ROUGH)[1]
    changes = {}
    for effect in drawn.effects:
        others = only(drawn, [e for e in drawn.effects if e != effect])
        changes[effect] = whole - noise_free(others, setting, _ROUGH)[1]
    moduli = _by_moduli(without(drawn), setting, _ROUGH)
    return {
        effect: _sizes(change, np.stack([*moduli, *(c for e, c in changes.items() if e != effect)]))
        for effect, change in changes.items()
    }


def _sizes(change: Floats, columns: Floats) -> dict[str, float]:
    """Rms (mm) of a change (frames, n, 3), and of what a combination of others (k, …) leaves."""
    design = columns.reshape(len(columns), -1).T
    weights, *_ = np.linalg.lstsq(design, change.ravel(), rcond=None)
    left = change.ravel() - design @ weights
    points = change.size / 3
    return {
        "signature_mm": float(np.sqrt((change**2).sum() / points)),
        "signature_left_mm": float(np.sqrt((left**2).sum() / points)),
    }


def _by_moduli(clean: Draw, setting: Setting, fineness: int) -> Floats:
    """∂(displacement)/∂(E1, E2, G12), (3, frames, n, 3) mm/MPa, on the coarse mesh."""
    mesh = hexagon(fineness // 2)
    _, path = path_of(
        clean,
        mesh,
        setting.pressure,
        radius=setting.radius,
        thickness=setting.thickness,
        sensitivities=True,
    )
    by_stiffness = path.stiffness_sensitivity(setting.pressure)
    m = clean.moduli
    chain = orthotropic_stiffness_derivative(m["E1"], m["E2"], m["G12"], clean.nu12)[:, :3]
    nodal = np.einsum("dm,dfnc->mfnc", chain, by_stiffness)
    return NodalField(setting.radius * mesh.nodes, material_points(clean, setting))(nodal)
