"""Do the examples of the documentation run, and do the numbers hold that they assert?"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import bulgefit

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("plot_*.py"))


def draws_in_3d() -> None:
    """Skip where there is no OpenGL."""
    from bulgefit.report import _off_screen

    try:
        _off_screen.require_opengl()
    except bulgefit.BulgefitError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(script: Path) -> None:
    """As a reader would run it, in a process of its own."""
    if "bulgefit.show(" in script.read_text(encoding="utf-8"):
        draws_in_3d()
    assert "assert " in script.read_text(encoding="utf-8"), "an example states its figures"
    places = [str(Path(bulgefit.__file__).parents[1])]
    places += filter(None, [os.environ.get("PYTHONPATH")])
    environment = {
        **os.environ,
        "MPLBACKEND": "agg",
        "PYVISTA_OFF_SCREEN": "true",
        "PYTHONPATH": os.pathsep.join(places),
    }
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
