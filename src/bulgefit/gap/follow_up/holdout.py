"""Does what was learnt from other specimens hold for one that was kept out?

What the specimens share (moduli, material effects) comes from the others. What is the specimen's
own (shape, clamp, load, camera, and offsets of its points where the others have them) is fitted on
every second of its frames, and the gap is judged on the frames between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.keys import columns_of, has_offsets, is_shared, offsets_of_points, start_of
from bulgefit.gap.prepare import Prepared, drop_outliers, renew
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual.measure import Gap, gap_of, noise_gap
from bulgefit.gap.scatter import of_the_cloth

__all__ = ["HeldOutTest", "judge_held_out"]


@dataclass(frozen=True, eq=False)
class HeldOutTest:
    """How a specimen that was kept out is met.

    Attributes
    ----------
    test : str
    fitted_bar, judged_bar : list of float, bar
        Pressures of the frames that its own parameters were fitted on, and of those judged.
    baseline, explained, noise_floor : Gap
        On the judged frames: with the others' moduli alone; with all that was found; noise alone.
    parameters : dict of name to {"value", "stderr"}
        The specimen's own.
    """

    test: str
    fitted_bar: list[float]
    judged_bar: list[float]
    baseline: Gap
    explained: Gap
    noise_floor: Gap
    parameters: dict[str, dict[str, float]]

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return dict(vars(self))


def judge_held_out(prepared: Prepared, found: Explanation, weight: float) -> HeldOutTest:
    """Meet a kept-out specimen with what was found on the others.

    Parameters
    ----------
    prepared : Prepared
    found : Explanation
        Of the others.
    weight : float
        Of dz in e_w.

    Raises
    ------
    SolveError
        The others' material does not carry this test's pressures.
    """
    recorded = prepared.data.specimen.recorded
    every_second = np.argsort(np.argsort(recorded, kind="stable")) % 2 == 0

    alone = _fitted(prepared, {m: found.baseline.values[m] for m in MODULI}, (), every_second)
    drop_outliers(prepared, alone.predictions[0].displacement)
    shared, own = _divided(found.final)
    full = _fitted(prepared, shared, own, every_second)
    errors = full.standard_errors() if full.columns else {}

    judged = _frames_of(prepared.data, ~every_second)
    return HeldOutTest(
        prepared.data.specimen.test.name,
        (10.0 * recorded[every_second]).tolist(),
        (10.0 * recorded[~every_second]).tolist(),
        _gap(judged, alone, weight),
        _gap(judged, full, weight),
        noise_gap([judged], weight),
        {
            key.name: {"value": float(full.values[key]), "stderr": float(errors[key])}
            for key in full.columns
        },
    )


def _frames_of(data: Data, frames: NDArray[np.bool_]) -> Data:
    """The same with some frames alone in use."""
    used = data.used & frames[:, None, None]
    return replace(data, used=used)


def _divided(final: Regression) -> tuple[dict[Key, float], tuple[Key, ...]]:
    """What the specimens share, by value, and what is each one's own, as this one has it.

    Of several, what no one owns is the cloth's or the rig's; the factors of those are about its
    mean.
    """
    several = len(final.predictions) > 1

    def common(key: Key) -> bool:
        return is_shared(key) or (several and key.specimen is None)

    shared = {k: value for k, value in of_the_cloth(final.values).items() if common(k)}
    own = dict.fromkeys(k._replace(specimen=None) for k in final.columns if not common(k))
    offsets = offsets_of_points(1) if has_offsets(final.keys, 0) else ()
    return shared, (*own, *offsets)


def _fitted(
    prepared: Prepared, fixed: dict[Key, float], own: Sequence[Key], frames: NDArray[np.bool_]
) -> Regression:
    """The specimen's own parameters fitted to some frames, and again with the mesh's error off.

    Noise is no part of the fit: it comes from all frames.
    """
    prepared.data.specimen.correction = None
    start = {**fixed, **{key: start_of(key, [prepared.data]) for key in columns_of(own)}}
    fit = regress([_frames_of(prepared.data, frames)], own, start)
    renew(prepared, fit, 0)
    return regress(
        [_frames_of(prepared.data, frames)], own, fit.values, [p.shapes for p in fit.predictions]
    )


def _gap(data: Data, fit: Regression, weight: float) -> Gap:
    (prediction,) = fit.predictions
    residual = np.where(data.used, data.specimen.measured - prediction.displacement, np.nan)
    return gap_of([residual], [data.sigma], weight)
