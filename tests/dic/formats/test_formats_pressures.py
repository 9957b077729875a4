"""Does each frame get its own pressure, in a unit that somebody stated?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic import read_test
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 1.0}
HEADER = "x_pic,y_pic,x,y,z,u,v,w"
NAMES = [f"run-{i:04d}_0" for i in range(4)]


@pytest.fixture
def frames(truth, write_table):
    """Write MatchID frames of given names, with a further column of one number a frame."""

    def write(names=NAMES, column: str = "", values=None):
        for i, name in enumerate(names):
            moved = truth.displacement[i]
            rows = np.column_stack([truth.pixels, truth.reference + moved, moved])
            if column:
                rows = np.column_stack([rows, np.full(81, values[i])])
            folder = write_table(f"{name}.csv", HEADER + (f",{column}" if column else ""), rows)
        return folder

    return write


def write_log(folder, lines, name="log.csv"):
    (folder / name).write_text("\n".join(lines) + "\n")


def row(name, *values):
    return ",".join([name, *(f"{value:.9g}" for value in values)])


# ---- logs ----


def test_vic_snap_log_is_joined_by_file_names(truth, frames, holds, said):
    """Rows of calibration images shift every count."""
    folder = frames()
    images = ["a-cal-0001_0.tif", "a-cal-0002_0.tif", *(f"{name}.tif" for name in NAMES)]
    volts = [9.9, 9.9, *(truth.pressure * 10 / 2.5)]
    lines = ["Count,Filename_0_1,Time_0_1,Dev1/ai0,Dev1/ai1"]
    both = enumerate(zip(images, volts, strict=True))
    lines += [row(f"{i},{file}", i + 0.5, v, 0) for i, (file, v) in both]
    write_log(folder, lines)
    with pytest.raises(
        InputError, match=r"log.csv: which of its columns.*'Dev1/ai0'.*--pressure-c"
    ):
        read_test(folder, **SPECIMEN)
    with pytest.raises(InputError, match=r"the unit of 'Dev1/ai0' is not stated; give it"):
        read_test(folder, pressure_column="Dev1/ai0", **SPECIMEN)
    options = {"pressure_column": "Dev1/ai0", "pressure_unit": "2.5bar/V", "say": said.append}
    holds(read_test(folder, **options, **SPECIMEN))
    assert said[-1] == (
        "pressure from 'Dev1/ai0' of log.csv, found by file names in its column 'Filename_0_1'"
    )


@pytest.mark.parametrize(("export", "image"), [("", "_0.tif"), ("_0", ".tif"), ("", "_1.tif")])
def test_the_number_of_the_camera_may_be_left_out(truth, frames, holds, export, image):
    names = [f"run-{i:04d}" for i in range(4)]
    folder = frames([f"{name}{export}" for name in names])
    lines = [row(f"{n}{image}", p * 10) for n, p in zip(names, truth.pressure, strict=True)]
    write_log(folder, ["Filename_0_1,p_bar", *lines])
    holds(read_test(folder, **SPECIMEN))


def test_steps_are_not_taken_for_cameras(frames):
    folder = frames([f"step_{i}" for i in range(4)])
    write_log(folder, ["file,p_bar", row("step", 1), row("step_2", 2)])
    with pytest.raises(InputError, match="has no row for 3 of 4 frames, first 'step_0'"):
        read_test(folder, **SPECIMEN)


def test_matchid_image_csv(truth, frames, holds):
    folder = frames([f"Image_{i:04d}_0.tiff" for i in range(4)])
    lines = ["File;TimeStamp;Pressure [V]; Pressure [bar]"]
    lines += [
        rf"C:\grab\run\Image_{i:04d}_0.tiff;{789 + i}.5;{p * 4:.9g};{p * 10:.9g}"
        for i, p in enumerate(truth.pressure)
    ]
    write_log(folder, lines, "Image.csv")
    holds(read_test(folder, **SPECIMEN))


def test_decimal_commas_and_latin_letters_in_a_log(truth, frames, holds):
    folder = frames()
    lines = ["Dateiname;Überdruck [mbar];Kraft [kN]"]
    lines += [
        f"{name}.tif;{p * 1e4:.3f};1,5".replace(".", ",").replace(",tif", ".tif")
        for name, p in zip(NAMES, truth.pressure, strict=True)
    ]
    (folder / "log.txt").write_bytes(("\n".join(lines) + "\n").encode("latin-1"))
    holds(read_test(folder, **SPECIMEN))


def test_image_numbers(truth, frames, holds):
    folder = frames()
    lines = ["Index;Pressure [kPa]", "7;55"]
    lines += [f"{i};{p * 1e3:.9g}" for i, p in reversed([*enumerate(truth.pressure)])]
    write_log(folder, lines)
    holds(read_test(folder, **SPECIMEN))
    write_log(folder, [*lines, "3;1"])
    with pytest.raises(InputError, match="'Index' has 3 in 2 rows, for the frame 'run-0003_0'"):
        read_test(folder, **SPECIMEN)
    write_log(folder, lines[:-1])
    with pytest.raises(InputError, match="'Index' has no 0, for the frame 'run-0000_0'"):
        read_test(folder, **SPECIMEN)


def test_names_that_do_not_tell_their_number(frames):
    folder = frames(["a_1_x", "b_2_x", "c_3_x", "d_4_x"])
    write_log(folder, ["Index;p [bar]", "1;0", "2;1", "3;1", "4;1"])
    with pytest.raises(InputError, match="numbers the images, but the names of the frames"):
        read_test(folder, **SPECIMEN)


def test_a_table_without_names_has_a_row_for_each_frame(truth, frames, tmp_path, holds):
    folder, table = frames(), tmp_path / "p.csv"
    table.write_text("pressure_bar,note\n" + "".join(f"{p * 10:.9g},x\n" for p in truth.pressure))
    holds(read_test(folder, pressure=str(table), **SPECIMEN))
    table.write_text("pressure_bar,note\n0,x\n1,x\n")
    with pytest.raises(InputError, match="it has 2 rows for 4 frames; add a column `file`"):
        read_test(folder, pressure=str(table), **SPECIMEN)
    with pytest.raises(InputError, match="no such file; --pressure is a table, or `names`"):
        read_test(folder, pressure=str(tmp_path / "q.csv"), **SPECIMEN)


@pytest.mark.parametrize(
    ("lines", "match"),
    [
        (["file,p_bar", "run-0000_0.tif,1"], "has no row for 3 of 4 frames, first 'run-0001_0'"),
        (["file,p_bar", *(f"{n},1" for n in (*NAMES, NAMES[0]))], "names 'run-0000_0' twice"),
        (["file,q_bar", *(f"{n},1" for n in NAMES)], r"^(?!.*which).*"),
        (["file,force [N]", *(f"{n},1" for n in NAMES)], "which of its columns is the pressure"),
        (["file,p1_bar,p2_bar", *(f"{n},1,2" for n in NAMES)], "which of these is the pressure"),
        (["file,pressure", *(f"{n},1" for n in NAMES)], "unit of 'pressure' is not stated"),
    ],
)
def test_logs_that_do_not_tell(frames, lines, match):
    folder = frames()
    write_log(folder, lines)
    if match.startswith("^"):
        assert read_test(folder, **SPECIMEN).pressure.tolist() == pytest.approx([0.1] * 4)
        return
    with pytest.raises(InputError, match=match):
        read_test(folder, **SPECIMEN)


def test_two_logs(frames):
    folder = frames()
    for name in ("a.csv", "b.csv"):
        write_log(folder, ["file,p_bar", *(f"{n},1" for n in NAMES)], name)
    with pytest.raises(InputError, match=r"has several logs, a.csv, b.csv; name one with --press"):
        read_test(folder, **SPECIMEN)


def test_notes_beside_the_frames_are_no_log(truth, frames, holds):
    folder = frames([f"a_{p * 10:g}bar" for p in truth.pressure])
    notes = "Exported by hand, one file a stage, index from 0.\nCloth 7, warp along x.\n"
    (folder / "notes.txt").write_text(notes)
    (folder / "index.txt").write_text("files, in order\n\nsee above, below\n")
    holds(read_test(folder, **SPECIMEN))


# ---- units ----


@pytest.mark.parametrize(
    ("column", "unit", "scale"),
    [
        ("pressure [bar]", None, 10),
        ("pressure (kPa)", None, 1e3),
        ("pressure_mbar", None, 1e4),
        ("pressure", "Pa", 1e6),
        ("pressure [V]", "4bar/V", 2.5),
        ("pressure [N/mm²]", None, 1),
        ("pressure (N/mm2)", None, 1),
        ("pressure", "N/mm²", 1),
        ("pressure [Bar]", None, 10),
        ("pressure [Bar]", "bar", 10),
        ("pressure [psig]", None, 25.4**2 / 4.4482216152605),
        ("pressure [bar]", "kPa", 1e3),  # the user knows better than the header
        ("pressure [bar]", "2.5bar", 4),
        ("pressure [bar]", "100kPa/bar", 10),
    ],
)
def test_units_of_pressure(truth, frames, holds, column, unit, scale):
    folder = frames()
    values = truth.pressure * scale
    write_log(folder, [f"file,{column}", *map(row, NAMES, values)])
    holds(read_test(folder, pressure_unit=unit, **SPECIMEN))


@pytest.mark.parametrize(
    ("unit", "match"),
    [
        (None, r"'p \[V\]' is in V, which is no pressure; give what one V is worth, such as"),
        ("bar", r"'p \[V\]' is in V, not in bar; give what one V is worth"),
        ("2bar/N", r"'p \[V\]' is in V, not in 2bar/N"),
        ("torr", "--pressure-unit torr: is not one of MPa"),
        ("2", "--pressure-unit 2: is not one of"),
        ("e--bar", "--pressure-unit e--bar: is not one of"),
    ],
)
def test_units_that_are_not_stated_or_not_known(frames, unit, match):
    folder = frames()
    write_log(folder, ["file,p [V]", *(f"{name},1" for name in NAMES)])
    with pytest.raises(InputError, match=match):
        read_test(folder, pressure_unit=unit, **SPECIMEN)


def test_what_a_volt_is_worth_is_refused_of_a_column_in_bar(frames):
    folder = frames()
    write_log(folder, ["file,pressure [bar]", *(f"{name},1" for name in NAMES)])
    match = r"'pressure \[bar\]' is in bar, not in V; leave .* out, or give 2.5bar if"
    with pytest.raises(InputError, match=match):
        read_test(folder, pressure_unit="2.5bar/V", **SPECIMEN)


def test_volts_that_are_named_bar_are_noticed(truth, frames, holds, said):
    """MatchID 2024 writes the volts of an input under the unit of what it measures."""
    volts = truth.pressure * 4
    folder = frames(column="ext.Pressure [bar]", values=volts)
    log = ["file;Pressure [V];Pressure [bar]"]
    log += [f"{n};{v:.9g};{v * 2.5:.9g}" for n, v in zip(NAMES, volts, strict=True)]
    write_log(folder, log)
    holds(read_test(folder, say=said.append, **SPECIMEN))
    assert "'ext.Pressure [bar]' of" in said[-1]
    assert "holds the V of 'Pressure [V]' and is not used" in said[-1]


def test_volts_that_are_named_newtons_are_noticed(truth, frames, holds):
    """A load cell whose force is the pressure on its plate, exported as MatchID 2024 does."""
    volts = truth.pressure * 4 + 0.1
    folder = frames(column="ext.Force [N]", values=volts)
    write_log(folder, ["File,Force [V],Force [N]", *map(row, NAMES, volts, (volts - 0.1) * 250)])
    options = {"pressure_unit": "0.01bar/N", **SPECIMEN}
    with pytest.raises(
        InputError, match=r"hold the same numbers, in N and in V, and 'Force .N.' of"
    ):
        read_test(folder, pressure_column="ext.Force [N]", **options)
    holds(read_test(folder, pressure_column="Force [N]", **options))


def test_columns_that_contradict_are_refused(truth, frames, holds):
    volts = truth.pressure * 4
    folder = frames(column="ext.Pressure [bar]", values=truth.pressure * 10 + 0.1)
    write_log(folder, ["file,Pressure [bar]", *map(row, NAMES, volts)])
    with pytest.raises(InputError, match="are both in bar and differ; say which holds"):
        read_test(folder, **SPECIMEN)
    frames()
    write_log(folder, ["file,Pressure [bar],ai0 [V]", *map(row, NAMES, volts, volts)])
    with pytest.raises(InputError, match="hold the same numbers, in bar and in V, so one unit is"):
        read_test(folder, **SPECIMEN)
    holds(read_test(folder, pressure_column="ai0", pressure_unit="2.5bar/V", **SPECIMEN))


# ---- in the frames, and in their names ----


def test_a_column_of_the_frames(truth, frames, holds, said):
    folder = frames(column="ext.Pressure [mbar]", values=truth.pressure * 1e4)
    holds(read_test(folder, say=said.append, **SPECIMEN))
    assert said[-1] == "pressure from 'ext.Pressure [mbar]' in the frames"


def test_times_of_the_frames(truth, frames):
    folder = frames(column="ext.Time [s]", values=[0.5, 1.5, 2.5, 9])
    write_log(folder, ["file,p_bar", *map(row, NAMES, truth.pressure * 10)])
    assert read_test(folder, **SPECIMEN).time.tolist() == [0.5, 1.5, 2.5, 9]


@pytest.mark.parametrize(
    ("text", "match"), [("", "is empty"), ("a,b\n1,2\n", "is not of the frames' format")]
)
def test_a_file_that_should_be_a_frame_is_missed(truth, frames, text, match):
    folder = frames()
    names = [*NAMES, "run-0004_0"]
    write_log(folder, ["file,p_bar", *map(row, names, [*(truth.pressure * 10), 3])])
    (folder / "run-0004_0.csv").write_text(text)
    with pytest.raises(InputError, match=rf"run-0004_0.csv: {match}, but is named as the frames"):
        read_test(folder, **SPECIMEN)


def test_files_that_are_neither_frames_nor_logs_are_named(truth, frames, holds, said):
    folder = frames()
    write_log(folder, ["file,p_bar", *map(row, NAMES, truth.pressure * 10)])
    write_log(folder, ["clamped by hand"], "remarks.csv")
    write_log(folder, ["clamped by hand"], "remarks.md")
    holds(read_test(folder, say=said.append, **SPECIMEN))
    assert "no frames and no logs, left out: remarks.csv" in said


def test_any_column_of_the_frames_that_is_asked_for(truth, frames, holds):
    folder = frames(column="channel 3", values=truth.pressure * 10)
    with pytest.raises(InputError, match="no pressure found in a log beside the frames"):
        read_test(folder, **SPECIMEN)
    holds(read_test(folder, pressure_column="channel 3", pressure_unit="bar", **SPECIMEN))
    with pytest.raises(InputError, match="column 'w' is not one number all through"):
        read_test(folder, pressure_column="w", pressure_unit="bar", **SPECIMEN)


def test_names_of_the_frames(truth, frames, holds):
    names = [f"cloth2_{p * 10:g}bar_0" for p in truth.pressure]
    folder = frames(names)
    holds(read_test(folder, **SPECIMEN))
    holds(read_test(folder, pressure="names", **SPECIMEN))
    with pytest.raises(InputError, match="no pressure found"):
        read_test(folder, pressure_column="q", **SPECIMEN)
    with pytest.raises(InputError, match="--pressure names: names have no column; leave"):
        read_test(folder, pressure="names", pressure_column="q", **SPECIMEN)


def test_names_that_tell_another_unit_than_was_asked_for(truth, frames, holds):
    folder = frames([f"cloth2_{p * 10:g}bar_0" for p in truth.pressure])
    holds(read_test(folder, pressure_unit="bar", **SPECIMEN))
    for options in ({}, {"pressure": "names"}):
        with pytest.raises(InputError, match="name 'cloth2_0bar_0' tells the pressure in bar, not"):
            read_test(folder, pressure_unit="mbar", **options, **SPECIMEN)


@pytest.mark.parametrize("where", ["frames", "names"])
def test_a_log_of_forces_leaves_the_pressure_to_what_tells_it(truth, frames, holds, where):
    names = [f"cloth2_{p * 10:g}bar" for p in truth.pressure] if where == "names" else NAMES
    column = "ext.Pressure [mbar]" if where == "frames" else ""
    folder = frames(names, column=column, values=truth.pressure * 1e4)
    write_log(folder, ["file,force [N],time [s]", *(row(name, 7, 3) for name in names)])
    holds(read_test(folder, **SPECIMEN))


def test_names_without_a_pressure_or_with_two(frames):
    folder = frames(["a_0bar", "a_1bar", "a_2bar_3bar", "a_x"])
    with pytest.raises(InputError, match="the name 'a_2bar_3bar' does not tell one pressure"):
        read_test(folder, pressure="names", **SPECIMEN)
    with pytest.raises(InputError, match="no pressure found"):
        read_test(folder, **SPECIMEN)


def test_the_checksum_covers_the_names_that_tell_the_pressures(truth, write_table):
    for i in (1, 2):
        rows = np.hstack([truth.reference, truth.displacement[i], truth.pixels])
        folder = write_table(f"run_{i}bar.csv", "X,Y,Z,U,V,W,x,y", rows)
    before = read_test(folder, **SPECIMEN)
    (folder / "run_2bar.csv").rename(folder / "run_3bar.csv")
    after = read_test(folder, **SPECIMEN)
    assert after.pressure.tolist() != before.pressure.tolist()
    assert after.checksum != before.checksum
