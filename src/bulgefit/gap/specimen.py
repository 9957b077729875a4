"""A virtual test as the diagnosis judges it: of one block of points that all frames share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fem.mesh import DEFAULT_REFINE
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["Specimen"]


class Specimen(VirtualTest):
    """A virtual test of one block, with what was measured at its points.

    Parameters
    ----------
    test : BulgeTest
        Of one block.
    refine : int
        Of the mesh.
    law : str
    threads : int
        Frames that are balanced side by side; the result does not depend on it.
    held : mapping of str to float, optional
        See `VirtualTest`.
    """

    def __init__(
        self,
        test: BulgeTest,
        refine: int = DEFAULT_REFINE,
        law: str = "hencky",
        threads: int = 1,
        held: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(test, Setup(law=law, refine=refine), threads, held=held)

    def of(self, test: BulgeTest) -> Specimen:
        """Another test, computed the same way."""
        return Specimen(test, self.setup.refine, self.setup.law, self.threads, self.held)

    @property
    def reference(self) -> NDArray[np.float64]:
        """(n, 3) mm, where the points were seen before inflation."""
        (block,) = self.test.blocks
        return np.asarray(block.reference, dtype=np.float64)

    @property
    def measured(self) -> NDArray[np.floating]:
        """(frames, n, 3) mm."""
        (block,) = self.test.blocks
        return block.displacement
