"""A reader of one's own: what the lab's rig writes, one JSON file a test.

{"clamp_mm": [radius, thickness],
 "points": [[x, y, z], ...],
 "images": [{"mbar": 250, "moved": [[dx, dy, dz] or null, ...]}, ...]}
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from bulgefit.dic.registry import Recording, reader

MBAR = 1e-4  # MPa


@reader(
    "rig",
    [".rig"],
    looks_like="a test of our own rig (.rig)",
    example='{"clamp_mm": [100, 0.81], "points": [[1.5, 0, 0], ...], "images": [...]}',
    lost="null",
)
def read_rig(path: Path) -> Recording:
    """Everything else, such as what may be wrong with the numbers, bulgefit looks after."""
    raw = path.read_bytes()
    test = json.loads(raw)
    lost = [float("nan")] * 3
    radius, thickness = test["clamp_mm"]
    return Recording(
        pressure=[image["mbar"] * MBAR for image in test["images"]],
        checksum=hashlib.sha256(raw).hexdigest(),
        reference=test["points"],
        displacement=[[u or lost for u in image["moved"]] for image in test["images"]],
        radius=radius,
        thickness=thickness,
    )
