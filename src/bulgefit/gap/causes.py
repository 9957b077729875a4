"""What is named as a cause, how much does it count for, and what does it all come to?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from bulgefit.effects.parameter import Owned
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.evidence.coordinates import is_field
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.keys import at_edge
from bulgefit.gap.scatter import of_the_cloth

__all__ = ["Cause", "Verdict", "causes_of", "verdict_of"]


class Verdict(StrEnum):
    """What a diagnosis comes to."""

    #: Nothing need be added.
    NONE = "none"
    #: The causes are sure.
    NAMED = "named"
    #: Sets of causes, or causes of which it is open whether they are there.
    AMBIGUOUS = "ambiguous"
    #: Causes are sure, and something else is left.
    PARTIAL = "partial"
    #: Nothing is sure.
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Cause:
    """An effect that was named, wholly or in part.

    Attributes
    ----------
    effect : str
    specimen : int or None
        Whose cause it is, where several are judged together; None for what they share.
    probability : float
        From the evidence of all models that were weighed.
    alternatives : tuple of str
        Effects that this data cannot tell from it. Without any, and not sure, it may not be there.
    parameters : dict of name to {"value", "stderr", "unit", "pull"}
        The pull is the distance from the null in prior widths; a direction has none.
    at_bound : bool
        A parameter sits at the edge of its plausible range.
    share_of_gap : float or None
        What would be left without it, of the baseline's held-out misfit beyond the noise; None
        where the fit without it finds no equilibrium.
    heldout_reduction : float or None
        Part of the held-out misfit without it that it takes away; None as above.
    bias_if_omitted : dict
        Relative error of each modulus when the effect is left out and all else refitted; empty
        where that finds no equilibrium.
    bias_held : bool
        That of G12 is larger still: without the effect the fit asks for a softer one, by which
        frames would lose stability.
    partial : bool
        True where the effects found do not explain the gap.
    """

    effect: str
    specimen: int | None
    probability: float
    alternatives: tuple[str, ...]
    parameters: dict[str, dict[str, Any]]
    at_bound: bool
    share_of_gap: float | None
    heldout_reduction: float | None
    bias_if_omitted: dict[str, float]
    bias_held: bool
    partial: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "effect": self.effect,
            "place": CATALOGUE[self.effect].place,
            "specimen": self.specimen,
            "probability": self.probability,
            "alternatives": list(self.alternatives),
            "parameters": self.parameters,
            "at_bound": self.at_bound,
            "share_of_gap": self.share_of_gap,
            "heldout_reduction": self.heldout_reduction,
            "bias_if_omitted": self.bias_if_omitted,
            "bias_held": self.bias_held,
            "partial": self.partial,
            "meaning": CATALOGUE[self.effect].meaning,
        }


def verdict_of(found: Explanation) -> Verdict:
    """What the causes and what is left come to."""
    causes = [e for group, e in found.evidence.items() if not is_field(group)]
    if not found.complete:
        return Verdict.PARTIAL if any(e.sure for e in causes) else Verdict.UNKNOWN
    if not causes:
        return Verdict.NONE
    return Verdict.NAMED if all(e.sure for e in causes) else Verdict.AMBIGUOUS


def causes_of(found: Explanation) -> list[Cause]:
    """What has a name in the final model, what is worth most first."""
    excess = max(found.baseline.held_out() - found.final.floor, 1e-9)
    return [_cause(found, group, excess) for group in found.groups if not is_field(group)]


def _cause(found: Explanation, group: Owned, excess: float) -> Cause:
    evidence = found.evidence[group]
    effect = CATALOGUE[group.effect]
    errors = found.final.standard_errors()
    parameters, at_bound = {}, False
    for key in found.groups[group]:
        value, parameter = found.final.values[key], effect.parameter(key.parameter)
        at_bound |= at_edge(key, value)
        if parameter.period is not None:
            value = math.remainder(value, parameter.period)
        parameters[str(key._replace(effect=""))] = {
            "value": float(value),
            "stderr": float(errors[key]),
            "unit": parameter.unit,
            "pull": evidence.pulls[key] if parameter.period is None else None,
        }
    share, reduction, bias = None, None, {}
    if (without := evidence.without) is not None:
        left = without.held_out()
        gained = left - found.final.held_out()
        share = float(np.clip(gained / excess, 0.0, 1.0))
        reduction = float(gained / left)
        alone, full = of_the_cloth(without.values), of_the_cloth(found.final.values)
        bias = {m.name: alone[m] / full[m] - 1.0 for m in MODULI}
    return Cause(
        effect=effect.id,
        specimen=group.specimen,
        probability=evidence.probability,
        alternatives=tuple({r.effect: None for r in evidence.rivals if r.effect != group.effect}),
        parameters=parameters,
        at_bound=at_bound,
        share_of_gap=share,
        heldout_reduction=reduction,
        bias_if_omitted=bias,
        bias_held=without is not None and without.held,
        partial=not found.complete,
    )
