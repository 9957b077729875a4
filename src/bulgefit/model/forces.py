"""How do the forces on a shape change with the parameters, and how does the shape with them?

At fixed displacement R changes with the law, the surface, the weights, the clamp and the load;
balance is kept by ∂u/∂θ = -K⁻¹ ∂R/∂θ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.clamp import Clamp
from bulgefit.fem.equilibrium import Equilibrium
from bulgefit.fem.membrane import Membrane
from bulgefit.model.description import Description

__all__ = ["Change", "Forces"]

Floats = NDArray[np.float64]

#: mm: half of a difference in what moves the rim. Residuals are as exact as 1e-13 of some 100 N.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Change:
    """A parameter's description below and above its value, and the span between.

    Or `thickening`, ∂ ln(thickness)/∂(the parameter) (m, 4), where that is all that changes: the
    ends are the description itself then.
    """

    below: Description
    above: Description
    span: float
    thickening: Floats | None = None

    @property
    def rate(self) -> Floats:
        """∂(balanced pressure)/∂(the parameter), (frames,)."""
        return np.asarray((self.above.load.balanced - self.below.load.balanced) / self.span)

    def in_frames(self, frames: NDArray[np.int64]) -> Change:
        """The same in some of its frames alone (see `Description.in_frames`)."""
        ends = (self.below.in_frames(frames), self.above.in_frames(frames))
        return Change(*ends, self.span, self.thickening)

    @property
    def easing(self) -> Floats:
        """∂(what the clamp gives, mm per N/mm)/∂(the parameter), (frames,)."""

        def gives(end: Description) -> Floats:
            compliance = np.full(len(end.load.balanced), end.fabric.compliance or 0.0)
            return compliance if end.eased is None else compliance + end.eased

        return (gives(self.above) - gives(self.below)) / self.span

    @property
    def of_law(self) -> bool:
        """Whether nothing but the law's parameters and the load changes."""
        return self.thickening is None and self.below.lies_as(self.above)

    @property
    def mirrors(self) -> bool:
        """Whether the law couples no shear to stretch at either end: so shapes keep to mirrors."""
        return not any(any(end.fabric.coupling) for end in (self.below, self.above))


