"""A made bulge, which the tests write as DIC systems would."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bulgefit.dic import BulgeTest


@pytest.fixture
def truth() -> SimpleNamespace:
    """Four frames of 81 points whose pixels run down as y runs up; no two displacements alike."""
    column, row = (grid.ravel() for grid in np.meshgrid(np.arange(9), np.arange(9)))
    x, y = 8.0 * (column - 4), -8.0 * (row - 4)
    # no height is exactly zero, which some systems write for what they lost
    reference = np.column_stack([x, y, 0.005 + 0.01 * column - 0.02 * row])
    pressure = np.array([0.0, 0.05, 0.1, 0.2])  # MPa
    shape = 1 - (x**2 + y**2) / 1e4
    displacement = np.empty((4, 81, 3))
    for i, p in enumerate(pressure):
        apex = 60 * p ** (1 / 3)
        displacement[i] = np.column_stack([2e-3 * apex * x, 1e-3 * apex * y, apex * shape])
    return SimpleNamespace(
        reference=reference.round(6),
        displacement=displacement.round(6),
        pressure=pressure,
        pixels=np.column_stack([100 + 20 * column, 200 + 20 * row]),
    )


@pytest.fixture
def holds(truth: SimpleNamespace) -> Callable[..., None]:
    """Assert that a test is the truth to 1e-6 mm, without the lost (frame, point)."""

    def compare(test: BulgeTest, lost: tuple[tuple[int, int], ...] = ()) -> None:
        expected = truth.displacement.copy()
        for frame, point in lost:
            expected[frame, point] = np.nan
        (block,) = test.blocks
        # whatever order the points were joined in
        distance = np.abs(block.reference[:, None] - truth.reference[None]).max(axis=2)
        at = distance.argmin(axis=1)
        kept = np.isfinite(expected).all(axis=2).any(axis=0)
        assert sorted(at) == np.flatnonzero(kept).tolist()
        assert distance.min(axis=1).max() < 2e-6
        np.testing.assert_allclose(block.displacement, expected[:, at], atol=1e-6, rtol=0)
        np.testing.assert_allclose(test.pressure, truth.pressure, atol=1e-9)

    return compare


@pytest.fixture
def write_table(tmp_path: Path) -> Callable[..., Path]:
    """Write one file of cells into the folder `frames`."""

    def write(
        name: str,
        header: str,
        rows: np.ndarray | list,
        *,
        separator: str = ",",
        decimal: str = ".",
        encoding: str = "utf-8",
        preamble: str = "",
    ) -> Path:
        folder = tmp_path / "frames"
        folder.mkdir(exist_ok=True)
        lines = [
            separator.join(
                cell if isinstance(cell, str) else f"{cell:.9g}".replace(".", decimal)
                for cell in row
            )
            for row in rows
        ]
        text = preamble + "\n".join([header, *lines]) + "\n\n"
        (folder / name).write_bytes(text.encode(encoding))
        return folder

    return write


@pytest.fixture
def log(tmp_path: Path, truth: SimpleNamespace) -> Callable[..., Path]:
    """Write a table of the pressures in bar, with the names of the frames."""

    def write(names: list[str], header: str = "file,pressure [bar]", folder: str = ".") -> Path:
        rows = [f"{name},{p * 10:.9g}" for name, p in zip(names, truth.pressure, strict=True)]
        (tmp_path / folder).mkdir(exist_ok=True)
        path = tmp_path / folder / "loads.csv"
        path.write_text("\n".join([header, *rows]) + "\n")
        return path

    return write


@pytest.fixture
def said() -> list[str]:
    """What a reader said; pass its `append` as `say`."""
    return []
