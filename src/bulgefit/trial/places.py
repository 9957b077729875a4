"""Is a foreign effect looked for at the right place, and at the right spot there?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, cos, degrees, hypot, radians, sin
from typing import Any

from bulgefit.trial.right import LARGEST_SET, Record, is_sure

__all__ = ["false_fields", "judge_place", "sure_fields"]

#: Distance from a spot within which it counts as found, mm.
NEAR = 8.0


def sure_fields(answer: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Fields that are said to be at work, the one that explains most first."""
    sure = [field for field in answer.get("fields") or () if is_sure(field)]
    return sorted(sure, key=lambda field: -(field.get("share_of_gap") or 0.0))


def false_fields(record: Record) -> list[Mapping[str, Any]]:
    """Sure fields at places where nothing foreign is at work."""
    places = {*record["truth"].get("places", {}).values()}
    return [f for f in sure_fields(record["answer"]) if not _named(f) & places]


def judge_place(record: Record) -> dict[str, bool] | None:
    """Whether the leading field is at the foreign effect's place, and near its spot.

    Two places that do the same may be told as a set. None where nothing foreign is at work, or
    the answer knows no fields; without `spot` where the effect has none.
    """
    places = record["truth"].get("places") or {}
    if not places or "fields" not in record["answer"]:
        return None
    ((effect, place),) = places.items()
    leading = sure_fields(record["answer"])[:1]
    named = _named(leading[0]) if leading else set()
    right = place in named and len(named) <= LARGEST_SET
    spot = record["truth"]["where"][effect]
    if spot is None:
        return {"place": right}
    return {"place": right, "spot": right and _is_near(spot, leading[0].get("where") or {})}


def _named(field: Mapping[str, Any]) -> set[str]:
    alternatives: Sequence[str] = field.get("alternatives") or ()
    return {field["place"], *alternatives}


def _is_near(spot: Mapping[str, float], told: Mapping[str, float]) -> bool:
    """Whether a spot that was told is near a true one: a point, a line or a sector."""
    if "half_width_degree" in spot:
        angle = told.get("angle_degree")
        if angle is None and {"x_mm", "y_mm"} <= told.keys():
            angle = degrees(atan2(told["y_mm"], told["x_mm"]))
        if angle is None:
            return False
        away = abs((angle - spot["angle_degree"] + 180.0) % 360.0 - 180.0)
        return bool(away <= spot["half_width_degree"])
    if not {"x_mm", "y_mm"} <= told.keys():
        return False
    if "normal_degree" in spot:
        turn = radians(spot["normal_degree"])
        across = told["x_mm"] * cos(turn) + told["y_mm"] * sin(turn)
        return bool(abs(across - spot["distance_mm"]) <= NEAR)
    return hypot(told["x_mm"] - spot["x_mm"], told["y_mm"] - spot["y_mm"]) <= NEAR
