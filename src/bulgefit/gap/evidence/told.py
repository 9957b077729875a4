"""Which model is tried? Told in a line of a terminal, however many parts it has."""

from __future__ import annotations

from bulgefit.gap.evidence.problem import Model

__all__ = ["told"]

#: Columns of a terminal, less what stands before and behind: the second, the step, the time left.
_COLUMNS = 60


def told(model: Model, before: Model) -> str:
    """A model's parts; where these fill more than a line, how it differs from the one before."""
    parts, known = ({str(name) for name, _ in one} for one in (model, before))
    whole = " + ".join(sorted(parts)) or "the moduli alone"
    if len(whole) <= _COLUMNS:
        return whole
    changes = [
        sign + part
        for sign, ones in (("+", parts - known), ("-", known - parts))
        for part in sorted(ones)
    ]
    apart = f"{len(parts)} parts: {' '.join(changes) or 'those of before'}"
    return apart if len(apart) <= _COLUMNS else f"{len(parts)} parts"
