"""What a model misses by, as noise of its own: how large over place and pressure, at which scale?

What no effect and no field can follow stays in the residual of every model, and it is not like
noise: it goes smoothly with pressure, in some components more than in others, and where it is
smooth in space, too, effects that have nothing to do with it are told by just such patterns. It
enters as a displacement d that is no place's, beside a model's parameters,

    r = J x + d + noise,    d = Σ φ_k(x, y) ψ_l(p) d_klc

with φ orthonormal polynomials over the specimen, ψ such of p^(1/3) over the frames, and c the
component. Its coefficients are Gaussian, alike for all φ of an octave of degrees (no part of the
specimen and no direction is more likely than another), with a covariance over l and c that is the
octave's own, and are integrated out: what goes as they do counts by so much less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data

__all__ = ["Misfit"]

Floats = NDArray[np.float64]

#: Largest degree over the specimen of each octave but the last, which is all that is finer (fewer,
#: where modes would be more than half the points); degree in p^(1/3).
OCTAVES, COURSE = (5, 10, 20), 5


@dataclass(frozen=True, eq=False)
class _Modes:
    """The basis over a specimen's points and frames.

    Attributes
    ----------
    over : tuple of (points, k) array
        Orthonormal, of each octave but the last.
    along : (frames, l) array
        Orthonormal.
    """

    over: tuple[Floats, ...]
    along: Floats

    @classmethod
    def of(cls, d: Data) -> _Modes:
        x, y = d.specimen.reference[:, :2].T / d.specimen.test.radius
        ends = [(n + 1) * (n + 2) // 2 for n in OCTAVES]
        ends = [end for end in ends if 2 * end <= len(x)]
        orders = [(i, n - i) for n in range(OCTAVES[len(ends) - 1] + 1) for i in range(n + 1)]
        in_x, in_y = (np.polynomial.legendre.legvander(at, OCTAVES[-1]) for at in (x, y))
        over, _ = np.linalg.qr(np.stack([in_x[:, i] * in_y[:, j] for i, j in orders], axis=1))
        load = np.cbrt(d.specimen.recorded / d.specimen.recorded.max())
        along, _ = np.linalg.qr(np.vander(load, min(COURSE + 1, len(load)), increasing=True))
        return cls(tuple(np.split(over, ends, axis=1)[: len(ends)]), along)

    @property
    def counts(self) -> list[int]:
        """Of the modes of each octave."""
        smooth = [part.shape[1] for part in self.over]
        return [*smooth, len(self.over[0]) - sum(smooth)]

    def courses(self, rows: Floats) -> Floats:
        """Of rows (n, frames, points, 3), by their ψ and components: (n, points, 3 l)."""
        seen = np.tensordot(rows, self.along, axes=(1, 0))
        return seen.reshape(*seen.shape[:2], -1)

    def parts(self, courses: Floats) -> list[Floats]:
        """The same by octaves, (n, k, 3 l) each; the last by points, without the others."""
        smooth = [np.einsum("nqj,qk->nkj", courses, part, optimize=True) for part in self.over]
        rest = courses - sum(
            np.einsum("nkj,qk->nqj", seen, part, optimize=True)
            for seen, part in zip(smooth, self.over, strict=True)
        )
        return [*smooth, rest]

    def rows(self, parts: Sequence[Floats]) -> Floats:
        """Rows (n, frames, points, 3) of parts."""
        courses = parts[-1] + sum(
            np.einsum("nkj,qk->nqj", seen, part, optimize=True)
            for seen, part in zip(parts, self.over, strict=False)
        )
        split = courses.reshape(*courses.shape[:2], 3, -1)
        return np.einsum("nqcl,fl->nfqc", split, self.along, optimize=True)


@dataclass(frozen=True, eq=False)
class Misfit:
    """Of one specimen.

    Attributes
    ----------
    modes : _Modes
    spread : tuple of (3 l, 3 l) array
        Covariance of the coefficients of each octave, over the variance of noise.
    """

    modes: _Modes
    spread: tuple[Floats, ...]

    @classmethod
    def of(cls, d: Data, rows: Floats, covariance: Floats) -> Misfit:
        """Of what a model leaves of a specimen.

        The likelihood is largest where the variances along the eigenvectors of the mean product of
        an octave's coefficients are its eigenvalues less the noise's, none where that is negative
        (Tipping and Bishop, 1999, "Probabilistic principal component analysis", eq. 7). The model's
        parameters have taken trace(Z (JᵀJ + 1/s²)⁻¹ Zᵀ) of the coefficients, Z being derivatives by
        the modes: what is left stands for all of them.

        Parameters
        ----------
        d : Data
        rows : (p + 1, frames, points, 3) array
            Derivatives by the specimen's own coordinates and the residual at the model's optimum,
            of which noise has variance 1.
        covariance : (p, p) array
            Their part of (JᵀJ + diag(1/s²))⁻¹ over all specimens, s being prior widths.
        """
        modes, spread = _Modes.of(d), list[Floats]()
        for part, count in zip(modes.parts(modes.courses(rows)), modes.counts, strict=True):
            slopes, left = part[:-1].reshape(len(covariance), -1), part[-1]
            freedom = count * part.shape[2]
            taken = float((slopes * (covariance @ slopes)).sum())
            values, turn = np.linalg.eigh(left.T @ left / count * freedom / (freedom - taken))
            spread.append((turn * np.maximum(values - 1.0, 0.0)) @ turn.T)
        return cls(modes, tuple(spread))

    @property
    def largest(self) -> float:
        """Variance of the octave, course and component that has most of it, over the noise's.

        What no model follows sits in few of them (a seam's is narrow, in one component, and grows
        with pressure), and effects that have nothing to do with it are told by just these.
        """
        return max(float(np.linalg.eigvalsh(spread)[-1]) for spread in self.spread)

    def on(self, d: Data, louder: float) -> Misfit:
        """The same misfit over other points of the specimen, which may tell an octave more.

        A mode's coefficient grows with the root of the number of points, and noise there has
        `louder` times the variance. What is finer than all octaves counts as the noise does.
        """
        modes = _Modes.of(d)
        more = len(modes.over[0]) / len(self.modes.over[0]) / louder
        last = len(self.spread) - 1
        smooth = [more * self.spread[min(octave, last)] for octave in range(len(modes.over))]
        return Misfit(modes, (*smooth, self.spread[last]))

    def whitened(self, rows: Floats) -> Floats:
        """Rows (n, frames, points, 3) by which products count beside the misfit.

        Noise of a mode has variance 1, noise and misfit 1 + λ along an eigenvector of its octave's
        covariance: there rows are less by √(1/(1 + λ)).
        """
        parts = self.modes.parts(self.modes.courses(rows))
        taken = []
        for part, spread in zip(parts, self.spread, strict=True):
            values, turn = np.linalg.eigh(spread)
            less = 1.0 - 1.0 / np.sqrt(1.0 + np.maximum(values, 0.0))
            taken.append(part @ (turn * less) @ turn.T)
        return np.asarray(rows - self.modes.rows(taken))
