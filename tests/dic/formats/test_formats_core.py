"""Encodings, names of columns, tables, positions and joins: what all readers stand on."""

from __future__ import annotations

import os

import numpy as np
import pytest

from bulgefit.dic import READERS, read_test
from bulgefit.dic.formats.encoding import decode
from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.join import joined
from bulgefit.dic.formats.names import column
from bulgefit.dic.formats.positions import evidence
from bulgefit.dic.formats.source import frame_name, natural, source_of
from bulgefit.dic.formats.table import read_table
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 1.0}


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", b""),
        ("utf-8", b"\xef\xbb\xbf"),
        ("utf-16-le", b"\xff\xfe"),
        ("utf-16-be", b"\xfe\xff"),
        ("cp1252", b""),
        ("latin-1", b""),
    ],
)
def test_encodings(encoding, mark):
    text = "angle [°];Prüfdruck;µm\n1;2;3\n"
    assert decode(mark + text.encode(encoding)) == text


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf16_without_a_mark(encoding):
    assert decode("x [mm];y [mm]\n".encode(encoding)) == "x [mm];y [mm]\n"


def test_a_head_may_end_within_a_letter():
    data = ("x" * 9 + "°").encode()
    assert decode(data[:-1], cut=True) == "x" * 9
    # and what is cp1252 to its end is not cut
    assert decode(b"\xb0C") == "°C"
    # bytes without a meaning in cp1252
    assert decode(b"\x81\xb0") == "\x81°"


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("X [mm]", "X", "mm"),
        ("x[mm]", "x", "mm"),
        (' "X"', "X", None),
        ("Exx [ ]", "Exx", ""),
        ("Image index (Image index)", "Image index (Image index)", None),
        ("p (bar)", "p", "bar"),
        ("p_bar", "p", "bar"),
        ("x_pic", "x_pic", None),
        ("sigma_m", "sigma_m", None),
        ("disp.Out-Of-Plane: W [mm]", "disp.Out-Of-Plane: W", "mm"),
    ],
)
def test_names_of_columns(name, quantity, unit):
    found = column(name)
    assert (found.quantity, found.unit) == (quantity, unit)


@pytest.mark.parametrize(
    ("text", "names", "unit"),
    [
        ("a,b\n1,2\n", ("a", "b"), None),
        ("\n\n# a;b\n1,5;2\n", ("a", "b"), None),
        ("a;b\nmm;kPa\n1,5;2\n", ("a", "b"), "kPa"),
        ("made by\n\na\tb\n1.5\t2\n", ("a", "b"), None),
        ("a b\n1,5 2\n", ("a", "b"), None),
        ("a  b [V]\n1.5     2\n", ("a", "b [V]"), "V"),
        ('"a"; "b"\n"1,5";"2"\n', ("a", "b"), None),
    ],
)
def test_tables(tmp_path, text, names, unit):
    (tmp_path / "t.txt").write_text(text)
    table = read_table(tmp_path / "t.txt", lambda columns: columns[0].quantity == "a")
    assert table.header == names
    assert table.columns[1].unit == unit
    first = 1 if "1.5" not in text and "1,5" not in text else 1.5
    np.testing.assert_array_equal(table.numbers(names), [[first, 2]])


def test_comments_and_marks_of_windows_in_a_table(tmp_path):
    (tmp_path / "t.txt").write_text("a,b\n# note, with, commas\n1,-nan(ind)\n1.#QNAN,2\n")
    table = read_table(tmp_path / "t.txt", lambda columns: columns[0].name == "a")
    np.testing.assert_array_equal(table.numbers(["a", "b"]), [[1, np.nan], [np.nan, 2]])


def test_names_of_frames_and_their_order():
    assert frame_name(r"C:\run\Image_0007_0.tiff") == "Image_0007_0"
    assert frame_name("B0001_0.tif.csv") == "B0001_0"
    assert frame_name("p_1.5bar.csv") == "p_1.5bar"
    names = ["s_10", "s_9", "s_2", "p_0bar", "p_0.5bar", "p_10bar"]
    expected = ["p_0bar", "p_0.5bar", "p_10bar", "s_2", "s_9", "s_10"]
    assert sorted(names, key=natural) == expected


