"""Does displacement count from rest, and from the clamp's centre and plane?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.coverage import FIELD, coverage
from bulgefit.dic.rim import rim_of
from bulgefit.dic.suspicions.apex import rise_at_centre
from bulgefit.dic.suspicions.at_rest import AT_REST
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_offsets", "about_zero"]

Floats = NDArray[np.floating]

# An apex grows by more than this part where the pressure doubles; that of a membrane by a quarter.
_NO_GROWTH = 0.05
# Zero error of a pressure transducer, relative to its range (accuracy class 0.5).
_GAUGE = 0.005
# A centre that is off by this part of the radius puts heights at the rim off by 2 % of the rise
# (slope 2 w0/a), which is 6 % in stiffness (E t ~ w^-3).
_OFF_CENTRE = 0.01
# A mean displacement in plane, mm, and its part of the largest one, which symmetry forbids.
_OFFSET, _OFFSET_PART = 0.1, 0.1


def about_zero(test: BulgeTest) -> Iterator[Suspicion]:
    """What displacement and positions are counted from."""
    pressure, rise = rise_at_centre(test)
    if len(rise) > 1:
        yield from _about_first_frame(test, pressure, rise)
    yield from _about_centre(test)


def _about_first_frame(test: BulgeTest, pressure: Floats, rise: Floats) -> Iterator[Suspicion]:
    (low, high), (before, after) = pressure[[0, -1]], rise[[0, -1]]
    if high > 2 * low and abs(after - before) < _NO_GROWTH * abs(after):
        yield Suspicion(
            "no_growth",
            f"the apex stands at {before:.4g} mm at {low * 10:.3g} bar and at {after:.4g} mm at "
            f"{high * 10:.3g} bar: the displacement does not change with pressure",
            "give each frame its own displacement and pressure",
        )
        return
    if low < -_GAUGE * high and before > max(AT_REST, _NO_GROWTH * after):
        yield Suspicion(
            "dome_under_suction",
            f"at {low * 10:.3g} bar, less than outside, the apex stands at {before:.3g} mm: that "
            "pressure is wrong",
            "mend the sign or the zero of the pressures, or leave the frame out",
        )
        return
    # p/w of a clamped membrane grows with w, whether it starts flat (w^2), pretensioned or domed,
    # so that a lighter frame stands above the chord from rest to the heaviest one
    least = abs(after) * (low - _GAUGE * high) / high
    if abs(after) < test.radius and least - abs(before) > AT_REST:
        missing = abs(after) * float(np.cbrt(low / high))
        yield Suspicion(
            "zero_under_pressure",
            f"at {low * 10:.3g} bar the apex stands at {before:.2g} mm, where any membrane has "
            f"risen by {least:.2g} mm or more (one flat at rest by about {missing:.2g}): the "
            "displacement is counted from an image under pressure",
            "correlate all images with one at rest; if that frame was at rest, its gauge is off, "
            "which bulgefit diagnose tells as pressure_offset",
        )


def _about_centre(test: BulgeTest) -> Iterator[Suspicion]:
    rim = rim_of(test)
    if rim is None:
        return
    (x, y), (error_x, error_y) = rim.centre, rim.centre_error
    nearest = float(np.hypot(max(abs(x) - error_x, 0.0), max(abs(y) - error_y, 0.0)))
    if nearest > _OFF_CENTRE * test.radius:
        yield Suspicion(
            "off_centre",
            f"the heights fall to 0 on a circle about ({x:.1f}, {y:.1f}) mm, uncertain by "
            f"({error_x:.1f}, {error_y:.1f}): x = y = 0 is not the clamp's centre",
            "bulgefit convert IN OUT --centre rim, or --shift with what you measured",
        )


def about_offsets(test: BulgeTest) -> Iterator[Suspicion]:
    """Displacement at rest, and a motion of all points together."""
    frame = int(np.abs(test.pressure).argmin())
    rise = test.apex_displacement[frame]
    if abs(test.pressure[frame]) < 1e-3 * test.pressure.max() and abs(rise) > AT_REST:
        yield Suspicion(
            "displaced_at_rest",
            f"at rest (frame {frame}) the apex already stands at {rise:.2f} mm",
            "correlate with an image at rest, or leave the frame out; bulgefit diagnose frees "
            "reference_state",
        )
    yield from _about_motion(test)


def _about_motion(test: BulgeTest) -> Iterator[Suspicion]:
    frame = int(test.pressure.argmin())
    reference, displacement = test.frame(frame)
    known = np.isfinite(displacement).all(axis=1)
    in_plane = displacement[known, :2]
    # the mean over a lopsided field is not 0 even where all is well
    if len(in_plane) < 20 or coverage(test.on_circle(reference[known]), test.radius)[0] < FIELD:
        return
    offset = in_plane.mean(axis=0)
    if np.abs(offset).max() > max(_OFFSET, _OFFSET_PART * np.abs(in_plane - offset).max()):
        yield Suspicion(
            "in_plane_offset",
            f"at the lowest pressure (frame {frame}) the mean of dx, dy is "
            f"({offset[0]:.2f}, {offset[1]:.2f}) mm where symmetry gives 0: the camera or the "
            "clamp moved",
            "bulgefit align IN OUT --rigid takes off what the outer ring moved; bulgefit diagnose "
            "frees rigid_motion",
        )
