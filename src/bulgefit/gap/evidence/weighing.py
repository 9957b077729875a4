"""A diagnosis as a problem of evidence: specimens under effects and fields, by their noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.brink import Brink, LostStabilityError
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.heights import (
    height_rows,
    off_planes,
    plane_rows,
    shown,
    with_heights,
)
from bulgefit.gap.evidence.misfit import Misfit
from bulgefit.gap.evidence.problem import Columns, Group, Linearised
from bulgefit.gap.specimen import Specimen
from bulgefit.model.inflation import Shapes
from bulgefit.model.sight import Sight
from bulgefit.parallel.threads import side_by_side

__all__ = ["Weighing"]

Floats = NDArray[np.float64]

#: Rows that are whitened at a time: all of them may be half a gigabyte.
_AT_ONCE = 32


@dataclass(frozen=True, eq=False)
class Weighing:
    """The misfit of specimens by coordinates (`problem.Problem`).

    Parameters
    ----------
    data : sequence of Data
    coordinates : Coordinates
    offsets : sequence of Creases, optional
        By specimen: offsets of the points that its frames share. They are no coordinates: they are
        integrated out.
    tempered : float
        By which the specimens' noise was raised beyond what it is (`beside`).
    misfits : sequence of Misfit, optional
        By specimen: noise of its own that models are judged beside.
    excess : float
        By which errors count a misfit beyond the noise.
    """

    data: Sequence[Data]
    coordinates: Coordinates
    offsets: Sequence[Creases] | None = None
    tempered: float = 1.0
    misfits: Sequence[Misfit] | None = None
    excess: float = 1.0

    @property
    def groups(self) -> Sequence[Group]:
        """As the coordinates have them."""
        return self.coordinates.groups

    @property
    def noise(self) -> float:
        """Values that are compared, as many as are independent: what noise leaves of the misfit."""
        return sum(float(np.count_nonzero(shown(d))) / d.inflation for d in self.data)

    def afresh(self) -> Weighing:
        """The same, by specimens that remember nothing of earlier solves."""
        return replace(self, data=[d.afresh() for d in self.data])

    def within(self, coordinates: Coordinates) -> Weighing:
        """The same within other priors."""
        return replace(self, coordinates=coordinates)

    def smooth(self) -> Weighing:
        """The same without offsets of the points."""
        return replace(self, offsets=None)

    def over(
        self, data: Sequence[Data], offsets: Sequence[Creases] | None, excess: float
    ) -> Weighing:
        """The same over other data of the specimens, beside what models were judged beside here."""
        misfits = None
        if self.misfits is not None:
            pairs = zip(self.misfits, self.data, data, strict=True)
            misfits = [m.on(d, d.inflation / here.inflation) for m, here, d in pairs]
        return Weighing(data, self.coordinates, offsets, misfits=misfits, excess=excess)

    def beside(self, excess: float) -> Weighing:
        """The same beside a misfit that no model takes away: more noise by this factor."""
        data = [replace(d, inflation=excess * d.inflation) for d in self.data]
        return Weighing(data, self.coordinates, self.offsets, excess * self.tempered)

    def beside_misfit(self, here: Linearised) -> Weighing:
        """The same beside what a model misses by, of its own covariance (`misfit`).

        Parameters
        ----------
        here : Linearised
            At the model's optimum, by its coordinates.
        """
        width = np.array([self.coordinates.every[c].width for c in here.columns])
        known = here.hessian + np.diag(width**-2)
        inverse: Floats = np.asarray(np.linalg.inv(known), dtype=np.float64)
        misfits = []
        for index, (d, white) in enumerate(zip(self.data, here.rows, strict=True)):
            own = self.coordinates.of_specimen(here.columns, index)
            place = np.searchsorted(here.columns, own)
            rows = self.of_frames(index, white)
            misfits.append(Misfit.of(d, rows, inverse[np.ix_(place, place)]))
        return Weighing(self.data, self.coordinates, self.offsets, self.tempered, misfits)

    @property
    def loudest(self) -> float:
        """Variance of noise and misfit where that is largest, over the noise's; 1 without any."""
        return 1.0 + max((misfit.largest for misfit in self.misfits or ()), default=0.0)

    @property
    def cost(self) -> float:
        """Of the offsets, to be added to a score."""
        if self.offsets is None:
            return 0.0
        pairs = zip(self.data, self.offsets, strict=True)
        return sum(creases.cost(d.inflation) for d, creases in pairs)

    def linearise(self, x: Floats, columns: Columns, near: Any = None) -> Linearised:
        """See `Problem`; `near` are the shapes of a neighbouring point."""
        size = len(columns) + 1
        gram, shapes, rows = np.zeros((size, size)), list[Shapes](), list[Floats]()
        for index in range(len(self.data)):
            own = self.coordinates.of_specimen(columns, index)
            found, white, own_gram = self._of_one(x, own, index, near)
            shapes.append(found)
            place = np.append(np.searchsorted(columns, own), size - 1)
            gram[np.ix_(place, place)] += own_gram
            rows.append(white)
        return Linearised(
            np.array(x), columns, float(gram[-1, -1]), gram[:-1, -1], gram[:-1, :-1], shapes, rows
        )

    def along(self, x: Floats, column: int, near: Any = None) -> tuple[float, float]:
        """See `Problem`; of specimens that have the coordinate."""
        slope, curvature = 0.0, 0.0
        for index in range(len(self.data)):
            own = self.coordinates.of_specimen([column], index)
            if len(own):
                _, _, gram = self._of_one(x, own, index, near)
                slope, curvature = slope + gram[0, 1], curvature + gram[0, 0]
        return float(slope), float(curvature)

    def _of_one(
        self, x: Floats, columns: Sequence[int], index: int, near: Any
    ) -> tuple[Shapes, Floats, Floats]:
        """Shapes of a specimen, its rows (k + 1, values) and their products (k + 1, k + 1)."""
        d = self.data[index]
        found = self.seen(x, columns, index, None if near is None else near[index])
        white = self._whitened(index, self._rows(d, found, x, columns))
        gram = _gram(white, d.specimen.threads)
        if not np.isfinite(gram).all():
            raise _no_shape("the fabric has no derivatives", found.shapes.values)
        return found.shapes, white, gram

    @contextmanager
    def remembering(self) -> Iterator[None]:
        """See `Problem`."""
        with ExitStack() as stack:
            for d in self.data:
                stack.enter_context(d.specimen.inflation.remembering())
            yield

    def lighter(self, near: Sequence[Shapes]) -> list[Shapes]:
        """See `Problem`: shapes without derivatives, half a megabyte each."""
        return [replace(shapes, derivative={}) for shapes in near]

    def rounded(self, near: Sequence[Shapes]) -> list[Shapes]:
        """See `Problem`: derivatives in single precision, by hundreds of coordinates."""
        return [
            replace(s, derivative={n: d.astype(np.float32) for n, d in s.derivative.items()})
            for s in near
        ]

    def again(self, here: Linearised, x: Floats) -> Linearised:
        """See `Problem`; what `here` does not lead to is too far.

        A shorter step costs less than the path from rest does, which may end on another branch.
        """
        square, gradient, shapes = 0.0, np.zeros(len(here.columns)), list[Shapes]()
        for index, (d, near, rows) in enumerate(zip(self.data, here.near, here.rows, strict=True)):
            own = self.coordinates.of_specimen(here.columns, index)
            # with derivatives by the moduli a path is the one that derivatives are then taken of
            moduli = [c for c in own if not self.coordinates.every[c].key.effect]
            found = self.seen(x, moduli, index, near, strictly=True)
            (residual,) = self._whitened(index, self._rows(d, found, x, []))
            gradient[np.searchsorted(here.columns, own)] += rows[:-1] @ residual
            square += float(residual @ residual)
            # the next point is found from this one the sooner by derivatives from near it
            shapes.append(replace(found.shapes, derivative=near.derivative))
        return replace(here, x=np.array(x), square=square, gradient=gradient, near=shapes)

    def seen(
        self,
        x: Floats,
        columns: Sequence[int],
        index: int,
        near: Shapes | None = None,
        *,
        strictly: bool = False,
    ) -> Sight:
        """One specimen as the cameras see it, with derivatives by some of its coordinates at hand.

        From the shapes of a neighbouring point, and `strictly` from those: not by the path from
        rest where they do not lead there.

        Raises
        ------
        SolveError
            Nothing balances, or a step from `near` loses stability.
        """
        names = [self.coordinates.every[c].key.name for c in columns]
        specimen, values = self.data[index].specimen, self.coordinates.values(x, index)
        if not np.isfinite([*values.values()]).all():
            raise _no_shape("there are no such values", values)
        try:
            shapes = _balanced(specimen, values, names, near, strictly=strictly)
            found = specimen.sight(shapes, names)
        except InputError as error:
            # nobody gave these values: a linear step led to moduli that no fabric can have
            raise _no_shape(f"there is no such fabric ({error})", values) from error
        if near is not None and (lost := _lost(near, shapes)) is not None:
            raise self._lost_stability(index, lost, shapes)
        return found

    def _lost_stability(self, index: int, frame: int, found: Shapes) -> LostStabilityError:
        """Beyond it fields are as wild as the mesh allows: no step leads there."""
        specimen = self.data[index].specimen
        pressure, mode = float(specimen.recorded[frame]), specimen.lost_mode(found, frame)
        return LostStabilityError(
            "the fabric loses its stability",
            None if mode is None else Brink(index, frame, mode),
            pressure=pressure,
            reached=pressure,
            iteration=0,
            residual_norm=0.0,
            parameters=found.values,
        )

    def kept_from(self, brink: Brink, here: Linearised) -> Floats | None:
        """See `Problem`."""
        own = self.coordinates.of_specimen(here.columns, brink.specimen)
        chosen = [self.coordinates.every[c] for c in own]
        shapes = here.near[brink.specimen]
        names = [k.key.name for k in chosen if k.key.name in shapes.derivative]
        specimen = self.data[brink.specimen].specimen
        try:
            kept = specimen.kept_by(shapes, names, brink.frame, brink.mode)
        except ArithmeticError:  # as where shapes have no derivatives: a cell or a wrinkle gave way
            return None
        if kept.stiffness <= 0.0:
            return None
        row = np.zeros(len(here.columns))
        for place, c, k in zip(np.searchsorted(here.columns, own), own, chosen, strict=True):
            by_value = kept.rate.get(k.key.name, 0.0) / kept.stiffness
            row[place] = by_value * k.parameter.slope(k.value(here.x[c]))
        return row

    def _whitened(self, index: int, rows: Floats) -> Floats:
        """Rows (k, frames, points, 3) with products as noise, offsets, mesh and misfit leave them.

        And, where heights were measured, the plane that they are counted from; (k, values). Their
        products are those of the likelihood: each specimen's by its own noise.
        """
        d = self.data[index]

        def flat(rows: Floats) -> Floats:
            if self.offsets is not None:
                rows = self.offsets[index].whitened(rows, shown(d), d.inflation)
            return rows.reshape(len(rows), -1)

        own, nothing = flat(rows), np.zeros((1, d.used.shape[1]))
        mesh = None
        if d.mesh is not None:
            error = (np.where(d.used, d.mesh, 0.0) * d.weight)[None]
            mesh = flat(with_heights(d, error, nothing))
        if d.heights is not None:
            planes = flat(with_heights(d, np.zeros((3, *d.used.shape)), plane_rows(d)))
            own = off_planes(own, planes)
            mesh = None if mesh is None else off_planes(mesh, planes)
        own /= np.sqrt(d.inflation)
        if mesh is not None:
            own = _beside_mesh(own, mesh[0] / np.sqrt(d.inflation))
        if self.misfits is not None:
            frames = self.of_frames(index, own)
            for first in range(0, len(frames), _AT_ONCE):
                some = frames[first : first + _AT_ONCE]
                some[:] = self.misfits[index].whitened(some)
        return own

    def of_frames(self, index: int, rows: Floats) -> Floats:
        """Of a specimen's rows (k, values), those of its frames: a view (k, frames, points, 3)."""
        used = self.data[index].used
        return rows[:, : used.size].reshape(len(rows), *used.shape)

    def _rows(self, d: Data, found: Sight, x: Floats, columns: Sequence[int]) -> Floats:
        """Derivatives by coordinates and the residual, in noise units.

        (columns + 1, frames, points, 3), with a frame more for heights before inflation.
        """
        weight, chosen = d.weight, [self.coordinates.every[c] for c in columns]
        slopes = [k.parameter.slope(k.value(x[c])) for k, c in zip(chosen, columns, strict=True)]
        frames, *rest = weight.shape
        rows = np.zeros((len(columns) + 1, frames + (d.heights is not None), *rest))

        def fill(number: int) -> None:
            row = rows[number, :frames]
            found.add(row, chosen[number].key.name)
            row *= slopes[number] * weight

        side_by_side(fill, range(len(chosen)), d.specimen.threads)
        rows[-1, :frames] = d.residual(found)
        if d.heights is not None:
            heights = height_rows(d, found.shapes.values, [k.key.name for k in chosen])
            rows[:, -1, :, 2] = heights * np.append(slopes, 1.0)[:, None]
        return rows


