"""Does what was learnt from other specimens hold for one that was kept out?

What the specimens share (moduli, material effects) comes from the others, and is known. What is the
specimen's own (how far it scatters about its cloth, shape, clamp, load, camera, offsets of its
points) is looked for on every second of its frames as a diagnosis looks for it: everything at once
under priors, and what the evidence lets go is taken out. The gap is judged on the frames between.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect
from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import effect_named
from bulgefit.gap.course import most_probable
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.coordinates import Coordinates, with_fields
from bulgefit.gap.evidence.outcome import posterior, regression_of
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.keys import is_shared
from bulgefit.gap.pace import Pace
from bulgefit.gap.prepare import Prepared, correct_discretisation, drop_outliers, renew_noise
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.measure import Gap, gap_of, noise_gap
from bulgefit.gap.scatter import of_the_cloth

__all__ = ["HeldOutTest", "judge_held_out"]

Floats = NDArray[np.float64]


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


def judge_held_out(
    prepared: Prepared,
    found: Explanation,
    effects: Sequence[Effect],
    weight: float,
    say: Callable[[str], None] = lambda _: None,
    *,
    same_rig: bool = False,
) -> HeldOutTest:
    """Meet a kept-out specimen with what was found on the others.

    Parameters
    ----------
    prepared : Prepared
    found : Explanation
        Of the others.
    effects : sequence of Effect
        Of the catalogue, of which the test has what they need.
    weight : float
        Of dz in e_w.
    say : callable
        Told what is tried.
    same_rig : bool
        What belongs to a rig is known from the others, too.

    Raises
    ------
    SolveError
        The others' material does not carry this test's pressures.
    """
    data = prepared.data
    recorded = data.specimen.recorded
    # from the highest down: what effects do over pressure is told by its share of that
    fitted = np.argsort(np.argsort(-recorded, kind="stable")) % 2 == 0
    alone = _predicted(prepared, {m.name: found.baseline.values[m] for m in MODULI})
    renew_noise(prepared, alone)
    drop_outliers(prepared, alone)

    cloth = _cloth_of(found.final, found.level.value, same_rig=same_rig)
    own = _of_its_own(prepared, cloth, effects, np.flatnonzero(fitted), say, same_rig=same_rig)
    values = {key.name: value for key, value in own.values.items()}
    full = _predicted(prepared, {**cloth, **values})
    renew_noise(prepared, full)
    (offset,) = own.offsets
    if offset is not None:
        full = full + offset
    errors = own.standard_errors() if own.columns else {}

    judged = replace(data, used=data.used & ~fitted[:, None, None])
    return HeldOutTest(
        data.specimen.test.name,
        (10.0 * recorded[fitted]).tolist(),
        (10.0 * recorded[~fitted]).tolist(),
        _gap(judged, alone, weight),
        _gap(judged, full, weight),
        noise_gap([judged], weight),
        {
            key.name: {"value": float(own.values[key]), "stderr": float(errors[key])}
            for key in own.columns
        },
    )


def _cloth_of(final: Regression, level: float, *, same_rig: bool) -> dict[str, float]:
    """What a further specimen shares with these, by name.

    Of several, what no one owns is the cloth's or the rig's; the moduli are the mean specimen's.
    Where the stiffness of one varies from place to place, they are those of most places: times the
    `level` of that.
    """
    several = len(final.predictions) > 1

    def common(key: Key) -> bool:
        of_rig = same_rig and bool(key.effect) and effect_named(key.effect).of_rig
        return is_shared(key) or of_rig or (several and key.specimen is None)

    return {
        key.name: value * (level if key in MODULI else 1.0)
        for key, value in of_the_cloth(final.values).items()
        if common(key)
    }


def _of_its_own(
    prepared: Prepared,
    cloth: Mapping[str, float],
    effects: Sequence[Effect],
    frames: NDArray[np.intp],
    say: Callable[[str], None],
    *,
    same_rig: bool,
) -> Regression:
    """What a specimen of a known cloth has of its own, by some of its frames."""
    some = replace(prepared, data=prepared.data.of_frames(frames))
    specimen = some.data.specimen
    usable = with_fields(effects, [specimen.test], several=True)
    own = [e for e in usable if not (e.shared or (same_rig and e.of_rig))]
    coordinates = Coordinates.of(own, [specimen.nulls()], known=cloth)
    null = np.concatenate([g.null for g in coordinates.groups])
    best = most_probable([some], coordinates, null, null, say, Pace())
    return regression_of(best.weighing, best.fit, posterior(best.weighing, best.fit))


def _predicted(prepared: Prepared, values: Mapping[str, float]) -> Floats:
    """Displacements (frames, points, 3) mm, with the mesh's error off."""
    specimen = prepared.data.specimen
    shapes = specimen.shapes(values)
    correct_discretisation(prepared, shapes)
    return specimen.observe(shapes).displacement


def _gap(data: Data, modelled: Floats, weight: float) -> Gap:
    residual = np.where(data.used, data.specimen.measured - modelled, np.nan)
    return gap_of([residual], [data.sigma], weight)
