"""How far does what a model leaves go beyond the noise, in the modes that effects have?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from bulgefit.gap.data import Data
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.model.sight import Prediction

__all__ = ["taken_up", "temper"]

Floats = NDArray[np.float64]

#: Degree of the polynomials in x and y, and in p^(1/3), that effects and fields hardly go beyond.
DEGREE, COURSE = 5, 5


def temper(data: Sequence[Data], predictions: Sequence[Prediction], taken: float) -> float:
    """Mean square of the residual's smooth modes over what evidence takes it to be; 1 or more.

    In each component the residual is projected on orthonormal polynomials over the specimen times
    such over the frames, as effects go smoothly with place and pressure. Evidence takes each mode
    to have the noise's inflation v as variance, which what persists of the noise leaves to that of
    a constant course alone; a model that errs may leave more, and effects that it has not are told
    by just such modes: what errs in every frame alike counts as often as they do. So variances
    there are v T, and evidence counts 1/T of what it would.

    Where parameters take nearly all modes, what is left of them says next to nothing: one mode more
    stands for what is thought of T without any, the noise (a prior worth one value, the unit
    information of Kass and Wasserman, 1995, "A reference Bayesian test for nested hypotheses").

    Parameters
    ----------
    taken : float
        Modes that the fit took away (`taken_up`).
    """
    square, modes = 0.0, 0
    for d, p in zip(data, predictions, strict=True):
        seen = _of_modes(d, _off_mesh(d, d.residual(p))[None])
        square += float((seen**2).sum()) / d.inflation
        modes += seen.size
    return max(_shrunk(square, modes - taken), 1.0)


def _shrunk(square: float, number: float) -> float:
    """Variance over the noise's, of a sum of squares over so many modes, and one of the noise."""
    return (square + 1.0) / (max(number, 0.0) + 1.0)


def taken_up(weighing: Weighing, fit: Fit, layout: Layout) -> float:
    """How many of the residual's smooth modes a fit's coordinates, and its offsets, take up.

    trace(Z (JᵀJ + diag(1/s²))⁻¹ Zᵀ), by derivatives J of all values and Z of the modes, and prior
    widths s: of coordinates that the data determine, not their priors, and of these the part that
    is seen in the modes (MacKay, 1992, "Bayesian interpolation", eq. 4.9, for modes one by one). An
    offset of every point takes away what is the same in all frames, each such mode as a whole.
    """
    columns = layout.columns(fit.model)
    here = weighing.linearise(fit.x, columns, fit.here.near)
    factor = cho_factor(here.hessian + np.diag(layout.width[columns] ** -2))
    found = 0.0
    for index, d in enumerate(weighing.data):
        own = weighing.coordinates.of_specimen(columns, index)
        slopes = np.zeros((len(columns), _of_modes(d, d.weight[None]).size))
        rows = weighing.of_frames(index, here.rows[index][:-1])
        slopes[np.searchsorted(columns, own)] = _of_modes(d, rows).reshape(len(own), -1)
        found += float((slopes * cho_solve(factor, slopes)).sum())
        if weighing.offsets is not None and weighing.offsets[index].sizes.any():
            found += 3.0 * (DEGREE + 1) * (DEGREE + 2) / 2
    return found


def _off_mesh(d: Data, residual: Floats) -> Floats:
    """A residual less what is left of the mesh's error in it, which models are judged beside.

    Near a limit of stability that is many times the noise: its most probable share.
    """
    if d.mesh is None:
        return residual
    mesh = np.where(d.used, d.mesh, 0.0) * d.weight
    share = float((mesh * residual).sum()) / (d.inflation + float((mesh**2).sum()))
    return np.asarray(residual - share * mesh)


def _of_modes(d: Data, rows: Floats) -> Floats:
    """Of rows (n, frames, points, 3): (n, modes over the frames, over the specimen, 3)."""
    x, y = d.specimen.reference[:, :2].T / d.specimen.test.radius
    orders = [(i, n - i) for n in range(DEGREE + 1) for i in range(n + 1)]
    over, _ = np.linalg.qr(np.stack([x**i * y**j for i, j in orders], axis=1))
    load = np.cbrt(d.specimen.recorded / d.specimen.recorded.max())
    along, _ = np.linalg.qr(np.vander(load, min(COURSE + 1, len(load))))
    return np.asarray(np.einsum("nk,fm,rfnc->rmkc", over, along, rows, optimize=True))