def _gram(rows: Floats, threads: int) -> Floats:
    """Products of rows (k, values): of halves of the values, which two threads may work on."""
    half = rows.shape[1] // 2
    first, second = side_by_side(
        lambda part: part @ part.T, (rows[:, :half], rows[:, half:]), threads
    )
    return first + second


def _beside_mesh(rows: Floats, mesh: Floats) -> Floats:
    """Rows (k, values), changed, where what is left of the mesh's error is noise in a direction.

    It is known in its pattern m, (values,), and in its size to about itself. With noise of
    covariance C = 1 + m mᵀ, C⁻¹ = 1 - m mᵀ/(1 + mᵀm) (Sherman and Morrison, 1950), which is the
    square of 1 - m mᵀ (1 - (1 + mᵀm)^-1/2)/mᵀm.
    """
    size = float(mesh @ mesh)
    if size == 0.0:
        return rows
    share = (1.0 - 1.0 / np.sqrt(1.0 + size)) / size
    for row in rows:  # one by one: all at once would be as much memory again, twice
        row -= share * float(row @ mesh) * mesh
    return rows


def _balanced(
    specimen: Specimen,
    values: Mapping[str, float],
    names: Sequence[str],
    near: Shapes | None,
    *,
    strictly: bool = False,
) -> Shapes:
    """Shapes from a neighbour's; by the path from rest where those lead nowhere, or astray.

    Cloth that lies loosely moves far with little, and a long step may land on another branch. Where
    the neighbour is stable so is what it leads to, or nothing is: the path ends where it is not.
    """
    if near is None:
        return specimen.shapes(values, names)
    try:
        found = specimen.shapes(values, names, near)
        if strictly or _lost(near, found) is None:
            return found
    except SolveError:
        if strictly:
            raise
    return specimen.shapes(values, names, within=bool(near.stable.all()))


def _lost(before: Shapes, after: Shapes) -> int | None:
    """The first frame whose stability a step lost; a point looked at again is none."""
    lost = np.flatnonzero(before.stable & ~after.stable)
    return int(lost[0]) if len(lost) and before.values != after.values else None


def _no_shape(reason: str, values: Mapping[str, float]) -> SolveError:
    return SolveError(
        reason,
        pressure=0.0,
        reached=0.0,
        iteration=0,
        residual_norm=0.0,
        parameters=values,
    )
