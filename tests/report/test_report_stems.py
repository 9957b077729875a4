"""Do the files of tests stay in their folder, apart from each other, and short enough?"""

from __future__ import annotations

import pytest

from bulgefit.report.stems import file_stems


@pytest.mark.parametrize(
    ("names", "stems"),
    [
        (["a/b", "..", "x", "x"], ["a_b", "test", "x_3", "x_4"]),
        (["a", "a", "a_2"], ["a_1", "a_3", "a_2"]),
        (["a_1", "a", "a", "a_3"], ["a_1", "a_2", "a_4", "a_3"]),
        (["A", "a"], ["A_1", "a_2"]),
        (["../../etc/x", "c:\\x", "tab\t\nline", "caf\udce9", ""],
         ["_.._etc_x", "c_x", "tab_line", "caf_", "test"]),
        (["Prüfung 1", "試験"], ["Prüfung_1", "試験"]),
    ],
)  # fmt: skip
def test_names_of_files(names, stems):
    assert file_stems(names) == stems


def test_long_names_of_files(tmp_path):
    stems = file_stems(["試" * 300, "試" * 301])
    assert len(set(stems)) == 2
    for stem in stems:
        (tmp_path / f".{stem}_where_before.12345678.png").touch()
