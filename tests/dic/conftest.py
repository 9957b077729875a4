"""Made bulge tests with numbers that are easy to check."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bulgefit.dic import BulgeTest


def _made(frames: int = 6, spacing: float = 8.0, noise: float = 0.01) -> SimpleNamespace:
    rng = np.random.default_rng(1)
    axis = np.arange(-96, 97, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 97
    x, y = x[inside], y[inside]
    reference = np.column_stack([x, y, rng.normal(0, 0.01, x.size)])
    pressure = np.linspace(0.01, 0.3, frames)
    shape = 1 - (x**2 + y**2) / 1e4
    displacement = np.empty((frames, x.size, 3))
    for i, p in enumerate(pressure):
        apex = 60 * p ** (1 / 3)
        in_plane = 1e-4 * apex * shape
        displacement[i] = np.column_stack([in_plane * x, 2 * in_plane * y, apex * shape])
    displacement += rng.normal(0, noise, displacement.shape)
    return SimpleNamespace(reference=reference, displacement=displacement, pressure=pressure)


@pytest.fixture
def made() -> SimpleNamespace:
    """Arrays of a smooth test: 6 frames of 465 points on an 8 mm grid."""
    return _made()


@pytest.fixture
def made_test(made: SimpleNamespace) -> BulgeTest:
    """The same as a test, with images at rest and times."""
    rng = np.random.default_rng(2)
    return BulgeTest.from_arrays(
        made.reference,
        made.displacement,
        made.pressure,
        name="made",
        static_displacement=rng.normal(0, 0.01, (3, *made.reference.shape)),
        time=np.arange(len(made.pressure)) * 2.0,
    )


@pytest.fixture
def ragged() -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Four frames with points of their own, and their pressures."""
    rng = np.random.default_rng(3)
    frames = [
        (np.column_stack([rng.uniform(-60, 60, (n, 2)), np.zeros(n)]), rng.normal(size=(n, 3)))
        for n in (30, 40, 20, 35)
    ]
    return frames, np.array([0.05, 0.1, 0.2, 0.3])


@pytest.fixture
def study_rows(made: SimpleNamespace) -> np.ndarray:
    """The study's layout: rows of [(n, 6) array in mm, pressure in GPa]."""
    rows = np.empty((len(made.pressure), 2), dtype=object)
    for i, p in enumerate(made.pressure):
        rows[i, 0] = np.hstack([made.reference, made.displacement[i]])
        rows[i, 1] = p * 1e-3
    return rows


@pytest.fixture
def csv_folder(tmp_path: Path, made: SimpleNamespace) -> Callable[..., Path]:
    """Write a folder of CSV frames."""

    def write(
        separator: str = ",",
        decimal: str = ".",
        header: tuple[str, ...] = ("x", "y", "z", "dx", "dy", "dz"),
        lost: dict[int, str] | None = None,
        unit: str = "bar",
        scale: float = 10.0,
        specimen: str | None = '{"radius": 100, "thickness": 0.81, "poisson_ratio": 0.3}',
    ) -> Path:
        folder = tmp_path / "frames"
        folder.mkdir()

        def number(value: float) -> str:
            return repr(float(value)).replace(".", decimal)

        table = [f"file{separator}pressure_{unit}"]
        for i, p in enumerate(made.pressure):
            rows = np.hstack([made.reference, made.displacement[i]])
            lines = [separator.join(header)]
            for k, row in enumerate(rows):
                cells = [number(value) for value in row]
                if lost and k in lost:
                    cells[3:] = [lost[k]] * 3
                lines.append(separator.join(cells))
            (folder / f"frame_{i}.csv").write_text("\n".join(lines) + "\n")
            table.append(f"frame_{i}.csv{separator}{number(p * scale)}")
        (folder / "pressure.csv").write_text("\n".join(table) + "\n")
        if specimen is not None:
            (folder / "test.json").write_text(specimen)
        return folder

    return write


@pytest.fixture
def same() -> Callable[[Any, Any], None]:
    """Assert that two tests hold the same numbers, bit for bit."""

    def compare(a: BulgeTest, b: BulgeTest) -> None:
        assert len(a.blocks) == len(b.blocks)
        for left, right in zip(a.blocks, b.blocks, strict=True):
            np.testing.assert_array_equal(left.reference, right.reference)
            np.testing.assert_array_equal(left.frames, right.frames)
            np.testing.assert_array_equal(left.displacement, right.displacement)
            assert left.displacement.dtype == right.displacement.dtype
        np.testing.assert_array_equal(a.pressure, b.pressure)
        for key in ("static_displacement", "time"):
            assert (getattr(a, key) is None) == (getattr(b, key) is None)
            if getattr(a, key) is not None:
                np.testing.assert_array_equal(getattr(a, key), getattr(b, key))
        for key in ("radius", "thickness", "poisson_ratio"):
            assert getattr(a, key) == getattr(b, key)

    return compare
