"""A specimen as it is judged: its noise, the values in use, and the cells that are held out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.noise import Noise
from bulgefit.gap.specimen import Specimen
from bulgefit.model.sight import Prediction, Sight

__all__ = ["FOLDS", "Blocks", "Data"]

Floats = NDArray[np.float64]

FRAME_BLOCKS, SECTORS, FOLDS = 4, 6, 4


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of neighbouring frames and sectors, and the fold in which each cell is held out.

    Attributes
    ----------
    block : (frames,) int array
        Contiguous in pressure.
    sector : (points,) int array
    """

    block: NDArray[np.int64]
    sector: NDArray[np.int64]

    @classmethod
    def of(cls, reference: Floats, pressure: Floats) -> Blocks:
        """Contiguous blocks of pressure times sectors."""
        rank = np.argsort(np.argsort(pressure))
        angle = np.arctan2(reference[:, 1], reference[:, 0]) + np.pi
        sector = np.minimum((angle * SECTORS / (2 * np.pi)).astype(int), SECTORS - 1)
        return cls(rank * FRAME_BLOCKS // max(len(pressure), 1), sector)

    def held_block(self, fold: int) -> NDArray[np.int64]:
        """The block that a fold holds out of each point's frames, (points,).

        A diagonal pattern, so each fold has all blocks and all sectors.
        """
        return (fold - self.sector) % FOLDS

    def held(self, fold: int) -> NDArray[np.bool_]:
        """Frames and points that a fold holds out, (frames, points)."""
        return self.block[:, None] == self.held_block(fold)[None, :]


@dataclass(eq=False)
class Data:
    """A specimen with its noise and cells.

    Attributes
    ----------
    specimen : Specimen
    sigma : (3,) array, mm
    used : (frames, points, 3) bool array
        Measured, and not an outlier.
    inflation : float
        Factor on variances of means: noise that is correlated in space counts less, and so do
        frames that are mixtures of others.
    mixture : float
        Its part by the latter: frames over those that are independent.
    persistent : float
        Share of the noise's variance that is the same in every frame.
    mesh : (frames, points, 3) array or None, mm
        What the correction leaves of the mesh's error; None where it is not known.
    trust : (frames,) array or None
        Noise over noise and the model's own doubt, of frames in which the fabric wrinkles or that
        hang on the mesh; None: 1 everywhere.
    """

    specimen: Specimen
    sigma: Floats
    used: NDArray[np.bool_]
    inflation: float = 1.0
    persistent: float = 0.0
    mesh: Floats | None = None
    trust: Floats | None = None
    mixture: float = 1.0
    blocks: Blocks = field(init=False)

    def __post_init__(self) -> None:
        self.blocks = Blocks.of(self.specimen.reference, self.specimen.recorded)

    def thinned(self, every: int) -> Data:
        """With one in so many of its points.

        Points whose noise is correlated say little that their neighbours do not: the rest stand
        so far apart that fewer of them count as one. What persists in a point stays as it is.
        """
        if every <= 1:
            return self
        points = np.zeros(len(self.specimen.reference), dtype=bool)
        points[::every] = True
        specimen = self.specimen.of(self.specimen.test.select(points=points))
        specimen.correction = self.specimen.correction
        apart = 1.0 + (self.in_space - 1.0) / every
        persists = self.persistent * len(self.used)
        return Data(
            specimen,
            self.sigma,
            self.used[:, points],
            persists + self.mixture * (1.0 - self.persistent) * apart,
            self.persistent,
            None if self.mesh is None else self.mesh[:, points],
            self.trust,
            self.mixture,
        )

    def of_frames(self, frames: NDArray[np.intp]) -> Data:
        """With some of its frames, before its units are fixed."""
        specimen = self.specimen.of(self.specimen.test.select(frames=frames))
        return Data(
            specimen,
            self.sigma,
            self.used[frames],
            self.inflation_over(len(frames)),
            self.persistent,
            mixture=self.mixture,
        )

    def afresh(self) -> Data:
        """The same, by a specimen that remembers nothing of earlier solves."""
        specimen = self.specimen.of(self.specimen.test)
        specimen.correction = self.specimen.correction
        return replace(self, specimen=specimen)

    def take_noise(self, noise: Noise) -> None:
        """Go by another estimate of the noise.

        What persists comes back in every frame, mixture or not; what is drawn anew, in those alone
        that are independent.
        """
        self.sigma, self.persistent = noise.sigma, noise.persistent
        persists = noise.persistent * len(self.used)
        self.inflation = persists + self.mixture * (noise.inflation - persists)

    def inflation_over(self, frames: int) -> float:
        """`inflation` of some of the frames: what persists comes back in so many."""
        return self.persistent * frames + self.mixture * (1.0 - self.persistent) * self.in_space

    @property
    def drawn_anew(self) -> float:
        """`inflation` by what does not persist."""
        return self.inflation - self.persistent * len(self.used)

    @property
    def in_space(self) -> float:
        """`inflation` by what is correlated in space, of the noise that each frame has anew."""
        anew = 1.0 - self.persistent
        return self.drawn_anew / (anew * self.mixture) if anew > 0.0 else 1.0

    @property
    def in_a_frame(self) -> float:
        """Factor on variances of means over the points of one frame; each point persists alone."""
        return self.persistent + (1.0 - self.persistent) * self.in_space

    def of_frames_mean(self, number: Floats) -> Floats:
        """Variance of means over a point's frames, in units of one frame's, by their number."""
        return self.persistent + (1.0 - self.persistent) * self.mixture / number

    @property
    def heights(self) -> Floats | None:
        """Heights (points,) mm before inflation, as measured; None where they were not kept."""
        height = self.specimen.reference[:, 2]
        return height if height.any() else None

    def residual(self, prediction: Prediction | Sight) -> Floats:
        """(measured - modelled) over noise and doubt, 0 where unused: (frames, points, 3)."""
        difference = (self.specimen.measured - prediction.displacement) * self.weight
        return np.where(self.used, difference, 0.0)

    @property
    def weight(self) -> Floats:
        """One over noise and doubt, 0 where unused: (frames, points, 3), 1/mm."""
        return np.asarray(self.used * self.share[:, None, None] / self.sigma)

    @property
    def hangs_on_mesh(self) -> NDArray[np.bool_]:
        """Frames in which more than the noise is left of the mesh's error: (frames,)."""
        if self.mesh is None:
            return np.zeros(len(self.used), dtype=bool)
        error = np.where(self.used, self.mesh / self.sigma, 0.0)
        return np.asarray((error**2).mean(axis=1).max(axis=1) > 1.0)

    @property
    def share(self) -> Floats:
        """`trust`, 1 where it was not judged: (frames,)."""
        return np.ones(len(self.used)) if self.trust is None else self.trust
