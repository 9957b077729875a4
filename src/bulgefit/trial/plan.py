"""What is each test of a trial to be?"""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import SeedSequence, default_rng

from bulgefit.errors import InputError
from bulgefit.trial.draw import KINDS
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.known import KNOWN

__all__ = ["FAMILY", "KNOWN_KINDS", "SHARES", "filmed_closely", "interpolated", "plan", "turned"]

#: Three tests of one cloth, diagnosed together.
FAMILY = "family"
KNOWN_KINDS = (*KINDS, FAMILY)

#: Shares of kinds in a trial of all of them: a third have a foreign effect, most of them beside
#: others.
SHARES = {
    "none": 0.10,
    "one": 0.24,
    "two": 0.08,
    "three": 0.07,
    "four": 0.06,
    "five": 0.05,
    "six": 0.03,
    "foreign": 0.12,
    "beside": 0.20,
    FAMILY: 0.05,
}
#: Kinds of which a share is dealt out evenly.
_GROUPS = {"one": list(KNOWN), "foreign": list(FOREIGN)}
#: Share of tests whose frames are interpolated, of a trial of all kinds.
_INTERPOLATED = 0.05
#: Share of those with more frames than the others, and how many these may be.
_CLOSELY, _FRAMES = 0.05, (30, 60)
#: Share of the tests whose warp was mounted elsewhere than along x.
_TURNED = 0.1


def plan(number: int, seed: int, kinds: Sequence[str] | None = None) -> list[str]:
    """What each test of a trial is to be, in an order that tells nothing.

    Parameters
    ----------
    number : int
    seed : int
    kinds : sequence of str, optional
        Only these (`draw.KINDS`, or `FAMILY`), equally often; default: all, in the shares of
        `SHARES`, effects of a kind equally often.

    Raises
    ------
    InputError
        Number below 1 or an unknown kind.
    """
    if number < 1:
        raise InputError(f"number of tests must be 1 or more, got {number}")
    unknown = [k for k in kinds or () if k not in KNOWN_KINDS]
    if unknown:
        raise InputError(
            f"effects: {', '.join(unknown)} unknown; choose from {', '.join(KNOWN_KINDS)}"
        )
    rng = default_rng(SeedSequence([seed, 0]))

    def cycle(names: Sequence[str], count: int) -> list[str]:
        order = [names[i] for i in rng.permutation(len(names))]
        return [order[i % len(order)] for i in range(count)]

    if kinds:
        chosen = cycle(list(kinds), number)
    else:
        counts = {kind: round(share * number) for kind, share in SHARES.items()}
        counts["one"] = max(0, counts["one"] + number - sum(counts.values()))
        chosen = [
            name
            for kind, count in counts.items()
            for name in cycle(_GROUPS.get(kind, [kind]), count)
        ]
        chosen = chosen[:number]
    return [chosen[i] for i in rng.permutation(len(chosen))]


def interpolated(number: int, seed: int) -> set[int]:
    """Which tests of a trial of all kinds have frames that were interpolated."""
    rng = default_rng(SeedSequence([seed, 2]))
    return {int(i) for i in rng.permutation(number)[: round(_INTERPOLATED * number)]}


def filmed_closely(number: int, seed: int) -> dict[int, int]:
    """Which tests of a trial of all kinds have more frames than the others, and how many."""
    rng = default_rng(SeedSequence([seed, 3]))
    chosen = rng.permutation(number)[: round(_CLOSELY * number)]
    low, high = _FRAMES
    return {int(i): int(rng.integers(low, high, endpoint=True)) for i in chosen}


def turned(number: int, seed: int) -> dict[int, float]:
    """Which tests of a trial of all kinds have their warp elsewhere than along x; degrees from it.

    In half of them by a quarter turn, as a specimen is turned in its clamp.
    """
    rng = default_rng(SeedSequence([seed, 4]))
    chosen = rng.permutation(number)[: round(_TURNED * number)]
    return {int(i): 90.0 if rng.random() < 0.5 else float(rng.uniform(-80, 80)) for i in chosen}
