"""Does the page on one's data tell what the program does?"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bulgefit.dic import READERS, read_test

PAGE = (Path(__file__).parents[3] / "docs" / "your_data.md").read_text(encoding="utf-8")
OWN = {"npz", "hdf5", "study", "csv"}


def test_every_format_is_told():
    rows = re.findall(r"^\| `([\w-]+)` \|.*\| (reference|current) \|$", PAGE, flags=re.MULTILINE)
    expected = {name: entry.positions for name, entry in READERS.items() if name not in OWN}
    assert dict(rows) == expected


def test_the_folder_of_csv_files_is_read(tmp_path):
    """The block shows two files side by side."""
    (block,) = re.findall(r"```text\n(frames/.*?)```", PAGE, flags=re.DOTALL)
    (specimen,) = re.findall(r"```json\n(.*?)```", PAGE, flags=re.DOTALL)
    first, *rows = block.splitlines()
    at = first.index("frames/", 1)
    left, right = [row[:at].strip() for row in rows], [row[at:].strip() for row in rows]
    (tmp_path / "pressure.csv").write_text("\n".join(left))
    for name in ("frame_0.csv", "frame_1.csv"):
        (tmp_path / name).write_text("\n".join(right))
    (tmp_path / "test.json").write_text(specimen.replace("X_mm", "x"))
    test = read_test(tmp_path)
    assert test.pressure.tolist() == pytest.approx([0.01, 0.02])
    assert test.frame(1)[1].tolist()[0] == [0.0021, -0.0034, 1.52]
    assert (test.radius, test.thickness, test.name) == (100, 0.81, "cloth A, 3")
