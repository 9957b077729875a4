"""The catalogue as the diagnosis searches it, and the offset of every measured point."""

from __future__ import annotations

from bulgefit.effects.registry import catalogue, chosen_effects

__all__ = ["CATALOGUE", "FIELD", "FIELD_FORMS", "FLATTENING", "MODULI", "STEADY", "chosen_effects"]

MODULI = ("E1", "E2", "G12")

CATALOGUE = catalogue()

#: Key of the offset of every measured point.
FIELD = "reference_state.field"
FLATTENING = "reference_state.flattening"

#: Keys of further forms with an offset of every measured point in the place of the parameters so
#: far; tried only once the form before is in the model.
FIELD_FORMS = {"reference_state": ((FIELD,), (FIELD, FLATTENING))}

#: Parameters that an offset of every point contains.
STEADY = frozenset(f"{effect.id}.{name}" for effect in CATALOGUE.values() for name in effect.steady)