# ---- positions ----


def frames_of(truth, current: bool, with_ids: bool, order=(0, 1, 2, 3)) -> list[Frame]:
    return [
        Frame(
            path=None,
            name=str(i),
            position=truth.reference + current * truth.displacement[i],
            displacement=truth.displacement[i],
            ids=np.arange(81)[:, None] if with_ids else None,
        )
        for i in order
    ]


@pytest.mark.parametrize("with_ids", [True, False])
@pytest.mark.parametrize("current", [True, False])
def test_positions_are_seen_on_the_numbers(truth, current, with_ids):
    found = evidence(frames_of(truth, current, with_ids, order=(3, 0, 1)))
    assert found is not None
    assert found.says == ("current" if current else "reference")


def test_positions_that_the_numbers_do_not_tell(truth):
    assert evidence(frames_of(truth, True, True, order=(3,))) is None
    truth.displacement[:] = 0
    assert evidence(frames_of(truth, True, True)).says is None
    rng = np.random.default_rng(0)
    truth.displacement[:] = rng.normal(0, 5, truth.displacement.shape)
    apart = frames_of(truth, True, False)
    points = [f.position + rng.normal(0, 1, f.position.shape) for f in apart]
    ragged = [Frame(f.path, f.name, p, f.displacement) for f, p in zip(apart, points, strict=True)]
    assert evidence(ragged).says is None


@pytest.mark.parametrize("with_ids", [True, False])
def test_positions_other_than_declared_are_refused(truth, write_table, log, holds, said, with_ids):
    """VIC-3D's points are declared to be reference positions, its grid current ones."""
    names = [f"run_{i}" for i in range(4)]
    unit = "" if with_ids else " [mm]"
    header = ",".join(f"{name}{unit}" for name in "XYZUVW") + ",x,y"
    for i, name in enumerate(names):
        moved = truth.displacement[i]
        rows = np.hstack([truth.reference + with_ids * moved, moved, truth.pixels])
        folder = write_table(f"{name}.csv", header, rows)
    table = str(log(names))
    by_numbers, declared = ("current", "reference") if with_ids else ("reference", "current")
    assert READERS["vic3d" if with_ids else "vic3d-grid"].positions == declared
    with pytest.raises(
        InputError, match=f"by the numbers, not {declared} as vic3d.*declares; give"
    ):
        read_test(folder, pressure=table, **SPECIMEN)
    holds(read_test(folder, pressure=table, positions=by_numbers, **SPECIMEN))
    read_test(folder, pressure=table, positions=declared, say=said.append, **SPECIMEN)
    assert any(f"by the numbers, not {declared}, as was asked for" in line for line in said)
    with pytest.raises(InputError, match="--positions up: is not one of reference, current"):
        read_test(folder, pressure=table, positions="up", **SPECIMEN)


# ---- joins ----


def test_points_are_joined_by_id_where_positions_scatter(truth):
    rng = np.random.default_rng(1)
    frames = frames_of(truth, False, True)
    for frame in frames:
        frame.position[:] += rng.normal(0, 0.02, frame.position.shape)
    placed, by, count = joined(frames, "reference")
    assert (by, count) == ("id", 81)
    for reference, _ in placed[1:]:
        np.testing.assert_array_equal(reference, placed[0][0])


def test_ids_that_count_anew_in_each_frame_are_no_ids(truth):
    """As rows would be if a grid left out its lost points."""
    frames = []
    for i, kept in enumerate((slice(0, 81), slice(1, 81))):
        number = np.arange(81)[kept][:, None] - kept.start
        frames.append(
            Frame(None, str(i), truth.reference[kept], truth.displacement[i][kept], number)
        )
    placed, by, count = joined(frames, "reference")
    assert (by, count) == ("position", 81)
    np.testing.assert_array_equal(placed[1][0], placed[0][0][1:])


def test_ids_that_come_twice_are_no_ids(truth):
    frames = frames_of(truth, False, True)
    frames[1].ids[3] = frames[1].ids[4]
    _, by, count = joined(frames, "reference")
    assert (by, count) == ("position", 81)


