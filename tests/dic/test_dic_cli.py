"""Do the verbs convert and info do what they say?"""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest

from bulgefit.cli import convert, info, tests_in
from bulgefit.dic import read_test, write_test
from bulgefit.errors import InputError


def run(verb, *arguments):
    parser = argparse.ArgumentParser(prog="bulgefit")
    verb.add_arguments(parser)
    return verb.run(parser.parse_args([str(argument) for argument in arguments]))


@pytest.fixture
def file(made_test, tmp_path):
    write_test(made_test, tmp_path / "t.npz")
    return tmp_path / "t.npz"


def test_convert_between_formats(file, tmp_path, same, capsys):
    assert run(convert, file, tmp_path / "t.h5") == 0
    assert run(convert, tmp_path / "t.h5", tmp_path / "again.npz") == 0
    same(read_test(file), read_test(tmp_path / "again.npz"))
    assert (tmp_path / "again.npz").read_bytes() == file.read_bytes()
    output = capsys.readouterr()
    assert output.out == ""
    assert "6 frames" in output.err


def test_convert_turns_crops_and_overrides(file, tmp_path):
    run(convert, file, tmp_path / "o.npz", "--rotate", 90, "--crop", 50, "--radius", 101,
        "--thickness", 0.9, "--poisson", 0.1)  # fmt: skip
    before, after = read_test(file, crop=50), read_test(tmp_path / "o.npz")
    np.testing.assert_array_equal(
        after.blocks[0].displacement[..., 0], -before.blocks[0].displacement[..., 1]
    )
    assert (after.radius, after.thickness, after.poisson_ratio) == (101, 0.9, 0.1)


def test_convert_crops_points_outside_the_clamp(made, tmp_path):
    made.reference[0] = [130, 0, 0]
    np.savez(tmp_path / "t.npz", **vars(made), radius=100.0, thickness=1.0)
    with pytest.raises(InputError, match="outside the clamp"):
        run(convert, tmp_path / "t.npz", tmp_path / "o.npz")
    run(convert, tmp_path / "t.npz", tmp_path / "o.npz", "--crop", 100)
    assert read_test(tmp_path / "o.npz").n_points == len(made.reference) - 1


def test_convert_a_folder_with_columns(csv_folder, made, tmp_path):
    folder = csv_folder(header=("X", "Y", "z", "dx", "dy", "dz"), specimen=None)
    run(convert, folder, tmp_path / "o.npz", "--columns", "x=X,y=Y", "--radius", 100,
        "--thickness", 1)  # fmt: skip
    assert read_test(tmp_path / "o.npz").n_points == len(made.reference)


@pytest.mark.parametrize("text", ["x", "x=", "=X", "x=X,,", "x=x,x=y"])
def test_columns_that_make_no_sense(csv_folder, tmp_path, text):
    with pytest.raises(InputError, match="--columns"):
        run(convert, csv_folder(), tmp_path / "o.npz", "--columns", text)


def test_convert_refuses_before_it_reads(tmp_path, file):
    with pytest.raises(InputError, match="exists; use --force"):
        run(convert, tmp_path / "missing.npz", file)
    with pytest.raises(InputError, match=r"o.txt: a test is written as .npz, .h5, .hdf5"):
        run(convert, tmp_path / "missing.npz", tmp_path / "o.txt")
    run(convert, file, tmp_path / "o.npz")
    run(convert, file, tmp_path / "o.npz", "--force", "--rotate", 180)
    for option, value in (("--crop", "-1"), ("--crop", "nan"), ("--rotate", "nan")):
        with pytest.raises(InputError, match=option):
            run(convert, file, tmp_path / "p.npz", f"{option}={value}")


def test_convert_never_replaces_its_input(file, csv_folder, tmp_path):
    before = file.read_bytes()
    link = tmp_path / "link.npz"
    link.symlink_to(file)
    folder = csv_folder()
    (folder / "old.npz").write_bytes(before)
    for source, target in ((file, file), (file, link), (link, file), (folder, folder / "old.npz")):
        with pytest.raises(InputError, match="would replace what is read as input"):
            run(convert, source, target, "--force", "--rotate", 90)
    assert file.read_bytes() == before
    run(convert, folder, folder / "new.npz")


def test_info_table(file, capsys):
    assert run(info, file) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert "0.1 to 3 bar, increasing" in output.out
    assert "nothing looks wrong" in output.out


def test_info_json(file, tmp_path, capsys):
    run(info, file, "--json", "-")
    printed = json.loads(capsys.readouterr().out)
    assert printed["n_frames"] == 6
    run(info, file, "--json", tmp_path / "i.json")
    assert "frames" in capsys.readouterr().out
    assert json.loads((tmp_path / "i.json").read_text()) == printed
    with pytest.raises(InputError, match="exists"):
        run(info, file, "--json", tmp_path / "i.json")
    run(info, file, "--json", tmp_path / "i.json", "--force")


def test_info_of_everything_that_may_be_missing(ragged, tmp_path, capsys):
    frames, pressure = ragged
    arrays = {
        "reference": np.concatenate([points for points, _ in frames]),
        "displacement": np.full((125, 3), np.nan),
        "frame": np.repeat(np.arange(4), [30, 40, 20, 35]),
    }
    arrays["displacement"][:, 0] = 1.0
    path = tmp_path / "t.npz"
    np.savez(path, **arrays, pressure=pressure, radius=100, thickness=1, time=np.arange(4))
    run(info, path)
    output = capsys.readouterr().out
    assert "each with points of its own" in output
    assert "dz was never measured at the apex" in output


def test_tests_from(file, tmp_path):
    parser = argparse.ArgumentParser()
    tests_in.add_tests_argument(parser)
    tests_in.add_reader_arguments(parser)
    run(convert, file, tmp_path / "other.npz", "--crop", 50)
    read = [str(file), str(tmp_path / "other.npz"), "--thickness", "1"]
    tests = tests_in.tests_from(parser.parse_args(read))
    assert [test.thickness for test in tests] == [1, 1]


@pytest.mark.parametrize("verb", [convert, info])
def test_help_says_units_and_examples(verb):
    parser = argparse.ArgumentParser(prog="bulgefit")
    verb.add_arguments(parser)
    text = parser.format_help()
    assert "examples:" in text
    assert text.count("default:") >= 5
    assert "\n" not in verb.HELP
