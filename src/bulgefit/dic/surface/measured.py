"""What does a bulge test say of the fabric without any model?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import dataframe, labelled
from bulgefit.dic.given import GivenTest, given_test
from bulgefit.dic.noise import Noise, noise_of
from bulgefit.dic.rim_motion import rim_motions
from bulgefit.dic.surface.choose import best_window
from bulgefit.dic.surface.local import Surface, surface_of
from bulgefit.dic.surface.rings import Rings, rings_of
from bulgefit.dic.surface.tables import Table, tables_of, values_of
from bulgefit.dic.surface.windows import fewest_points
from bulgefit.errors import InputError
from bulgefit.shown import Drawn

__all__ = ["Measured", "chosen_window", "measure", "noise_in_windows"]

Floats = NDArray[np.float64]

#: Version of the layout of the JSON.
FORMAT = 1

#: Distance of places and rings over the window's radius: neighbours share most of their points.
_APART = 0.25
#: Half a window stays between a place and the edge of what was measured.
_EDGE = 0.5


@dataclass(frozen=True, eq=False)
class Measured(Drawn):
    """Strain, curvature, tension and stress as measured, with their noise.

    Attributes
    ----------
    name : str
    pressure : (frames,) array, MPa
    thickness : float, mm
    window : float, mm
        Radius of the windows over which the measured points are averaged.
    noise : Noise or None
        Of the displacements; None where the test does not tell, and the errors are then NaN.
        Where it is correlated, errors are upper bounds.
    apex : Surface
        Of one place, the clamp's centre.
    surface : Surface
        At places a quarter of a window apart, or those that were asked for.
    rings : Rings
        A quarter of a window apart, from half a window outwards.
    rim_rotation, rim_shift : (frames, 3) arrays, rad, mm, or None
        Rigid motion of the rim (`bulgefit.dic.rim_motion`); None where points are too few to tell.
    """

    name: str
    pressure: Floats
    thickness: float
    window: float
    noise: Noise | None
    apex: Surface
    surface: Surface
    rings: Rings
    rim_rotation: Floats | None
    rim_shift: Floats | None

    def tables(self) -> dict[str, Table]:
        """Columns of the tables apex, rings, fields and rim, such as strain_xx_noise_1."""
        return tables_of(self)

    def __repr__(self) -> str:
        return (
            f"Measured({self.name!r}: {len(self.pressure)} frames, windows of radius "
            f"{self.window:.3g} mm, {len(self.surface.points)} places, {len(self.rings.radius)} "
            "rings)"
        )

    def to_dataframe(self, table: str = "apex") -> Any:
        """One of the `tables`; needs `bulgefit[pandas]`."""
        found = self.tables()
        if table not in found:
            raise InputError(f"table {table!r} is unknown; choose from {', '.join(found)}")
        return dataframe(found[table])

    def to_xarray(self, field: str = "stress_MPa") -> Any:
        """A column of the table fields by frame and place; needs `bulgefit[xarray]`."""
        table = self.tables()["fields"]
        units = values_of(table)
        if field not in units:
            raise InputError(f"field {field!r} is unknown; choose from {', '.join(units)}")
        frames = len(self.pressure)
        return labelled(
            table[field].reshape(frames, -1),
            ("frame", "place"),
            {
                "frame": np.arange(frames),
                "pressure_bar": ("frame", 10.0 * self.pressure),
                **{f"{a}_mm": ("place", self.surface.points[:, i]) for i, a in enumerate("xy")},
            },
            name=field,
            unit=units[field],
        )

    def to_dict(self) -> dict[str, Any]:
        """Apex, rings and rim as JSON types, columns as in `tables`; fields stand there alone."""
        noise = self.noise
        known = None
        if noise is not None:
            known = {
                "sigma_mm": noise.sigma.tolist(),
                "effective_points_per_point": 1.0 / noise.inflation,
                "source": noise.source,
            }
        return {
            "format": FORMAT,
            "name": self.name,
            "thickness_mm": self.thickness,
            "window_mm": self.window,
            "noise": known,
            **{
                name: {
                    # what was not measured is null: JSON has no NaN
                    column: [one if math.isfinite(one) else None for one in values.tolist()]
                    for column, values in table.items()
                }
                for name, table in self.tables().items()
                if name != "fields"
            },
        }


def measure(
    test: GivenTest, *, window: float | None = None, points: ArrayLike | None = None
) -> Measured:
    """Strain, curvature, tension and stress of a test by geometry and equilibrium alone.

    Parameters
    ----------
    test : BulgeTest or path
    window : float, mm, optional
        Radius of the windows; by default the one with the smallest expected error of
        strain and curvature, of noise and of what the window smooths away (`surface.choose`).
    points : (c, 2) array_like, mm, optional
        Places before inflation at which the fields are told; by default all over the measured
        part, a quarter of a window apart.

    Raises
    ------
    InputError
        The window or the places cannot be, the points are too few, or the test does not tell its
        noise and no window was given.
    """
    test = given_test(test)
    noise = noise_of(test)
    window = chosen_window(test, noise, window)
    sigma = np.full(3, np.nan) if noise is None else noise_in_windows(noise)
    if not _can_hold_enough(test, window):
        raise _too_narrow(test, window)  # before a grid of a great many places
    places = _places(test, window) if points is None else _given(points, test)
    if _most_points(test, places, window) < fewest_points():
        raise _too_narrow(test, window)  # before the fields of a great many narrow windows
    apex = surface_of(test, np.zeros((1, 2)), window, sigma)
    surface = surface_of(test, places, window, sigma)
    if not np.isfinite(surface.strain).any():
        raise _too_narrow(test, window)
    rotation, shift = _rim(test)
    return Measured(
        name=test.name,
        pressure=np.asarray(test.pressure, dtype=np.float64),
        thickness=test.thickness,
        window=window,
        noise=noise,
        apex=apex,
        surface=surface,
        rings=rings_of(test, _radii(test, window), window, sigma),
        rim_rotation=rotation,
        rim_shift=shift,
    )


def chosen_window(test: BulgeTest, noise: Noise | None, window: float | None) -> float:
    """The window (mm) that is asked for, or the best one; InputError where there is none."""
    where = test.source or test.name
    if window is None:
        if noise is None:
            raise InputError(
                f"{where}: has too few points to tell its noise, from which the window would "
                "follow; give a window in mm"
            )
        return best_window(test, noise_in_windows(noise))
    if not isinstance(window, (int, float, np.number)):
        raise InputError(f"{where}: give the window as a number in mm, not {window!r}")
    if not 0.0 < window <= test.radius:
        raise InputError(
            f"{where}: a window of {window:g} mm cannot be; give a radius above 0 and up to the "
            f"clamp's {test.radius:g} mm"
        )
    return float(window)


def noise_in_windows(noise: Noise) -> Floats:
    """Of independent points with which a mean is as unsure as with the test's noise, (3,) mm.

    Where the noise of neighbours goes together, that is an upper bound: slopes and curvature hear
    less of what is even over the window than a mean does, by a factor of up to three where the
    correlation is a quarter of the window.
    """
    return np.asarray(noise.sigma * np.sqrt(noise.inflation))


def _rim(test: BulgeTest) -> tuple[Floats | None, Floats | None]:
    try:
        rotation, shift = rim_motions(test)
    except InputError:  # too few points
        return None, None
    return np.asarray(rotation, dtype=np.float64), np.asarray(shift, dtype=np.float64)


def _given(points: ArrayLike, test: BulgeTest) -> Floats:
    try:
        places = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        places = np.empty(0)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise InputError("points: give an array of (x, y) in mm, one row a place")
    if (np.hypot(*test.on_circle(places).T) > test.radius).any():
        a, b = test.semi_axes
        clamp = f"semi-axes of {a:g} and {b:g} mm" if test.ellipticity else f"{a:g} mm"
        raise InputError(f"points: some lie outside the clamp, beyond {clamp} from its centre")
    return places


def _measured_points(test: BulgeTest) -> Floats:
    """In the plane, (n, 2) mm: those that some frame saw."""
    seen = [block.reference[block.measured.any(axis=0), :2] for block in test.blocks]
    return np.concatenate(seen).astype(np.float64)


def _can_hold_enough(test: BulgeTest, window: float) -> bool:
    """Whether a window (mm), wherever it lies, may have the points that it takes.

    All points of a window lie within its diameter of each of them.
    """
    from scipy.spatial import KDTree

    count = fewest_points()
    for block in test.blocks:
        points = block.reference[block.measured.any(axis=0), :2]
        if len(points) >= count:
            farthest = KDTree(points).query(points, k=[count])[0]
            if farthest.min() <= 2.0 * window:
                return True
    return False


def _most_points(test: BulgeTest, places: Floats, window: float) -> int:
    """Points of the fullest window (mm) round places (c, 2) mm."""
    from scipy.spatial import KDTree

    seen = [block.reference[block.measured.any(axis=0), :2] for block in test.blocks]
    counts = [KDTree(p).query_ball_point(places, window, return_length=True) for p in seen]
    return int(np.max(counts, initial=0))


def _too_narrow(test: BulgeTest, window: float) -> InputError:
    if not any(np.isfinite(block.displacement).all(axis=2).any() for block in test.blocks):
        return InputError(
            f"{test.source or test.name}: no point has dx, dy and dz in one frame, which strain "
            "and curvature take"
        )
    return InputError(
        f"{test.source or test.name}: no window of {window:g} mm has the {fewest_points()} "
        "points that it takes; give a wider one"
    )


def _places(test: BulgeTest, window: float) -> Floats:
    """A square grid over the measured points' convex hull, off its edge."""
    points = _measured_points(test)
    count = int(test.semi_axes.max() / (_APART * window))
    ticks = _APART * window * np.arange(-count, count + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[_inside(grid, points, _EDGE * window)]


def _inside(places: Floats, points: Floats, edge: float) -> NDArray[np.bool_]:
    """Whether places lie within the convex hull of the points, at least `edge` from its sides."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        sides = ConvexHull(points).equations
    except (QhullError, ValueError):  # points in a line, or next to none
        return np.zeros(len(places), dtype=bool)
    return np.asarray((places @ sides[:, :2].T + sides[:, 2] <= -edge).all(axis=1))


def _radii(test: BulgeTest, window: float) -> Floats:
    """From half a window outwards, as far as whole rings were measured."""
    radii = 0.5 * window + _APART * window * np.arange(int(test.radius / (_APART * window)))
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = _measured_points(test)
    whole = [bool(_inside(r * circle, points, _EDGE * window).all()) for r in radii]
    return np.asarray(radii[whole], dtype=np.float64)