class Forces:
    """∂u/∂(parameters) at a balance: back-substitutions of ∂R/∂(parameters) at fixed displacement.

    What a parameter does to law, surface, weights and clamp is a difference of descriptions, made
    once; what those do to R is differentiated at each balance, for all parameters at once.
    """

    def __init__(
        self,
        membrane: Membrane,
        given: Description,
        changes: Mapping[str, Change],
        made: Callable[[Description, Membrane], Membrane],
    ) -> None:
        self._membrane, self._stiffness, self._changes = membrane, given.stiffness, changes
        self._ends = None if given.edge is None else given.edge[..., :2]
        self._eased = given.eased
        self._rim = membrane.mesh.rim
        self._place = {name: number for number, name in enumerate(changes)}
        self._law = [
            name
            for name, change in changes.items()
            if change.below.law_parameters != change.above.law_parameters
        ]
        self._before, self._after = (
            np.array([getattr(changes[name], side).law_parameters for name in self._law])
            for side in ("below", "above")
        )
        self._rates = {name: rate for name, c in changes.items() if (rate := c.rate).any()}
        self._moved, self._weighed = dict[str, _Moved](), dict[str, Floats]()
        self._pulled = list[str]()
        self._clamped = dict[str, _Eased]()
        for name, change in changes.items():
            if not change.of_law:
                self._compare(name, change, made)
        self._tilts = np.array([moved.tilt for moved in self._moved.values()])
        self._gains = np.array([moved.gain for moved in self._moved.values()])
        self._weights = np.array(list(self._weighed.values()))

    def _compare(
        self, name: str, change: Change, made: Callable[[Description, Membrane], Membrane]
    ) -> None:
        """What a parameter of shape, clamp or thickness changes of the membrane."""
        if change.thickening is not None:
            self._weighed[name] = change.thickening
            return
        ends = (change.below, change.above)
        below, above = (made(d, self._membrane) for d in ends)
        gain = (above.weight - below.weight) / (change.span * self._membrane.weight)
        if change.below.edge is not change.above.edge:
            self._pulled.append(name)
        if above.surface is not below.surface:
            tilt = (above.surface.gradient - below.surface.gradient) / change.span
            moves = (above.reference - below.reference) / change.span
            self._moved[name] = _Moved(moves, tilt, gain)
        elif gain.any():
            self._weighed[name] = gain
        if above.clamp is not None and below.clamp is not None:
            rate = change.easing
            if rate.any() or not np.array_equal(below.clamp.length, above.clamp.length):
                self._clamped[name] = _Eased(below.clamp, above.clamp, rate, change.span)

    def fields(self, balance: Equilibrium, frame: int, out: Floats) -> None:
        """∂u/∂(each parameter), into out (parameters, n, 3)."""
        columns, held = self.columns(balance.displacement, balance.pressure, frame)
        np.negative(columns, out=columns)
        out[:] = self._membrane.spread(np.ascontiguousarray(balance.factor.solve(columns.T).T))
        for name, edge in held.items():
            out[self._place[name]] += edge

    def columns(
        self, displacement: Floats, pressure: float, frame: int
    ) -> tuple[Floats, dict[str, Floats]]:
        """∂R/∂(each parameter) at a fixed displacement of what is not held, (parameters, N).

        And what the parameters move of the rim where it is held, (n, 3) each.
        """
        place, columns = self._place, np.zeros((len(self._place), self._membrane.linear.size))
        if self._law:
            found = self._membrane.law_changes(displacement, self._before, self._after)
            for name, column in zip(self._law, found, strict=True):
                columns[place[name]] += column / self._changes[name].span
        edges = {name: self._edge(name, frame) for name in self._pulled}
        # where the rim is held it goes along; springs are pulled at
        held = {name: np.where(self._membrane.fixed, edge, 0.0) for name, edge in edges.items()}
        held = {name: edge for name, edge in held.items() if edge.any()}
        if self._moved:
            moves = np.array([m.moves + held.get(n, 0.0) for n, m in self._moved.items()])
            columns[[place[name] for name in self._moved]] += self._membrane.reference_changes(
                displacement, pressure, self._stiffness, moves, self._tilts, self._gains
            )
        if alone := [name for name in held if name not in self._moved]:
            columns[[place[name] for name in alone]] += self._of_held(
                displacement, pressure, np.array([held[name] for name in alone])
            )
        if self._weighed:
            columns[[place[name] for name in self._weighed]] += self._membrane.weight_changes(
                displacement, self._stiffness, self._weights
            )
        clamp = self._clamp(frame)
        if clamp is not None:
            for name, eased in self._clamped.items():
                stiffer = eased.stiffer(clamp, frame)
                columns[place[name]] += self._by_clamp(stiffer, displacement, frame)
            for name, edge in edges.items():
                force = np.zeros_like(edge)
                force[self._rim, :2] = clamp.changes(edge)
                columns[place[name]] -= self._membrane.gather(force)
        if self._rates:
            by_pressure = -self._membrane.pressure_force(displacement)
            for name, rate in self._rates.items():
                columns[place[name]] += rate[frame] * by_pressure
        return columns, held

    def _of_held(self, displacement: Floats, pressure: float, fields: Floats) -> Floats:
        """∂R/∂(what moves the held rim by `fields`, (k, n, 3)), (k, N).

        Where a rim slides that is lifted, the load's skew part does not cancel. The tangent leaves
        it out; differences do not.
        """
        if self._membrane.clamp is None:
            return self._membrane.tangent_product(displacement, pressure, self._stiffness, fields)
        out = np.empty((len(fields), self._membrane.linear.size))
        for row, field in zip(out, fields, strict=True):
            step = _STEP / float(np.abs(field).max())
            low, high = (
                self._membrane.state(
                    displacement + way * field, pressure, self._stiffness, tangent=False
                ).residual
                for way in (-step, step)
            )
            row[:] = (high - low) / (2.0 * step)
        return out

    def _clamp(self, frame: int) -> Clamp | None:
        """The clamp as it gives in a frame."""
        clamp = self._membrane.clamp
        if clamp is None or self._eased is None:
            return clamp
        return clamp.at(clamp.compliance + float(self._eased[frame]))

    def _by_clamp(self, stiffer: Floats, displacement: Floats, frame: int) -> Floats:
        """Change of R with the stiffness (rim, 2, 2) of the rim's springs."""
        force = np.zeros_like(self._membrane.reference)
        stretch = displacement[self._rim, :2]
        if self._ends is not None:
            stretch = stretch - self._ends[frame]
        force[self._rim, :2] = np.einsum("nij,nj->ni", stiffer, stretch)
        return self._membrane.gather(force)

    def _edge(self, name: str, frame: int) -> Floats:
        """∂(displacement of the edge)/∂(a parameter) as a nodal field (n, 3)."""
        change = self._changes[name]
        below, above = change.below.edge, change.above.edge
        by = (0.0 if above is None else above[frame]) - (0.0 if below is None else below[frame])
        out = np.zeros_like(self._membrane.reference)
        out[self._rim] = by / change.span
        return out


@dataclass(frozen=True, eq=False)
class _Eased:
    """The clamp on either side of a parameter's value, and what it gives more, by its change.

    The springs' stiffness goes with one over the compliance, which is differentiated as it is: a
    difference would have to be small against a compliance that may be all but nothing.
    """

    below: Clamp
    above: Clamp
    rate: Floats
    span: float

    def stiffer(self, clamp: Clamp, frame: int) -> Floats:
        """∂(stiffness of the rim's springs)/∂(the parameter), (rim, 2, 2), in a frame."""
        below, above = (e.at(clamp.compliance).stiffness for e in (self.below, self.above))
        return np.asarray(clamp.by_compliance * self.rate[frame] + (above - below) / self.span)


@dataclass(frozen=True, eq=False)
class _Moved:
    """Rates of a parameter's change: of positions, shape gradients and weights.

    As `Membrane.reference_changes` takes them.
    """

    moves: Floats
    tilt: Floats
    gain: Floats
