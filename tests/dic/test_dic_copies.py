"""Is a frame that was written twice told, and counted once?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, write_test
from bulgefit.dic.copies import copied_frames, repeated_frames, without_copies
from bulgefit.dic.given import given_tests
from bulgefit.dic.suspicions import suspicions
from bulgefit.errors import InputError


def of(made: SimpleNamespace, frames: list[int]) -> BulgeTest:
    return BulgeTest.from_arrays(made.reference, made.displacement[frames], made.pressure[frames])


def told(test: BulgeTest) -> set[str]:
    return {one.code for one in suspicions(test)}


def test_copies_are_told_by_their_first_frame_and_counted_once(made: SimpleNamespace) -> None:
    made.displacement[2, 5] = np.nan  # a lost point is lost in the copy, too
    plain = of(made, [0, 1, 2, 3, 4, 5])
    twice = of(made, [0, 1, 2, 2, 2, 3, 4, 5, 5])
    assert copied_frames(twice) == {3: 2, 4: 2, 8: 7}
    assert not copied_frames(plain)
    assert without_copies(plain) is plain
    (counted,) = given_tests(twice)
    np.testing.assert_array_equal(counted.pressure, plain.pressure)
    np.testing.assert_array_equal(counted.blocks[0].displacement, plain.blocks[0].displacement)
    (said,) = [one for one in suspicions(twice) if one.code == "frames_copied"]
    assert "3 of 2, 4 of 2, 8 of 7; they are counted once" in said.text
    assert told(twice) - {"frames_copied"} == told(plain)


def test_a_test_that_is_given_twice_is_refused(made: SimpleNamespace) -> None:
    """It would count as two specimens; under another name, and with a frame written twice, too."""
    one = of(made, [0, 1, 2, 3, 4, 5])
    again = replace(of(made, [0, 1, 2, 2, 3, 4, 5]), name="again")
    with pytest.raises(InputError, match=r"^test_1 and again: hold the same data; name"):
        given_tests([one, of(made, [0, 1, 2, 3, 4]), again])
    assert len(given_tests([one, of(made, [0, 1, 2, 3, 4])])) == 2


def test_a_frame_that_differs_by_a_bit_or_in_pressure_is_none(made: SimpleNamespace) -> None:
    again = of(made, [0, 1, 2, 2, 3, 4, 5])
    moved = again.blocks[0].displacement.copy()
    moved[3, 7, 2] = np.nextafter(moved[3, 7, 2], 1e3)
    pressure = again.pressure.copy()
    assert not copied_frames(BulgeTest.from_arrays(made.reference, moved, pressure))
    assert "pressure_not_increasing" in told(BulgeTest.from_arrays(made.reference, moved, pressure))
    pressure[3] *= 1.01
    assert not copied_frames(
        BulgeTest.from_arrays(made.reference, again.blocks[0].displacement, pressure)
    )


def test_one_at_another_pressure_is_no_mixture(made: SimpleNamespace) -> None:
    made.displacement[4] = made.displacement[1]
    again = of(made, [0, 1, 2, 3, 4, 5])
    assert repeated_frames(again) == {4: 1}
    (said,) = [one for one in suspicions(again) if one.code == "frames_repeated"]
    bar = 10 * made.pressure
    assert f"frame 4 (from 0, {bar[4]:.4g} bar) is 1 ({bar[1]:.4g} bar)" in said.text
    assert "frames_interpolated" not in told(again)
    assert "frames_repeated" not in told(of(made, [0, 1, 1, 2, 3]))


def test_references_in_which_nothing_has_moved_are_none(made: SimpleNamespace) -> None:
    moved = np.concatenate([np.zeros((2, *made.displacement.shape[1:])), made.displacement])
    pressure = np.concatenate([[0.0, 0.0], made.pressure])
    assert not copied_frames(BulgeTest.from_arrays(made.reference, moved, pressure))


def test_frames_with_points_of_their_own(
    ragged: tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray],
) -> None:
    frames, pressure = ragged
    twice = BulgeTest.from_frames([*frames, frames[-1]], [*pressure, pressure[-1]])
    last = len(frames)
    assert copied_frames(twice) == {last: last - 1}
    assert without_copies(twice).n_frames == last


def test_a_verb_warns_of_them(
    made: SimpleNamespace,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_test(of(made, [0, 1, 2, 2, 3, 4, 5]), "twice.npz")
    moduli = ["--E1", "300", "--E2", "250", "--G12", "5", "--refine", "1"]
    assert main(["evaluate", "twice.npz", *moduli]) == 0
    said = capsys.readouterr().err
    assert (
        "warning: twice: frames hold the same data as others at the same pressure: 3 of 2" in said
    )


def test_a_test_with_a_copied_frame_is_no_other_specimen(
    made: SimpleNamespace,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_test(of(made, [0, 1, 2, 3, 4, 5]), "plain.npz")
    write_test(of(made, [0, 1, 2, 2, 3, 4, 5]), "twice.npz")
    assert main(["fit", "plain.npz", "twice.npz"]) == 2
    assert "plain.npz and twice.npz: hold the same data" in capsys.readouterr().err
