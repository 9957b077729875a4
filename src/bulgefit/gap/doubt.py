"""Do the effects found explain the gap, or do they only come near what something else does?

A catalogue effect is modelled to about 1 % of what it does. Effects that stand in for something
else can come down to the noise too, but they leave more of the gap's own pattern, or need further
effects to remove it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from bulgefit.gap.data import Data
from bulgefit.gap.keys import at_edge, has_field, is_field
from bulgefit.gap.normal import shown
from bulgefit.gap.regress import Regression
from bulgefit.gap.search import Groups, Search
from bulgefit.gap.structure import Structure

__all__ = ["Doubt", "beyond_the_edge", "doubt", "hardly_flattened", "leaves_a_trace"]

#: Why effects are not named: structure is left, they are too many, they leave a trace of what they
#: imitate, one of them, or a flexible one, only completes the others, or a parameter would leave
#: what is plausible; "" where they are.
Doubt = Literal["", "structure", "many", "trace", "completion", "edge"]

#: Effects that may explain a gap together. With more, any gap can be imitated to the noise: what
#: they stand in for is then unknown.
MOST_NAMED = 3
#: Of what effects take off the mean square, their smooth, persistent remainder may be this share
#: beyond chance. On made tests true effects left up to 0.0003 of it, mostly none, three that stood
#: in for an offset of pressure 0.0007, two to four that stood in for a bent image 0.0019 to 0.0041,
#: whatever its size, a reference state that stood in for smoothing 0.0019 to 0.010. Offsets of all
#: points that did so left 0.0002 to 0.0019, true ones nothing beyond chance: they are granted none.
LEFT_BEHIND = 4e-4
#: Parameters from which on an effect is flexible: it can come near what something else does.
MANY = 9
#: Of the gap, a flexible effect and those beside it must each explain this share: a smaller one may
#: be no more than what the others miss of something else, to which flexible effects come within a
#: tenth in amplitude. On made tests true companions explained 0.0104 and more, but for two with
#: 0.0033 and 0.0055, those of a reference state that stood in for another effect up to 0.0041, and
#: one of 0.0078 that leaves a trace; true flexible effects 0.027 and more, those that completed
#: what stood in for another effect up to 0.0003.
LEAST_COMPANION = 0.01

#: What letting parameters leave their plausible ranges would take off the sum of squares, in
#: noise units, correlation allowed for; with more, something else is imitated. (Of one parameter
#: it is the square of how many standard errors beyond the edge the data see it.)
BEYOND_THE_EDGE = 25.0
#: Share of an offset of every point that pressure may leave unflattened. On made tests true creases
#: kept up to 0.11, offsets that stood in for a struck window 0.22 to 0.28.
STILL_CREASED = 0.15


def doubt(
    search: Search,
    baseline: Regression,
    final: Regression,
    groups: Groups,
    without: Mapping[str, Regression],
    remainder: Structure,
) -> Doubt:
    """Why the effects of a final model are not named, if they are not.

    Parameters
    ----------
    search : Search
    baseline, final : Regression
    groups : dict of effect id to its freed keys
    without : mapping of effect id to Regression
        The rest of the final model, refitted.
    remainder : Structure
        Of the final model's residual.
    """
    if remainder.significant:
        return "structure"
    if len(groups) > MOST_NAMED:
        return "many"
    if groups and leaves_a_trace(search.data, baseline, final, remainder):
        return "trace"
    least = LEAST_COMPANION * (baseline.held_out() - final.floor)
    flexible = any(search.size(keys) >= MANY for keys in groups.values())
    gains = [without[name].held_out() - final.held_out() for name in groups]
    if flexible and min(gains) < least:
        return "completion"
    if beyond_the_edge(final) > BEYOND_THE_EDGE or hardly_flattened(search.data, final):
        return "edge"
    return ""


def beyond_the_edge(fit: Regression) -> float:
    """What parameters at the edge of plausibility would bring if they could leave it.

    Off the sum of squares in noise units, correlation allowed for; by one linear step.
    """
    inside = [i for i, key in enumerate(fit.columns) if not at_edge(key, fit.values[key])]
    whole = fit.normal.whole
    within = whole.of(inside)
    return (within.at(within.step()) - whole.at(whole.step())) / fit.inflation


def hardly_flattened(data: Sequence[Data], fit: Regression) -> bool:
    """Whether more than `STILL_CREASED` of offsets of points outlasts a test's highest pressure.

    That pressure flattens them is all that ties them to creases of the reference image: what goes
    on shrinking up to high pressures is something else.
    """
    return any(
        has_field(fit.keys, index) and 1.0 - shown(d, p).max() > STILL_CREASED
        for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True))
    )


def leaves_a_trace(
    data: Sequence[Data], baseline: Regression, final: Regression, remainder: Structure
) -> bool:
    """Whether more is left of the gap's smooth pattern than true effects leave."""
    before, after = (
        sum(float((d.residual(p) ** 2).sum()) for d, p in zip(data, fit.predictions, strict=True))
        for fit in (baseline, final)
    )
    taken_off = (before - after) / sum(int(d.used.sum()) for d in data)
    share = 0.0 if any(is_field(key) for key in final.keys) else LEFT_BEHIND
    return remainder.smooth > remainder.by_chance + share * taken_off