def test_points_that_come_and_go_are_joined_by_position(truth):
    frames = []
    for i, kept in enumerate((slice(0, 60), slice(20, 81), slice(0, 81, 2), slice(80, None, -1))):
        current = truth.reference + truth.displacement[i]
        # the rounding of an export with six digits
        position = np.array([[float(f"{v:.6g}") for v in row] for row in current])
        frames.append(Frame(None, str(i), position[kept], truth.displacement[i][kept]))
    placed, by, count = joined(frames, "current")
    assert (by, count) == ("position", 81)
    assert len(np.unique(np.concatenate([points for points, _ in placed]), axis=0)) == 81


def test_frames_with_points_of_their_own_stay_apart(truth):
    rng = np.random.default_rng(2)
    frames = frames_of(truth, False, False)
    for frame in frames:
        frame.position[:] += rng.uniform(-3, 3, frame.position.shape)
    placed, by, count = joined(frames, "reference")
    assert (by, count) == ("nothing", 4 * 81)
    for frame, (reference, _) in zip(frames, placed, strict=True):
        np.testing.assert_array_equal(reference, frame.position)


# ---- what a test is read from ----


def test_a_list_a_pattern_and_a_folder_are_one_test(truth, write_table, log, holds):
    names = [f"run_{i}" for i in range(4)]
    for i, name in enumerate(names):
        rows = np.hstack([truth.reference, truth.displacement[i], truth.pixels])
        folder = write_table(f"{name}.csv", "X,Y,Z,U,V,W,x,y", rows)
    options = {"pressure": str(log(names)), **SPECIMEN}
    tests = [
        read_test(folder, **options),
        read_test(str(folder / "run_*.csv"), **options),
        read_test([folder / f"{name}.csv" for name in names], **options),
    ]
    # a log beside the files is found, one of other frames is passed over
    log(names, folder="frames")
    (folder / "other.csv").write_text("file,p_bar\nelse_1,3\n")
    tests.append(read_test(str(folder / "run_*.csv"), **SPECIMEN))
    (folder / "loads.csv").replace(folder.parent / "loads.csv")
    (folder / "other.csv").unlink()
    for test in tests:
        holds(test)
        assert test.name == "frames"
    assert len({test.checksum for test in tests[:3]}) == 1
    (folder / "test.json").write_text('{"radius": 90, "thickness": 0.5, "name": "cloth"}')
    test = read_test(folder, pressure=options["pressure"])
    assert (test.radius, test.thickness, test.name) == (90, 0.5, "cloth")
    assert test.checksum != tests[0].checksum


def test_two_systems_in_one_folder(truth, write_table, log):
    rows = np.hstack([truth.reference, truth.displacement[1], truth.pixels])
    write_table("a.csv", "X,Y,Z,U,V,W,x,y", rows)
    folder = write_table("b.csv", "x,y,z,displacement_x,displacement_y,displacement_z,a,b", rows)
    with pytest.raises(InputError, match="may be of the formats gom, vic3d; name one with --form"):
        read_test(folder, **SPECIMEN)


def test_things_that_are_no_test(tmp_path):
    with pytest.raises(InputError, match="no such file or folder"):
        source_of(tmp_path / "*.csv")
    with pytest.raises(InputError, match="no files: give a file"):
        source_of([])
    with pytest.raises(InputError, match=r"a.csv: no such file"):
        source_of([tmp_path / "a.csv"])
    (tmp_path / "a.csv").write_text("q\n1\n")
    (tmp_path / "b.csv").write_text("q\n1\n")
    with pytest.raises(InputError, match=r"not a .* of a known format"):
        read_test([tmp_path / "a.csv", tmp_path / "b.csv"], **SPECIMEN)
    with pytest.raises(InputError, match="the format npz is one path a test"):
        read_test([tmp_path / "a.csv", tmp_path / "b.csv"], format="npz", **SPECIMEN)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(InputError, match="is not a regular file"):
        read_test(tmp_path / "pipe.npz")
    (tmp_path / "frames").mkdir()
    os.mkfifo(tmp_path / "frames" / "B0001.csv")
    with pytest.raises(InputError, match=r"found B0001.csv"):
        read_test(tmp_path / "frames")
