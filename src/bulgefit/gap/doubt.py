"""Do the effects found explain the gap, or do they only come near what something else does?

A catalogue effect is modelled to about 1 % of what it does. Effects that stand in for something
else can come down to the noise too, but they leave more of the gap's own pattern, or need further
effects to remove it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from bulgefit.gap.data import Data
from bulgefit.gap.exchange import loss_without
from bulgefit.gap.regress import Regression
from bulgefit.gap.search import Groups, Search
from bulgefit.gap.structure import Structure
from bulgefit.gap.universe import Universe

__all__ = ["Doubt", "doubt", "leaves_a_trace"]

#: Why effects are not named: structure is left, they are too many, they leave a trace of what they
#: imitate, or one of them only completes a flexible one; "" where they are.
Doubt = Literal["", "structure", "many", "trace", "completion"]

#: Effects that may explain a gap together. With more, any gap can be imitated to the noise: what
#: they stand in for is then unknown.
MOST_NAMED = 3
#: Of what effects take off the mean square, their smooth, persistent remainder may be this share.
#: On made tests true effects left up to 0.0003 of it, two to four that stood in for a bent image
#: 0.0019 to 0.0041, whatever its size, a reference state that stood in for smoothing 0.0019 to
#: 0.010.
LEFT_BEHIND = 1e-3
#: Parameters from which on an effect is flexible: it can come near what something else does.
MANY = 9
#: Of the gap, an effect beside a flexible one must explain this share: a smaller one may be no more
#: than what the flexible one misses of something else. On made tests true companions explained
#: 0.018 and more, those of a reference state that stood in for another effect 0.0001 to 0.0028.
LEAST_COMPANION = 0.01


def doubt(
    search: Search,
    known: Universe,
    baseline: Regression,
    final: Regression,
    groups: Groups,
    remainder: Structure,
) -> Doubt:
    """Why the effects of a final model are not named, if they are not.

    Parameters
    ----------
    search : Search
    known : Universe
        At the final model.
    baseline, final : Regression
    groups : dict of effect id to its freed keys
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
    flexible = [name for name, keys in groups.items() if search.size(keys) >= MANY]
    companions = [keys for name, keys in groups.items() if flexible and name not in flexible]
    if any(loss_without(search, known, final, keys) < least for keys in companions):
        return "completion"
    return ""


def leaves_a_trace(
    data: Sequence[Data], baseline: Regression, final: Regression, remainder: Structure
) -> bool:
    """Whether more is left of the gap's smooth pattern than true effects leave."""
    before, after = (
        sum(float((d.residual(p) ** 2).sum()) for d, p in zip(data, fit.predictions, strict=True))
        for fit in (baseline, final)
    )
    taken_off = (before - after) / sum(int(d.used.sum()) for d in data)
    return remainder.smooth > remainder.by_chance + LEFT_BEHIND * taken_off
