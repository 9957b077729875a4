"""What has no name: how large is it at each of its places, and how sure is that?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import fields
from bulgefit.gap.data import Data
from bulgefit.gap.explanation import FoundField
from bulgefit.gap.level import Level
from bulgefit.gap.regress import Regression

__all__ = ["creases_found", "field_found"]

Floats = NDArray[np.float64]


def field_found(
    group: Owned, values: Mapping[Key, float], data: Sequence[Data], final: Regression
) -> FoundField:
    """A field over its place, with the standard errors that the final model leaves there.

    Parameters
    ----------
    group : Owned
    values : mapping of Key to float
        Of all its parameters.
    data : sequence of Data
    final : Regression
        With the covariance of those that are freed.
    """
    specimen = data[group.specimen or 0].specimen
    kind = fields()[group.effect]

    def at(own: Floats) -> Sampled:
        named = dict(zip(names, own.tolist(), strict=True))
        return kind.sampled(named, specimen.test.radius, specimen.recorded)

    names = [key.parameter for key in values]
    own = np.array([*values.values()])
    columns = {key: column for column, key in enumerate(final.columns)}
    freed = [key in columns for key in values]
    ours = [columns[key] for key in values if key in columns]
    here = at(own)
    variance = np.zeros_like(here.values)
    for step in _one_error(final.covariance[np.ix_(ours, ours)]):
        away = np.zeros_like(own)
        away[freed] = step
        variance += (0.5 * (at(own + away).values - at(own - away).values)) ** 2
    return FoundField(group, here, np.sqrt(variance), Level.of(kind, values))


def _one_error(covariance: Floats) -> Floats:
    """Steps (p, p), one a row, along the covariance's axes and as long as its errors there.

    What a function does over them tells its variance; of a field whose level is its median the
    derivative is one place's alone (Julier and Uhlmann, 2004, "Unscented filtering and nonlinear
    estimation", section III).
    """
    variances, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))).T)


def creases_found(group: Owned, data: Data, offset: Floats, error: Floats) -> FoundField:
    """Sizes of the offsets (n, 3) mm of a specimen's points, where they are; errors likewise."""
    size = np.linalg.norm(offset, axis=1)
    # of no size there is no direction: as unsure as the components are on the whole
    towards = np.divide(
        offset, size[:, None], out=np.full_like(offset, 3.0**-0.5), where=size[:, None] > 0.0
    )
    x, y = data.specimen.reference[:, :2].T
    stderr = np.sqrt(((towards * error) ** 2).sum(axis=1))
    return FoundField(group, Sampled(size, {"x_mm": x, "y_mm": y}), stderr)
