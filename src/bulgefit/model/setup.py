"""How is a virtual test computed: law, mesh, evaluation at points, interpolation in pressure?"""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Real

import numpy as np

from bulgefit.errors import InputError, one_of
from bulgefit.fem.laws.registry import LAWS
from bulgefit.fem.linear import SOLVERS
from bulgefit.fem.mesh import DEFAULT_REFINE, Mesh, check_refine
from bulgefit.model.observation import METHODS

__all__ = ["INTERPOLATIONS", "STUDY_LEVELS", "Setup"]

INTERPOLATIONS = ("dense", "study", "none")

#: The study's pressure levels, MPa.
STUDY_LEVELS = np.linspace(0.001, 3.0, 200) * 0.1


@dataclass(frozen=True)
class Setup:
    """How the virtual test is computed.

    Attributes
    ----------
    law : str
        A key of `bulgefit.fem.laws.LAWS`.
    mesh : Mesh or None
        None: a disc of the test's radius, `refine` times refined.
    refine : int
    relaxation : bool
        Tension-field relaxation.
    evaluation : {"smooth", "shape", "rbf", "local-rbf"}
        Field evaluation at the measured points; see `bulgefit.model.observation`.
    interpolation : {"dense", "study", "none"}
        In pressure: the path's dense output, but for frames to which it does not come within the
        tolerance, linear between the study's 200 levels, or none: every frame is balanced.
    tolerance : float, mm
        Of the dense output, for a radius of 100 mm.
    linear_solver : str or None
        Force a linear solver; None chooses by size.
    correct_mesh : bool
        Take the mesh's error off, as estimated from a finer one. Only with bulgefit's own meshes,
        smooth evaluation and an interpolation other than the study's; never done otherwise.
    """

    law: str = "hencky"
    mesh: Mesh | None = field(default=None, compare=False)
    refine: int = DEFAULT_REFINE
    relaxation: bool = True
    evaluation: str = "smooth"
    interpolation: str = "dense"
    tolerance: float = 1e-4
    linear_solver: str | None = None
    correct_mesh: bool = True

    def __post_init__(self) -> None:
        one_of(self.law, LAWS, "law")
        one_of(self.evaluation, METHODS, "evaluation")
        one_of(self.interpolation, INTERPOLATIONS, "interpolation")
        if self.linear_solver is not None:
            one_of(self.linear_solver, SOLVERS, "linear solver")
        if not isinstance(self.tolerance, Real) or not 0.0 < self.tolerance < np.inf:
            raise InputError(f"tolerance must be a length above 0 mm, got {self.tolerance!r}")
        if self.mesh is None:
            check_refine(self.refine)

    @classmethod
    def study(cls, mesh: Mesh | None = None, law: str = "hencky") -> Setup:
        """The published study's way: its radial basis functions through the nodes of its mesh,

        linear between its 200 pressure levels, the mesh's error left in.
        """
        return cls(law=law, mesh=mesh, evaluation="rbf", interpolation="study", correct_mesh=False)

    @property
    def corrects_mesh(self) -> bool:
        """Whether the mesh's error is taken off."""
        smooth = self.evaluation == "smooth" and self.interpolation != "study"
        return self.correct_mesh and smooth and self.mesh is None
