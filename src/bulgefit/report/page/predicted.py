"""What does the model show at some of a test's points? For maps, from parameters by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import by_key, of_specimen
from bulgefit.fem.mesh import DEFAULT_REFINE
from bulgefit.gap.normal import offsets_of
from bulgefit.gap.specimen import Specimen
from bulgefit.model.mesh_error import correct_mesh
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["of_diagnosis", "of_fit"]

Floats = NDArray[np.float64]


def of_fit(test: BulgeTest, result: Mapping[str, Any], index: int) -> list[Floats]:
    """Displacements (mm) of every block by the parameters of a fit's JSON, on bulgefit's own mesh.

    Raises
    ------
    SolveError
        No equilibrium at the test's pressures.
    """
    values = {name: found["value"] for name, found in result["parameters"].items()}
    own = of_specimen(by_key(values), index)
    material = {name: value for name, value in own.items() if "." not in name}
    effects = {name: value for name, value in own.items() if "." in name}
    settings = result["settings"]
    setup = Setup(
        law=settings["law"],
        refine=_refine(settings["cells"]),
        relaxation=settings["relaxation"],
        evaluation=settings["evaluation"],
        interpolation=settings["interpolation"],
        tolerance=settings["tolerance_mm"],
        correct_mesh=settings["mesh_error_taken_off"],
    )
    return list(predict(test, material, effects=effects, setup=setup).blocks)


def _refine(cells: int) -> int:
    """Of bulgefit's own mesh with so many cells; the default for another mesh."""
    refine = math.isqrt(cells // 57)
    return refine if 57 * refine**2 == cells else DEFAULT_REFINE


def of_diagnosis(
    test: BulgeTest,
    values: Mapping[str, float],
    index: int,
    law: str,
    trust: Mapping[str, Sequence[float]] | None = None,
) -> list[Floats]:
    """Displacements (mm) of the only block by the values of a diagnosis's record.

    Parameters
    ----------
    trust : mapping, optional
        Where every point has an offset, the `trust` in the frames at `judged_bar`: the offset is
        the one that leaves least of the point's residual.

    Raises
    ------
    SolveError
        No equilibrium at the test's pressures.
    """
    specimen = Specimen(test, law=law)
    with one_blas_thread():
        shapes = specimen.shapes(of_specimen(by_key(values), index))
        correct_mesh(specimen, shapes)
        prediction = specimen.observe(shapes)
    if trust is None:
        return [prediction.displacement]
    used = np.isfinite(specimen.measured)
    away = np.abs(10.0 * specimen.recorded[:, None] - np.array(trust["judged_bar"]))
    frames = np.array(trust["trust"])[away.argmin(axis=1)]
    offset = offsets_of(specimen.measured - prediction.displacement, used, frames)
    return [prediction.displacement + offset]
