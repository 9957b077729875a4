"""What was found: the final model, what speaks for each of its parts, and the way there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Key, Owned
from bulgefit.gap.evidence.probability import SURE
from bulgefit.gap.level import Level
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.structure import Structure

__all__ = ["Evidence", "Explanation", "FoundField", "Known", "Step"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What speaks for a group of the final model.

    Attributes
    ----------
    probability : float
    rivals : tuple of Owned
        Groups of which one may stand in its place, where it is not sure.
    without : Regression or None
        The rest of the model, refitted; None where nothing balances.
    pulls : dict of Key to float
        Distance of each parameter from its null in prior widths.
    """

    probability: float
    rivals: tuple[Owned, ...]
    without: Regression | None
    pulls: dict[Key, float]

    @property
    def sure(self) -> bool:
        """Whether the group is sure by itself."""
        return self.probability >= SURE


@dataclass(frozen=True, eq=False)
class FoundField:
    """A field of the final model: something sits in its place that no effect describes.

    Attributes
    ----------
    group : Owned
    sampled : Sampled
    stderr : (m,) array
        Standard error at each of its places, that of the rest of the model in it.
    level : Level
    """

    group: Owned
    sampled: Sampled
    stderr: Floats
    level: Level = field(default_factory=Level)


@dataclass(frozen=True, eq=False)
class Step:
    """The model with one group more, or with all that it begins with."""

    groups: tuple[Owned, ...]
    before: Regression
    after: Regression

    @property
    def name(self) -> str:
        """As JSON and pictures tell it."""
        return " + ".join(str(group) for group in self.groups)


@dataclass(frozen=True, eq=False)
class Known:
    """Normal matrix of every catalogue effect's coordinates at the final model."""

    keys: tuple[Key, ...]
    hessian: Floats


@dataclass(eq=False)
class Explanation:
    """What was found.

    Attributes
    ----------
    baseline, final : Regression
    known : Known
    groups : dict of Owned to its freed keys
        Those of the final model, what takes most off the gap first; fields among them.
    evidence : dict of Owned to Evidence
    others : dict of Owned to float
        Probabilities of candidates that are not in the final model.
    fields : list of FoundField
    steps : list of Step
        From the moduli alone to the final model, group by group.
    start, remainder : Structure
        Of the baseline's residual and of the final model's.
    temper : float
        By which differences of the evidence were divided.
    """

    baseline: Regression
    final: Regression
    known: Known
    groups: dict[Owned, tuple[Key, ...]]
    evidence: dict[Owned, Evidence]
    others: dict[Owned, float]
    fields: list[FoundField]
    steps: list[Step]
    start: Structure
    remainder: Structure
    temper: float

    @property
    def level(self) -> Level:
        """What a test's own fields multiply the moduli by in most places; 1 for several tests."""
        return Level.of_all([f.level for f in self.fields if f.group.specimen is None])

    @property
    def complete(self) -> bool:
        """Whether effects that have names explain the gap down to the noise."""
        return not self.fields and not self.remainder.significant
