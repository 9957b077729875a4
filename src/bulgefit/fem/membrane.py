"""A membrane: mesh, law, thickness and held displacements; its forces and tangent at a shape."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, one_of
from bulgefit.fem.clamp import Clamp
from bulgefit.fem.ellipticity import ROUNDING, least_margin
from bulgefit.fem.geometry import ReferenceSurface
from bulgefit.fem.kernels import (
    assemble,
    assemble_law_changes,
    assemble_pressure,
    assemble_reference_changes,
    assemble_sensitivity,
    assemble_weight_changes,
)
from bulgefit.fem.laws import LAWS
from bulgefit.fem.laws.potential import KNOTS, PARAMETERS
from bulgefit.fem.linear import Factor, LinearSolver, make_solver
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.ties import Ties

__all__ = ["NO_FIELDS", "NO_RATES", "NO_TANGENT", "ONCE", "Fabric", "Membrane", "State"]

Floats = NDArray[np.float64]

NO_TANGENT, NO_FIELDS, NO_RATES = np.empty(0), np.empty((0, 0, 3)), np.empty(0)
#: Every entry of the cells' matrices counts once.
ONCE = np.empty((0, 78))
#: Step of central differences, relative: they are off by its square, and by rounding over it.
_DIFFERENCE = 1e-5


@dataclass(frozen=True, eq=False)
class State:
    """What an assembly finds at one shape and pressure.

    Attributes
    ----------
    potential : float, N mm
        NaN where the shape is not admissible (a collapsed cell).
    residual : (N,) array, N
        Out-of-balance force on the free displacements, in the solver's order.
    reaction : (n, 3) array, N
        Out-of-balance force on every displacement.
    wrinkled : int
        Gauss points in tension-field relaxation.
    tangent : array or None, N/mm
        Entries as the linear solver stores them.
    change : (N,) array or None
        Of the residual, per unit of what it was asked for.
    """

    potential: float
    residual: Floats
    reaction: Floats
    wrinkled: int
    tangent: Floats | None = None
    change: Floats | None = None


#: Share of the slope along warp or fill that a gain may take, and a strain that no fabric has.
_SPENT, _NEVER = 0.9, 1e9


@dataclass(frozen=True, eq=False)
class Fabric:
    """What a specimen may have beside its moduli; the default is a flat, even, clamped fabric.

    Attributes
    ----------
    surface : (n, 3) array, mm, or None
        Stress-free positions of the nodes; None: flat, as the mesh is.
    thickness : (m, 4) array or None
        Thickness (stiffness) of each Gauss point over the nominal one, 1.
    slack : (2,) tuple
        Stress-free excess strain along warp and fill, 1; negative is pretension.
    gain : (2,) tuple, MPa
        Stress along warp and fill gains this times the squared elastic strain, in tension; where it
        softens, until a tenth of the slope is left: from there on the slope stays.
    bend : (2,) tuple, MPa
        The slope of stress along warp and fill changes by this beyond the knee, in tension.
    knee : (2,) tuple
        Elastic strain along warp and fill at which half of the bend is reached, 1.
    curve : (2, 7) array or None
        Logarithm of the slope of stress along warp and fill in uniaxial tension over what modulus,
        gain and bend make of it, at the elastic strains `KNOTS`. What it adds is linear between
        them and constant beyond, so that the stress is a smooth function of its strain. None: no
        other slope, as zeros.
    coupling : (2,) tuple, MPa
        D13 and D23: stress along warp and fill from the engineering shear strain, and shear stress
        from theirs, as where a layer lies at an angle.
    compliance : float, mm per N/mm, or None
        The rim moves inwards by this times the radial edge traction; None: it is held.
    """

    surface: Floats | None = None
    thickness: Floats | None = None
    slack: tuple[float, float] = (0.0, 0.0)
    gain: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float] = (0.0, 0.0)
    knee: tuple[float, float] = (0.01, 0.01)
    curve: Floats | None = None
    coupling: tuple[float, float] = (0.0, 0.0)
    compliance: float | None = None

    @property
    def is_straight(self) -> bool:
        """Whether stress is proportional to strain, by the law's own measure."""
        return self.curve is None and not any((*self.gain, *self.bend))

    @property
    def lies_flat(self) -> bool:
        """Whether it comes to lie in the plane of its rim as pressure goes to nothing.

        Slack along one yarn does, held by the other, which is straight from rim to rim; slack along
        both bulges as far as its yarns are long, and so may a surface of its own.
        """
        return self.surface is None and min(self.slack) <= 0.0

    @property
    def lies_loosely(self) -> bool:
        """Whether light pressures may leave it in folds: it is slack somehow, or not flat."""
        uneven = self.surface is not None and bool(self.surface[:, 2].any())
        return uneven or max(self.slack) > 0.0

    def law_parameters(self, stiffness: Floats) -> tuple[float, ...]:
        """What the kernels call q, as `laws.potential.PARAMETERS` names it.

        Raises
        ------
        InputError
            A curve that is none, or slopes or couplings that leave no positive definite law.
        """
        if any(self.coupling):
            _check_coupling(self.coupling, stiffness, np.zeros(2))
        own = *self.slack, *self.gain, *self.bend, *self.knee
        spent = self._spent(stiffness)
        added = np.zeros((2, len(KNOTS)))
        if self.curve is not None:
            added = self._excess(self.curve, stiffness, spent)
        if self.curve is not None or min(*self.gain, *self.bend) < 0.0:
            self._check_slopes(stiffness, spent, added)
        last = *self.coupling, *spent
        return (*map(float, (*stiffness, *own)), *added.ravel().tolist(), *map(float, last))

    def _spent(self, stiffness: Floats) -> Floats:
        """Strains (2,) at which a gain that softens has taken its share of what bends leave."""
        if min(self.gain) >= 0.0:
            return np.full(2, _NEVER)
        d11, d22, _, _ = stiffness
        left = _moduli(stiffness) + np.minimum(self.bend, 0.0)
        falling = np.maximum(-np.array(self.gain), 0.5 * _SPENT * (d11 + d22) / _NEVER)
        return np.maximum(0.5 * _SPENT * left / falling, 0.0)

    def _excess(self, curve: Floats, stiffness: Floats, spent: Floats) -> Floats:
        """Slopes (2, K) MPa at the knots that a curve (2, K) adds to those of gains and bends.

        It multiplies these there; what it takes off at the last knot, it takes off beyond, too, so
        there it is of what bends and gains that soften leave before the cloth tears.
        """
        curve = np.asarray(curve, dtype=float)
        if curve.shape != (2, len(KNOTS)) or not np.isfinite(curve).all():
            raise InputError(
                f"curve: expected 2 x {len(KNOTS)} finite logarithms of slopes, got "
                f"{curve.tolist()}"
            )
        moduli = _moduli(stiffness)
        named = self._slopes(np.array(KNOTS), moduli, spent)
        end = np.minimum(named[:, -1], self._slopes(np.array([_TORN]), moduli, spent)[:, 0])
        named[:, -1] = np.where(curve[:, -1] < 0.0, end, named[:, -1])
        return np.asarray(named * np.expm1(curve))

    def _check_slopes(self, stiffness: Floats, spent: Floats, added: Floats) -> None:
        """Refuse slopes, of which a curve has added some (2, K) MPa, that soften both ways too far.

        The stiffness D + diag(E1 (s1 - 1), E2 (s2 - 1)) of slopes E1 s1 and E2 s2 is positive
        definite where s1 s2 > ν12 ν21 (1 - s1)(1 - s2): always, unless both soften. What couplings
        with shear leave of it has to be so as well.
        """
        d11, d22, d12, _ = stiffness
        contraction = d12**2 / (d11 * d22)  # ν12 ν21
        moduli = _moduli(stiffness)
        everywhere = [np.interp(_STRAINS, KNOTS, row) for row in added]
        whole = self._slopes(_STRAINS, moduli, spent) + everywhere
        warp, fill = np.minimum(whole.min(axis=1) / moduli, 1.0)
        if not (min(warp, fill) > 0.0 and warp * fill > contraction * (1.0 - warp) * (1.0 - fill)):
            raise InputError(
                f"slopes of {warp:.3g} E1 and {fill:.3g} E2 along warp and fill leave no positive "
                f"strain energy with nu12 nu21 = {contraction:.3g}; let curve, gains or bends "
                "soften less"
            )
        if any(self.coupling):
            _check_coupling(self.coupling, stiffness, moduli * (np.array([warp, fill]) - 1.0))

    def _slopes(self, strain: Floats, moduli: Floats, spent: Floats) -> Floats:
        """Of stress along warp and fill, (2, n) MPa, by moduli, gains and bends."""
        gain, bend, knee = (np.reshape(row, (2, 1)) for row in (self.gain, self.bend, self.knee))
        turned = strain**2 / (strain**2 + knee**2)
        gained = 2.0 * gain * np.minimum(strain, spent[:, None])
        return np.asarray(moduli[:, None] + gained + bend * turned)


