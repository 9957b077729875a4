"""The cameras' place: a reference image that shows the fabric creased, point by point."""

from __future__ import annotations

from bulgefit.effects.fields.base import Field

__all__ = ["EFFECT"]


class ReferenceField(Field):
    """An offset of every measured point that all frames share.

    It has no parameters and no hooks: offsets are integrated out of the likelihood
    (`bulgefit.gap.evidence.weighing`).
    """

    id = "reference_field"
    place = "camera"
    meaning = "the reference image shows the fabric already displaced, finer than by waves"
    remedy = "take the reference image under a light pressure that makes the fabric smooth"
    quantity = "displacement on the reference image"
    unit = "mm"
    pointwise = True


EFFECT = ReferenceField()
