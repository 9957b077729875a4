"""Which surface do measured points make, and which fields lie on it?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.noise import noise_of
from bulgefit.dic.surface.local import Surface, surface_of
from bulgefit.dic.surface.measured import chosen_window
from bulgefit.errors import InputError
from bulgefit.report._figure import check_prediction, point_spacing

__all__ = ["FIELDS", "RESIDUALS", "Cloud", "is_signed"]

Floats = NDArray[np.float64]

#: What can be shown of a test, with its unit.
FIELDS = {
    "dx": "mm",
    "dy": "mm",
    "dz": "mm",
    "strain_xx": "1",
    "strain_yy": "1",
    "strain_xy": "1",
    "curvature_xx": "1/mm",
    "curvature_yy": "1/mm",
    "curvature_xy": "1/mm",
    "tension": "N/mm",
    "stress": "MPa",
}
#: What can be shown of a test beside a model, measured minus modelled.
RESIDUALS = {f"residual_{name}": unit for name, unit in FIELDS.items()}

#: Triangles with a side longer than this many point spacings span a hole: on a grid with a point
#: lost the longest side of those that close it is 2 spacings, of three points in line 4.
_LONGEST = 3.0
#: Part of a surface's points that are corners of triangles, at least; of profiles few are.
_LEAST_COVERED = 0.5


def is_signed(name: str) -> bool:
    """Whether a field is about zero by its nature."""
    return name in ("dx", "dy") or name.endswith("_xy") or name.startswith("residual")


@dataclass(frozen=True, eq=False)
class Cloud:
    """A test, and a model's prediction of it where one is given, as surfaces with fields.

    Parameters
    ----------
    test : BulgeTest
    prediction : tuple of (k, n, 3) arrays, mm, or None
        Modelled displacements, one array for every block.
    window : float, mm, or None
        Of strain, curvature, tension and stress; None: chosen as `measure` does.

    Raises
    ------
    InputError
        The prediction does not match the test.
    """

    test: BulgeTest
    prediction: tuple[NDArray[np.floating], ...] | None = None
    window: float | None = None

    def __post_init__(self) -> None:
        if self.prediction is not None:
            check_prediction(self.test, self.prediction)

    def names(self) -> list[str]:
        """Fields that there are."""
        return [*FIELDS, *(RESIDUALS if self.prediction is not None else ())]

    def check_field(self, name: str) -> str:
        """The unit of a field; InputError where there is none of this name."""
        if name in RESIDUALS and self.prediction is None:
            raise InputError(f"field {name}: takes a model; give a material")
        if name not in {**FIELDS, **RESIDUALS}:
            raise InputError(f"field {name!r} is unknown; choose from {', '.join(self.names())}")
        return {**FIELDS, **RESIDUALS}[name]

    def part(self, frame: int) -> tuple[Floats, Floats, Floats | None]:
        """Reference, displacement and prediction (n, 3) mm of the points wholly measured."""
        for index, block in enumerate(self.test.blocks):
            row = np.flatnonzero(block.frames == frame)
            if len(row):
                moved = np.asarray(block.displacement[row[0]], dtype=np.float64)
                seen = np.isfinite(moved).all(axis=1)
                model = None
                if self.prediction is not None:
                    model = np.asarray(self.prediction[index][row[0]][seen], dtype=np.float64)
                return np.asarray(block.reference[seen], np.float64), moved[seen], model
        return np.empty((0, 3)), np.empty((0, 3)), None

    def triangles(self, frame: int) -> NDArray[np.intp]:
        """Delaunay triangles (m, 3) of a frame's points in the plane, less those over holes.

        Raises
        ------
        InputError
            The points make no surface.
        """
        from scipy.spatial import Delaunay, QhullError

        plane = self.part(frame)[0][:, :2]
        if not len(plane):
            raise InputError(
                f"{self.test.name}: frame {frame} has no point at which dx, dy and dz were "
                "measured; choose another frame"
            )
        try:
            found = Delaunay(plane).simplices
        except (QhullError, ValueError):
            raise self._no_surface(frame, len(plane)) from None
        sides = np.linalg.norm(plane[found] - plane[np.roll(found, 1, axis=1)], axis=2)
        near = np.asarray(found[sides.max(axis=1) <= _LONGEST * point_spacing(plane)])
        if len(np.unique(near)) < _LEAST_COVERED * len(plane):
            raise self._no_surface(frame, len(plane))
        return near

    def _no_surface(self, frame: int, count: int) -> InputError:
        return InputError(
            f"{self.test.name}: frame {frame} has {count} wholly measured points, which make no "
            "surface: single ones, or profiles; bulgefit fit --plots draws profiles"
        )

    def value(self, name: str, frame: int, *, modelled: bool = False) -> Floats:
        """A field (n,) at the points of a frame, of the test or of the model."""
        self.check_field(name)
        if name in RESIDUALS:
            plain = name.removeprefix("residual_")
            return self.value(plain, frame) - self.value(plain, frame, modelled=True)
        _, moved, model = self.part(frame)
        if name in ("dx", "dy", "dz"):
            of = model if modelled else moved
            assert of is not None
            return of[:, ("dx", "dy", "dz").index(name)]
        surface = self._surface(frame, modelled=modelled)
        kind, _, axes = name.partition("_")
        values = getattr(surface, kind)[0]
        return np.asarray(values[:, ("xx", "yy", "xy").index(axes)] if axes else values)

    @cached_property
    def chosen(self) -> float:
        """Radius of the windows, mm."""
        return chosen_window(self.test, noise_of(self.test), self.window)

    @cached_property
    def _known(self) -> dict[tuple[int, bool], Surface]:
        return {}

    def _surface(self, frame: int, *, modelled: bool) -> Surface:
        """Local values of a frame; those of the last one are kept."""
        if (frame, modelled) not in self._known:
            if len(self._known) > 1:
                self._known.clear()
            self._known[frame, modelled] = self._measured(frame, modelled=modelled)
        return self._known[frame, modelled]

    def _measured(self, frame: int, *, modelled: bool) -> Surface:
        reference, moved, model = self.part(frame)
        of = model if modelled else moved
        assert of is not None
        # not checked again: a frame at rest makes no test of its own
        block = Block(reference, np.zeros(1, dtype=np.intp), of[None])
        alone = replace(self.test, blocks=(block,), pressure=self.test.pressure[[frame]], time=None)
        return surface_of(alone, reference[:, :2], self.chosen, np.full(3, np.nan))