def _moduli(stiffness: Floats) -> Floats:
    """E1 and E2, MPa."""
    d11, d22, d12, _ = stiffness
    return np.array([d11 - d12**2 / d22, d22 - d12**2 / d11])


def _check_coupling(coupling: tuple[float, float], stiffness: Floats, softer: Floats) -> None:
    """Refuse couplings beside a stiffness that slopes change by `softer` (2,) MPa at most."""
    d11, d22, d12, d33 = stiffness
    d13, d23 = coupling
    whole = np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]])
    whole[[0, 1], [0, 1]] += softer
    if not np.linalg.eigvalsh(whole).min() > 0.0:
        raise InputError(
            f"coupling: D13 = {d13:.4g}, D23 = {d23:.4g} MPa leave no positive strain energy "
            f"beside D11, D22, D33 of {whole[0, 0]:.4g}, {whole[1, 1]:.4g}, {d33:.4g} MPa; make "
            "them smaller"
        )


#: Where slopes are looked at: from one to the next of these they hardly change.
_STRAINS = np.linspace(0.0, KNOTS[-1], 161)
#: Coated fabrics tear before this strain.
_TORN = 0.3


class Membrane:
    """A Q4 membrane under follower pressure.

    Parameters
    ----------
    mesh : Mesh
    thickness : float, mm
    law : str
        A name in `bulgefit.fem.laws.LAWS`.
    relaxation : bool
        Tension-field relaxation: no compression. Off, the fabric carries compression as a sheet
        that cannot buckle.
    angle : float, rad
        Warp axis from x, counter-clockwise seen from +z.
    fixed : (n, 3) bool array, optional
        Displacements held at zero; default: all three on the rim.
    solver : str, optional
        Force a linear solver by name (`bulgefit.fem.linear.SOLVERS`).
    fabric : Fabric, optional
        What else there is to the specimen: stress-free surface, slack, gains, slipping clamp.
    like : Membrane, optional
        A membrane of the same mesh and held displacements, whose linear solver is shared, and
        whose surface, where it is the same.
    ties : Ties, optional
        Nodes that copy others; the clamp may not slip then.
    """

    def __init__(
        self,
        mesh: Mesh,
        thickness: float = 0.81,
        law: str = "hencky",
        *,
        relaxation: bool = True,
        angle: float = 0.0,
        fixed: NDArray[np.bool_] | None = None,
        solver: str | None = None,
        fabric: Fabric | None = None,
        like: Membrane | None = None,
        ties: Ties | None = None,
    ) -> None:
        one_of(law, LAWS, "law")
        if not (np.isfinite(thickness) and thickness > 0.0):
            raise InputError(f"thickness must be positive, got {thickness:g} mm")
        if ties is not None and fabric is not None and fabric.compliance is not None:
            raise InputError("membrane: nodes that copy others need a clamp that does not slip")
        self.mesh = mesh
        self.thickness = float(thickness)
        self.law = law
        self.relaxation = bool(relaxation)
        self.angle = float(angle)
        if fixed is None:
            fixed = np.zeros((len(mesh.nodes), 3), dtype=bool)
            fixed[mesh.rim] = True
        self.fabric = fabric or Fabric()
        if self.fabric.compliance is not None:
            fixed = fixed.copy()
            fixed[mesh.rim, :2] = False
        self.fixed, self.forced = fixed, solver
        self._law_parameters: tuple[bytes, tuple[float, ...]] | None = None
        flat = np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))])
        self.reference = flat if self.fabric.surface is None else self.fabric.surface
        if like is not None and self._lies_as(like):
            self.surface: ReferenceSurface = like.surface
        else:
            self.surface = ReferenceSurface.of(self.reference, mesh.cells, self.angle)
        self.weight = self.thickness * self.surface.area
        if self.fabric.thickness is not None:
            least = float(self.fabric.thickness.min())
            if not least > 0.0:
                raise InputError(
                    f"stiffness falls to {least:.3g} of its mean somewhere on the specimen; let it "
                    "vary less"
                )
            self.weight = self.weight * self.fabric.thickness
        self.ties, self.times = ties, ONCE
        self.share = np.ones(len(mesh.cells)) if ties is None else ties.share
        if ties is not None:
            self.weight = self.weight * ties.share[:, None]
        self.linear: LinearSolver = self._solver(solver) if like is None else like.linear
        if ties is not None:
            self.times = ties.times(mesh.cells, self.linear.dof)
        self.clamp = (
            None
            if self.fabric.compliance is None
            else Clamp(mesh, self.reference, self.linear, self.fabric.compliance)
        )
        free = self.linear.dof >= 0
        # (size,) flat nodal index of each unknown, in the solver's order
        self._unknowns = np.empty(self.linear.size, dtype=np.int64)
        self._unknowns[self.linear.dof[free]] = np.flatnonzero(free.ravel())

    def pulled_at(self, ends: Floats) -> Membrane:
        """The same with the outer ends of its clamp's springs displaced by (rim, 2) mm."""
        out = copy(self)
        out.clamp = None if self.clamp is None else self.clamp.pulled_at(ends)
        return out

    def eased(self, by: float) -> Membrane:
        """The same with a clamp that gives by so much more, mm per N/mm."""
        out = copy(self)
        if self.clamp is not None:
            out.clamp = self.clamp.at(self.clamp.compliance + by)
        return out

    def _solver(self, name: str | None) -> LinearSolver:
        """A linear solver for the displacements that are neither held nor copied."""
        free, cells = ~self.fixed, self.mesh.cells
        if self.ties is not None:
            free[self.ties.copies] = False
            cells = self.ties.original[cells]
        return make_solver(self.mesh.nodes, cells, free, name)

    def _lies_as(self, other: Membrane) -> bool:
        """Whether stress-free surface and warp axis are those of another membrane of the mesh."""
        return self.angle == other.angle and np.array_equal(self.reference, other.reference)

    @property
    def radius(self) -> float:
        """Largest distance of a node from the origin, mm."""
        return self.mesh.reach

    def gather(self, nodal: Floats) -> Floats:
        """Forces on the free displacements, of (..., n, 3) nodal ones: (..., N)."""
        if self.ties is not None:
            nodal = self.ties.fold(nodal)
        return nodal.reshape(*nodal.shape[:-2], -1)[..., self._unknowns]

    def spread(self, unknowns: Floats) -> Floats:
        """Nodal (..., n, 3) field of (..., N) values; zero where displacements are held."""
        out = np.zeros((*unknowns.shape[:-1], self.fixed.size))
        out[..., self._unknowns] = unknowns
        out = out.reshape(*unknowns.shape[:-1], -1, 3)
        return self.tied(out)

    def tied(self, displacement: Floats) -> Floats:
        """A displacement (..., n, 3) in which copies do as their originals."""
        return displacement if self.ties is None else self.ties.follow(displacement)

    def state(
        self,
        displacement: Floats,
        pressure: float,
        stiffness: Floats,
        *,
        tangent: bool = True,
        along: tuple[Floats, float] | None = None,
    ) -> State:
        """Assemble at a displacement (n, 3) mm, pressure in MPa, stiffness (4,) MPa.

        With `along`, a field (n, 3) and a rate of the pressure, also how the residual changes.
        """
        residual = np.empty_like(self.reference)
        data = self.linear.blank() if tangent else NO_TANGENT
        fields, rates = NO_FIELDS, NO_RATES
        if along is not None:
            fields, rates = along[0][None], np.array([along[1]])
        changes = np.empty_like(fields)
        potential, wrinkled = self._assemble(
            displacement, pressure, stiffness, residual, data, fields, rates, changes
        )
        if self.clamp is not None:
            potential += self.clamp.add(displacement, residual, data if tangent else None)
        return State(
            potential, self.gather(residual), residual, wrinkled, data if tangent else None,
            None if along is None else self.gather(changes[0]),
        )  # fmt: skip

    def tangent_product(
        self, displacement: Floats, pressure: float, stiffness: Floats, fields: Floats
    ) -> Floats:
        """The tangent at a displacement (n, 3) mm times nodal fields (k, n, 3) mm: (k, N) N."""
        out = np.empty_like(fields)
        potential, _ = self._assemble(
            displacement, pressure, stiffness, np.empty_like(self.reference), NO_TANGENT, fields,
            np.zeros(len(fields)), out,
        )  # fmt: skip
        if not np.isfinite(potential):
            raise ArithmeticError("tangent asked for at a collapsed shape")
        return self.gather(out)

    def _assemble(
        self,
        displacement: Floats,
        pressure: float,
        stiffness: Floats,
        residual: Floats,
        data: Floats,
        fields: Floats,
        rates: Floats,
        changes: Floats,
    ) -> tuple[float, int]:
        """The kernel `assemble`, and what the clamp adds to the changes."""
        found: tuple[float, int] = assemble(
            self.reference + displacement, self.mesh.cells, self.surface.gradient, self.weight,
            self.law_parameters(stiffness), LAWS[self.law], self.relaxation, pressure,
            self.share, self.linear.scatter, self.times, residual, data, fields, rates, changes,
        )  # fmt: skip
        if self.clamp is not None and len(fields) > 0:
            changes[:, self.clamp.rim, :2] += self.clamp.changes(fields)
        return found

    def pressure_force(self, displacement: Floats) -> Floats:
        """-∂R/∂p: force of a unit pressure on the free displacements, (N,) mm²."""
        return self.gather(self._lift(displacement))

    def volume(self, displacement: Floats) -> float:
        """Volume V beneath a shape, mm³: homogeneous of third degree in x, so 3 V = x·∂V/∂x."""
        return float((self._lift(displacement) * (self.reference + displacement)).sum()) / 3.0

    def volume_change(self, displacement: Floats, field: Floats) -> float:
        """How that volume changes along a nodal field (n, 3): ∂V/∂x·field."""
        return float((self._lift(displacement) * field).sum())

    def _lift(self, displacement: Floats) -> Floats:
        """∂V/∂x at all nodes, (n, 3) mm²."""
        out = np.empty_like(self.reference)
        assemble_pressure(self.reference + displacement, self.mesh.cells, self.share, out)
        return out

    def stiffness_force(self, displacement: Floats, stiffness: Floats) -> Floats:
        """∂R/∂(D11, D22, D12, D33) at fixed displacement, (4, N) mm²."""
        law = LAWS[self.law]
        moduli_elsewhere = self.fabric.curve is not None or min(self.fabric.gain) < 0.0
        if law.by_stiffness is None or moduli_elsewhere:
            return self._stiffness_differences(displacement, stiffness)
        out = np.empty((4, *self.reference.shape))
        ok = assemble_sensitivity(
            self.reference + displacement, self.mesh.cells, self.surface.gradient, self.weight,
            self.law_parameters(stiffness), law, self.relaxation, out,
        )  # fmt: skip
        if not ok:
            raise ArithmeticError("sensitivity asked for at a collapsed shape")
        return self.gather(out)

    def _stiffness_differences(self, displacement: Floats, stiffness: Floats) -> Floats:
        """`stiffness_force` where the moduli enter the law in other ways, too."""
        steps = _DIFFERENCE * np.diag(np.maximum(stiffness, _DIFFERENCE * stiffness.max()))
        below, above = (
            np.array([self.law_parameters(stiffness + sign * step) for step in steps])
            for sign in (-1, 1)
        )
        return self.law_changes(displacement, below, above) / (2.0 * np.diag(steps)[:, None])

    def law_changes(self, displacement: Floats, before: Floats, after: Floats) -> Floats:
        """Changes of R with the law's parameters (k, 30), at fixed displacement: (k, N) N."""
        for q in (before, after):
            if q.shape != (len(before), len(PARAMETERS)):
                raise InputError(
                    f"parameters of the law: expected (k, {len(PARAMETERS)}), got {q.shape}"
                )
        out = np.empty((len(before), *self.reference.shape))
        ok = assemble_law_changes(
            self.reference + displacement, self.mesh.cells, self.surface.gradient, self.weight,
            before, after, LAWS[self.law], self.relaxation, out,
        )  # fmt: skip
        if not ok:
            raise ArithmeticError("sensitivity asked for at a collapsed shape")
        return self.gather(out)

    def reference_changes(
        self,
        displacement: Floats,
        pressure: float,
        stiffness: Floats,
        moves: Floats,
        tilts: Floats,
        gains: Floats,
    ) -> Floats:
        """Changes of R with the reference surface, at fixed displacement: (k, N) N.

        Parameters
        ----------
        moves : (k, n, 3) array, mm
            How positions change; with the rest zero, the tangent's product.
        tilts : (k, m, 4, 4, 2) array, 1/mm
            How the shape gradients change.
        gains : (k, m, 4) array
            How the weights change, over the weights.
        """
        out = np.empty_like(moves)
        ok = assemble_reference_changes(
            self.reference + displacement, self.mesh.cells, self.surface.gradient, self.weight,
            self.law_parameters(stiffness), LAWS[self.law], self.relaxation, pressure, self.share,
            moves, tilts, gains, out,
        )  # fmt: skip
        if not ok:
            raise ArithmeticError("sensitivity asked for at a collapsed shape")
        return self.gather(out)

    def weight_changes(self, displacement: Floats, stiffness: Floats, gains: Floats) -> Floats:
        """Changes of R with the weights, of which these are shares (k, m, 4): (k, N) N."""
        out = np.empty((len(gains), *self.reference.shape))
        ok = assemble_weight_changes(
            self.reference + displacement, self.mesh.cells, self.surface.gradient, self.weight,
            self.law_parameters(stiffness), LAWS[self.law], self.relaxation, gains, out,
        )  # fmt: skip
        if not ok:
            raise ArithmeticError("sensitivity asked for at a collapsed shape")
        return self.gather(out)

    def law_parameters(self, stiffness: Floats) -> tuple[float, ...]:
        """What the kernels call q, of this stiffness (4,) and the fabric.

        The last ones are kept: a path asks for the same over and over.
        """
        asked, last = stiffness.tobytes(), self._law_parameters
        if last is None or last[0] != asked:
            last = self._law_parameters = asked, self.fabric.law_parameters(stiffness)
        return last[1]

    def acoustic_margin(self, displacement: Floats, stiffness: Floats) -> float:
        """Least margin of ellipticity over the Gauss points, over D11 + D22; negative: lost.

        Infinite where no point needs a search; NaN where a cell has collapsed.
        """
        return self._margin(displacement, stiffness, enough=-np.inf)

    def is_elliptic(self, displacement: Floats, stiffness: Floats) -> bool:
        """Whether `acoustic_margin` is not negative, which the first point may tell where it is."""
        return self._margin(displacement, stiffness, enough=-ROUNDING) >= 0.0

    def _margin(self, displacement: Floats, stiffness: Floats, *, enough: float) -> float:
        modulus = float(stiffness[0] + stiffness[1])
        margin, _ = least_margin(
            self.reference + displacement, self.mesh.cells, self.surface.gradient,
            self.law_parameters(stiffness), LAWS[self.law], self.relaxation, enough * modulus,
        )  # fmt: skip
        relative = margin / modulus
        return 0.0 if abs(relative) <= ROUNDING else relative

    def factorise(self, state: State, shift: float = 0.0, *, spent: bool = False) -> Factor:
        """Factor of the state's tangent, overwritten if `spent`; NotPositiveDefiniteError."""
        assert state.tangent is not None
        return self.linear.factorise(state.tangent, shift, spent=spent)
