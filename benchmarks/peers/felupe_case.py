"""The benchmark's case by felupe: python felupe_case.py CASE.npz -> one line of JSON.

felupe has no membrane, but a field of three components on a plane region of quadrilaterals has the
membrane's gradient, 3 x 2, and its integral forms assemble any stress and tangent of it.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import felupe
import numpy as np
from scipy.sparse.linalg import spsolve


def main() -> None:
    """Solve all pressure levels, each from the shape of the one before."""
    case = np.load(sys.argv[1])
    nodes, cells, levels = case["nodes"], case["cells"], case["levels"]
    thickness, radius = float(case["thickness"]), float(case["radius"])
    region = felupe.RegionQuad(felupe.Mesh(nodes, cells, "quad"))
    displacement = felupe.Field(region, dim=3)
    field = felupe.FieldContainer([displacement])
    d11, d22, d12, d33 = (float(d) for d in case["stiffness"])
    elastic = np.zeros((2, 2, 2, 2))
    elastic[0, 0, 0, 0], elastic[1, 1, 1, 1] = d11, d22
    elastic[0, 0, 1, 1] = elastic[1, 1, 0, 0] = d12
    for i, j in ((0, 1), (1, 0)):
        elastic[i, j, 0, 1] = elastic[i, j, 1, 0] = d33
    flat = np.eye(3, 2)[:, :, None, None]
    held = np.isin(np.arange(len(nodes)), case["rim"])
    free = np.flatnonzero(np.repeat(~held, 3))
    permutation = np.zeros((3, 3, 3))
    permutation[0, 1, 2] = permutation[1, 2, 0] = permutation[2, 0, 1] = 1.0
    permutation[2, 1, 0] = permutation[0, 2, 1] = permutation[1, 0, 2] = -1.0

    def forms(pressure: float) -> tuple[np.ndarray, Any]:
        """Out-of-balance force and tangent of the shape that the field holds."""
        f = displacement.grad() + flat
        strain = 0.5 * (np.einsum("kiqc,kjqc->ijqc", f, f) - np.eye(2)[:, :, None, None])
        stress = np.einsum("ijkl,klqc->ijqc", elastic, strain)
        first = thickness * np.einsum("iJqc,JKqc->iKqc", f, stress)
        stiff = np.einsum("iIqc,IJKL,kKqc->iJkLqc", f, elastic, f, optimize=True)
        stiff += np.einsum("ik,JLqc->iJkLqc", np.eye(3), stress)
        normal = np.einsum("ijk,jqc,kqc->iqc", permutation, f[:, 0], f[:, 1])
        load = np.empty((3, 3, 2, *f.shape[2:]))
        load[:, :, 0] = np.einsum("ijk,kqc->ijqc", permutation, f[:, 1])
        load[:, :, 1] = np.einsum("ikj,kqc->ijqc", permutation, f[:, 0])
        dv, form = region.dV, felupe.IntegralForm
        force = form([first], field, dv).assemble()
        force -= pressure * form([normal], field, dv, grad_v=[False]).assemble()
        tangent = form([thickness * stiff], field, dv, field).assemble()
        tangent -= (
            pressure * form([load], field, dv, field, grad_v=[False], grad_u=[True]).assemble()
        )
        return force.toarray().ravel(), tangent

    start = time.process_time()
    bubble = 1.0 - (nodes**2).sum(axis=1) / radius**2
    displacement.values[:, 2] = float(case["first_height"]) * bubble
    displacement.values[held] = 0.0
    iterations = 0
    for level in levels:
        for _ in range(50):
            force, tangent = forms(level)
            step = np.zeros(3 * len(nodes))
            step[free] = spsolve(
                tangent[free][:, free].tocsc(), -force[free], permc_spec="MMD_AT_PLUS_A"
            )
            displacement.values += step.reshape(-1, 3)
            iterations += 1
            if np.abs(step).max() <= 1e-6:
                break
        else:
            sys.exit(f"felupe: no convergence at {10 * level:g} bar")
    seconds = time.process_time() - start
    apex = int(np.argmin((nodes**2).sum(axis=1)))
    answer = {
        "version": f"felupe {felupe.__version__}",
        "seconds": seconds,
        "iterations": iterations,
        "apex_mm": float(displacement.values[apex, 2]),
    }
    print(json.dumps(answer))


main()
