"""The study's Table 4: every objective under every objective's optimum."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bulgefit.cli.main import main

EXAMPLE = Path(__file__).resolve().parents[2] / "data/example_bulge.npz"


def test_each_optimum_is_best_by_its_own_objective(capsys: pytest.CaptureFixture[str]) -> None:
    """With what else the fit has: held, it is part of each optimum."""
    bounds = "E1=250:450,E2=180:300,G12=15:50"
    options = ["--bounds", bounds, "--starts", "1", "--cross-table", "--json", "-", "--quiet"]
    options += ["--hold", "rigid_motion.shift_x=0.05"]
    assert main(["fit", str(EXAMPLE), *options]) == 0
    result = json.loads(capsys.readouterr().out)
    table = result["cross_table"]
    assert table["optimum of e_w"]["e_w"] == pytest.approx(result["objective"]["value"], rel=1e-3)
    assert set(table) == {"optimum of e", "optimum of e_w", "optimum of e_z", "undeformed"}
    for name in ("e", "e_w", "e_z"):
        best = table[f"optimum of {name}"][name]
        others = [row[name] for key, row in table.items() if key != f"optimum of {name}"]
        assert best <= min(others) * (1 + 1e-3)
    assert table["undeformed"]["e_z"] > 10.0  # the dome is tens of millimetres high
