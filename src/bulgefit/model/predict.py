"""What would the cameras have seen of a known material, at the points of a test?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTest, given_test
from bulgefit.errors import InputError
from bulgefit.model.mesh_error import correct_mesh, mesh_remainder
from bulgefit.model.parameters import Material, as_effects, as_material
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.shown import Drawn

__all__ = ["Predicted", "predict"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Predicted(Drawn):
    """Displacements as the cameras would report them.

    Attributes
    ----------
    blocks : tuple of (frames, points, 3) arrays, mm
        One for each block of the test.
    mesh_error : (3,) array, mm, or None
        Root mean square of what is left of the mesh's error in dx, dy, dz; None where it is not
        taken off or not known.
    stable : (frames,) bool array
        Whether the balanced shapes are stable.
    test : BulgeTest
        At whose points and pressures.
    """

    blocks: tuple[Floats, ...]
    mesh_error: Floats | None
    stable: NDArray[np.bool_]
    test: BulgeTest

    def __repr__(self) -> str:
        shapes = ", ".join(str(block.shape) for block in self.blocks)
        return f"Predicted(blocks of {shapes}; {int(self.stable.sum())} stable frames)"

    def as_test(self) -> BulgeTest:
        """The test as the model has it: nothing where nothing was measured.

        So what is told of a measurement is told of its model: `bulgefit.measure(p.as_test())`.
        """
        blocks = tuple(
            replace(own, displacement=np.where(np.isfinite(own.displacement), modelled, np.nan))
            for own, modelled in zip(self.test.blocks, self.blocks, strict=True)
        )
        return replace(self.test, blocks=blocks, static_displacement=None, source="", checksum="")

    def to_dict(self) -> dict[str, Any]:
        """Which frames, and how well they are known, as JSON types; `blocks` alone have fields."""
        return {
            "name": self.test.name,
            "pressure_bar": (10.0 * self.test.pressure).tolist(),
            "stable": self.stable.tolist(),
            "mesh_error_mm": None if self.mesh_error is None else self.mesh_error.tolist(),
        }

    def to_xarray(self) -> Any:
        """Displacement (mm) by frame, point and component, also where nothing was measured.

        Of a test of one block; needs `bulgefit[xarray]`.
        """
        return self.test.to_xarray().copy(data=self.displacement)

    def to_dataframe(self) -> Any:
        """A row a measured point and frame: measured, and `model_dx_mm` and so on beside it.

        Needs `bulgefit[pandas]`.
        """
        rows = []
        for frame in range(self.test.n_frames):
            for own, modelled in zip(self.test.blocks, self.blocks, strict=True):
                at = own.frames == frame
                rows.append(modelled[at][own.measured[at]])
        columns = np.concatenate(rows).T
        names = (f"model_{name}_mm" for name in ("dx", "dy", "dz"))
        return self.test.to_dataframe().assign(**dict(zip(names, columns, strict=True)))

    @property
    def displacement(self) -> Floats:
        """(frames, points, 3) mm, of a test of one block; InputError of others."""
        if len(self.blocks) != 1:
            raise InputError("the test's frames have points of their own: look at `blocks`")
        return self.blocks[0]


def predict(
    test: GivenTest,
    material: Material | Mapping[str, float],
    *,
    effects: Mapping[str, float] | None = None,
    setup: Setup | None = None,
) -> Predicted:
    """Displacements at a test's points and pressures.

    Parameters
    ----------
    test : BulgeTest or path
    material : Material or mapping
        Or E1, E2, G12 (MPa) of an orthotropic one (nu12 is the test's unless given), or E and nu,
        or E and G, of an isotropic one.
    effects : mapping of `effect.parameter` to value, optional
        What else the test has; see `bulgefit.effects`.
    setup : Setup, optional
        Law, mesh, evaluation; by default the mesh's error is taken off.

    Raises
    ------
    InputError
        Parameters that are unknown or not admissible.
    SolveError
        No equilibrium at the test's pressures.
    """
    test = given_test(test)
    made = as_material(material, test.poisson_ratio)
    virtual = VirtualTest(test, setup)
    with one_blas_thread():
        shapes = virtual.shapes({**made.constants(), **as_effects(effects)})
        correct_mesh(virtual, shapes)
        left = mesh_remainder(virtual, shapes)
        blocks = tuple(
            virtual.observe(shapes, block=i).displacement for i in range(len(test.blocks))
        )
    error = None if left is None else np.sqrt((left**2).mean(axis=(0, 1)))
    return Predicted(blocks, error, shapes.stable, test)
