"""The catalogue as the diagnosis searches it, and the offset of every measured point."""

from __future__ import annotations

from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import catalogue, chosen_effects, fields

__all__ = ["CATALOGUE", "CREASES", "MODULI", "OFFSETS", "SHEAR", "chosen_effects"]

MODULI = tuple(Key.of(name) for name in ("E1", "E2", "G12"))
#: The modulus by which fabrics lose their stability.
SHEAR = MODULI[-1]

CATALOGUE = catalogue()

#: The field whose offsets of every measured point are no coordinates, and their key.
(CREASES,) = (field.id for field in fields().values() if field.pointwise)
OFFSETS = Key(CREASES, "offsets")
