"""Are text exports of each system read back as what was written, in the layout of the system?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic import read_test
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 1.0}
NAMES = [f"run-{i:04d}_0" for i in range(4)]


def turned(vectors):
    """y down the image and z away from the cameras."""
    return vectors * [1, -1, -1]


# ---- VIC-3D ----

VIC_HEADER = ' "X",  "Y",  "Z",  "U",  "V",  "W",  "exx",  "sigma",  "x",  "y",  "u",  "v"'


def vic_rows(truth, frame, lost=()):
    """Rows as VIC-3D's points: a lost one is all zero, or keeps its numbers, but for sigma."""
    rows = []
    for k, (point, moved, pixel) in enumerate(
        zip(truth.reference, truth.displacement[frame], truth.pixels, strict=True)
    ):
        if k in lost and k % 2:
            rows.append([*np.zeros(7), -1, *pixel, 0, 0])
        else:
            # u, v in pixels are other numbers than U, V in mm
            rows.append([*point, *moved, 1e-3, -1 if k in lost else 0.01, *pixel, 7.7, 8.8])
    return rows


def vic_folder(truth, write_table, lost=None):
    for i, name in enumerate(NAMES):
        rows = vic_rows(truth, i, (lost or {}).get(i, ()))
        folder = write_table(f"{name}.csv", VIC_HEADER, rows)
    return folder


def test_vic3d_points(truth, write_table, log, holds, said):
    folder = vic_folder(truth, write_table, lost={1: (3, 4), 2: (5,)})
    table = log([f"{name}.tif" for name in NAMES])
    test = read_test(folder, pressure=str(table), say=said.append, **SPECIMEN)
    holds(test, lost=((1, 3), (1, 4), (2, 5)))
    assert said == [
        "vic3d: 4 frames of VIC-3D, points (CSV), reference positions",
        "lengths state no unit and are taken as mm; --length-unit gives another",
        "79 to 81 points a frame, joined by id; 3 marked as lost (sigma -1, or a row of zeros) "
        "left out",
        "pressure from 'pressure [bar]' of loads.csv, found by file names in its column 'file'",
    ]


def test_vic3d_never_folds_case(truth, write_table, log):
    """Without X, Y, Z the columns x, y (pixels) and u, v are not taken for them."""
    rows = vic_rows(truth, 0)
    folder = write_table("a.csv", VIC_HEADER.replace('"X"', '"A"'), rows)
    with pytest.raises(InputError, match="none of its files is of a format"):
        read_test(folder, **SPECIMEN)


def test_vic3d_grid(truth, write_table, log, holds):
    header = '"X [mm]","Y [mm]","Z [mm]","U [mm]","V [mm]","W [mm]","exx"'
    for i, name in enumerate(NAMES):
        rows = [
            [*(point + moved), *moved, 0.1]
            for point, moved in zip(truth.reference, truth.displacement[i], strict=True)
        ]
        if i == 2:
            rows[7] = [""] * 7
        folder = write_table(f"{name}.csv", header, rows)
    test = read_test(folder, pressure=str(log(NAMES)), **SPECIMEN)
    holds(test, lost=((2, 7),))


def test_vic3d_points_with_units(truth, write_table, log, holds):
    """Decimal commas below a line of its own, an index, and sigma in pixels as the mark."""
    header = (
        '"Index [1]";"X [mm]";"Y [mm]";"Z [mm]";"U [mm]";"V [mm]";"W [mm]";"Sigma_X [mm]";'
        '"sigma [pixel]"'
    )
    for i, name in enumerate(NAMES):
        moved = truth.displacement[i]
        rows = np.column_stack(
            [np.arange(81), truth.reference + moved, moved, np.full((81, 2), 0.01)]
        )
        if i == 2:
            rows[7, 8], rows[9] = -1, [9, *np.zeros(7), -1]
        if i == 3:
            rows[11, 1:] = 0
        folder = write_table(
            f"{name}.csv", header, rows, separator=";", decimal=",", preamble='"Area 0"\n'
        )
    test = read_test(folder, pressure=str(log(NAMES)), **SPECIMEN)
    holds(test, lost=((2, 7), (2, 9), (3, 11)))


def test_vic3d_in_metres(truth, write_table, log, holds):
    header = '"X [m]","Y [m]","Z [m]","U [mm]","V [mm]","W [mm]"'
    for i, name in enumerate(NAMES):
        moved = truth.displacement[i]
        rows = np.hstack([(truth.reference + moved) * 1e-3, moved])
        folder = write_table(f"{name}.csv", header, rows)
    holds(read_test(folder, pressure=str(log(NAMES)), **SPECIMEN))


def test_a_unit_of_length_that_is_not_stated(truth, write_table, log, holds, said):
    for i, name in enumerate(NAMES):
        rows = np.array(vic_rows(truth, i))
        rows[:, :6] *= 1e-3
        folder = write_table(f"{name}.csv", VIC_HEADER, rows)
    table = str(log(NAMES))
    holds(read_test(folder, pressure=table, length_unit="m", say=said.append, **SPECIMEN))
    assert not any("state no unit" in line for line in said)
    with pytest.raises(InputError, match="--length-unit has the unit 'inch'"):
        read_test(folder, pressure=table, length_unit="inch", **SPECIMEN)


# ---- DaVis ----

DAVIS_HEADER = (
    "x [mm];y [mm];z [mm];X-displacement [mm];Y-displacement [mm];Z-displacement [mm];"
    "Maximum shear angle [°];Height [mm]"
)


def davis_rows(truth, frame, lost=()):
    both = zip(truth.reference, truth.displacement[frame], strict=True)
    return [[*p, *u, 45, p[2] + u[2]] for k, (p, u) in enumerate(both) if k not in lost]


@pytest.mark.parametrize(
    ("encoding", "decimal"),
    [("latin-1", "."), ("cp1252", ","), ("utf-8", ","), ("utf-8-sig", "."), ("utf-16", ",")],
)
def test_davis_csv(truth, write_table, log, holds, encoding, decimal):
    for i in range(4):
        folder = write_table(
            f"B{i + 1:04d}.csv",
            DAVIS_HEADER,
            davis_rows(truth, i, lost=(10, 20) if i == 3 else ()),
            separator=";",
            decimal=decimal,
            encoding=encoding,
        )
    table = str(log([f"B{i:04d}" for i in (1, 2, 3, 4)]))
    holds(read_test(folder, pressure=table, **SPECIMEN), lost=((3, 10), (3, 20)))


def test_davis_with_other_names_of_its_columns(truth, write_table, log, holds):
    header = "x[mm];y[mm];z[mm];x-displacement[mm];y-displacement[mm];z-displacement[mm]"
    for i, name in enumerate(NAMES):
        rows = np.hstack([truth.reference, truth.displacement[i]])
        folder = write_table(f"{name}.csv", header, rows, separator=";")
    holds(read_test(folder, pressure=str(log(NAMES)), **SPECIMEN))


def test_davis_cells_outside_the_mask(truth, write_table, log, holds):
    """They keep x and y, with zeros in all else; a flat fabric at rest is none of these."""
    flat = truth.reference * [1, 1, 0]
    for i, name in enumerate(NAMES):
        rows = np.hstack([flat, truth.displacement[i] * (i > 0)])
        rows[5, 2:] = 0
        folder = write_table(f"{name}.csv", DAVIS_HEADER.split(";Max")[0], rows, separator=";")
    truth.reference, truth.displacement[0] = flat, 0
    test = read_test(folder, pressure=str(log(NAMES)), **SPECIMEN)
    holds(test, lost=((1, 5), (2, 5), (3, 5)))


def test_davis_load_file(truth, write_table, holds):
    """Two rows of header, image numbers in few of many rows, and times in ms."""
    for i in range(4):
        folder = write_table(f"B{i + 1:04d}.csv", DAVIS_HEADER, davis_rows(truth, i), separator=";")
    lines = ["Time;Image index (Image index);Pressure ADC channel 1", "ms;;kPa"]
    for k in range(40):
        image = {5: "1", 13: "2", 22: "3", 39: "4"}.get(k, "")
        pressure = truth.pressure[int(image) - 1] * 1e3 if image else 999
        lines.append(f"{100 * k:.3f};{image};{pressure:.6f}")
    (folder / "load.csv").write_text("\n".join(lines) + "\n")
    test = read_test(folder, **SPECIMEN)
    holds(test)
    np.testing.assert_allclose(test.time, [0.5, 1.3, 2.2, 3.9])


def tecplot(truth, frame, invalid=()):
    names = ["x", "y", "z", "X-displacement", "Y-displacement", "Z-displacement"]
    lines = [
        'TITLE = "B0001"',
        "VARIABLES = " + ", ".join(f'"{name} [mm]"' for name in names) + ', "isValid"',
        'ZONE T="Frame 0", I=9, J=9, F=POINT',
    ]
    both = zip(truth.reference, truth.displacement[frame], strict=True)
    for k, (point, moved) in enumerate(both):
        row = [*np.zeros(6), 0] if k in invalid else [*point, *moved, 1]
        lines.append(" ".join(f"{value:.9g}" for value in row))
    return "\n".join(lines) + "\n"


def test_davis_tecplot(truth, tmp_path, log, holds):
    (tmp_path / "frames").mkdir()
    for i in range(4):
        path = tmp_path / "frames" / f"B{i + 1:04d}.dat"
        path.write_text(tecplot(truth, i, invalid=(2,) if i == 1 else ()))
    table = log([f"B{i:04d}" for i in (1, 2, 3, 4)])
    holds(read_test(tmp_path / "frames", pressure=str(table), **SPECIMEN), lost=((1, 2),))
    for bad, match in (("1 2 x 4 5 6 1", "line 4 holds something"), ("1 2", "has 2 numbers for 7")):
        lines = tecplot(truth, 3).split("\n")
        path.write_text("\n".join([*lines[:3], bad, *lines[3:]]))
        with pytest.raises(InputError, match=rf"B0004.dat: line 4.*|{match}"):
            read_test(tmp_path / "frames", pressure=str(table), **SPECIMEN)


# ---- MatchID ----


@pytest.mark.parametrize(
    "header",
    [
        "x_pic,y_pic,x,y,z,u,v,w,exx",
        "Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],coor.X [mm],coor.Y [mm],"
        "coor.Z [mm],disp.Horizontal Displacement U [mm],disp.Vertical Displacement V [mm],"
        "disp.Out-Of-Plane: W [mm],strain.Strain-global frame: Exx [ ]",
        "Image X[Pixel],Image Y[Pixel],X[mm],Y[mm],Z[mm],Horizontal Displacement U[mm],"
        "Vertical Displacement V[mm],Out-Of-Plane: W[mm],Strain-global frame: Exx[ ]",
    ],
)
def test_matchid(truth, write_table, log, holds, header, said):
    for i in range(4):
        moved = truth.displacement[i]
        rows = np.column_stack(
            [truth.pixels, turned(truth.reference + moved), turned(moved), np.zeros(81)]
        )
        rows[8, 2:] = 0 if i == 2 else rows[8, 2:]
        # the order of the points is another one in each frame
        folder = write_table(f"Image_{i:04d}_0.tiff.csv", header, rows[np.roll(range(81), i)])
    table = str(log([rf"C:\grab\Image_{i:04d}_0.tiff" for i in range(4)]))
    holds(read_test(folder, pressure=table, say=said.append, **SPECIMEN), lost=((2, 8),))
    assert "y and z change sign: the file's y runs down the image" in said


def test_axes_that_a_user_has_turned_are_left(truth, write_table, log, holds, said):
    """MatchID's y runs down; where the rows of the image say that it does not, it is kept."""
    for i in range(4):
        moved = truth.displacement[i]
        rows = np.column_stack([truth.pixels, truth.reference + moved, moved])
        folder = write_table(f"a_{i}.csv", "x_pic,y_pic,x,y,z,u,v,w", rows)
    table = str(log([f"a_{i}" for i in range(4)]))
    holds(read_test(folder, pressure=table, say=said.append, **SPECIMEN))
    assert not any("change sign" in line for line in said)


# ---- ARAMIS and GOM Correlate ----

NODEMAP = """\
# Process data:
# calibration_object            : 175x140mm² (ID: D10601)
# SIGNALS:
# specimen_type                 : value_element       : MT
# force                         : value_element       : 14985.6
# Druck                         : analog_input        : {pressure}
####################
"""
COLUMNS = "#  ID;  x_undef [mm];  y_undef [mm];  z_undef [mm];  u [mm];  v [mm];  w [mm];  epsx [%]"


def test_aramis_nodemap(truth, write_table, holds):
    for i in range(4):
        rows = [
            [f"{k + 1:8d}", *point, *moved, 0.1]
            for k, (point, moved) in enumerate(
                zip(truth.reference, truth.displacement[i], strict=True)
            )
        ]
        if i == 3:
            rows[11][4:7] = ["nan"] * 3
            del rows[2]
        folder = write_table(
            f"Stufe_{i}.txt",
            COLUMNS,
            rows,
            separator="; ",
            encoding="cp1252",
            preamble=NODEMAP.format(pressure=truth.pressure[i] * 10),
        )
    with pytest.raises(InputError, match="the unit of 'Druck' is not stated; give it, such as"):
        read_test(folder, **SPECIMEN)
    holds(read_test(folder, pressure_unit="bar", **SPECIMEN), lost=((3, 2), (3, 11)))


def test_aramis_section(truth, write_table, log, holds):
    """Decimal commas, and two blanks between the cells."""
    header = "Index  x_undef [mm]  y_undef [mm]  z_undef [mm]  x [mm]  y [mm]  z [mm]"
    for i, name in enumerate(NAMES):
        both = zip(truth.reference, truth.displacement[i], strict=True)
        rows = [[f"{k}", *point, *(point + moved)] for k, (point, moved) in enumerate(both)]
        folder = write_table(
            f"{name}.txt", header, rows, separator="  ", decimal=",", encoding="cp1252"
        )
    holds(read_test(folder, pressure=str(log(NAMES)), **SPECIMEN))


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ",")])
def test_gom_correlate(truth, write_table, log, holds, separator, decimal):
    """Current positions below five lines of preamble, and a column that is written twice."""
    names = "id,x,y,z,displacement_x,displacement_y,displacement_z,x".replace(",", separator)
    for i, name in enumerate(NAMES):
        both = zip(truth.reference, truth.displacement[i], strict=True)
        rows = [[f"{k}", *(p + u), *u, p[0] + u[0]] for k, (p, u) in enumerate(both)]
        folder = write_table(
            f"{name}.csv",
            names,
            rows if i != 1 else rows[:-1],
            separator=separator,
            decimal=decimal,
            preamble="GOM Correlate\nproject\nstage 1\n\nsurface component\n",
        )
    holds(read_test(folder, pressure=str(log(NAMES)), **SPECIMEN), lost=((1, 80),))
    rows[5][-1] += 1
    write_table(f"{name}.csv", names, rows, separator=separator, decimal=decimal)
    with pytest.raises(InputError, match="has 2 columns 'x' that differ"):
        read_test(folder, pressure=str(log(NAMES)), **SPECIMEN)


# ---- DICe ----

DICE = (
    "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,MODEL_COORDINATES_X,"
    "MODEL_COORDINATES_Y,MODEL_COORDINATES_Z,MODEL_DISPLACEMENT_X,MODEL_DISPLACEMENT_Y,"
    "MODEL_DISPLACEMENT_Z,SIGMA,MATCH"
)


@pytest.mark.parametrize("preamble", ["", "***\n*** Digital Image Correlation\n" * 10])
def test_dice_stereo(truth, write_table, log, holds, preamble):
    for i in range(4):
        rows = np.column_stack(
            [
                *(np.arange(81), truth.pixels, np.ones((81, 2)), turned(truth.reference)),
                *(turned(truth.displacement[i]), np.full(81, 4e-3), np.zeros(81)),
            ]
        )
        if i == 2:
            rows[4, 11], rows[9, 12] = -1, -1
        folder = write_table(f"DICe_solution_{i}.txt", DICE, rows, preamble=preamble)
    table = str(log([str(i) for i in range(4)], header="image number,pressure [bar]"))
    holds(read_test(folder, pressure=table, **SPECIMEN), lost=((2, 4), (2, 9)))


def test_dice_in_the_plane_is_refused(write_table):
    header = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA"
    folder = write_table("DICe_solution_0.txt", header, [[0, 5, 5, 0, 0, 0.01]])
    with pytest.raises(InputError, match=r"solution_0.txt: has no MODEL_.*needs a stereo solution"):
        read_test(folder, **SPECIMEN)


# ---- any other table ----


def test_a_table_whose_columns_are_told(truth, write_table, log, holds):
    for i, name in enumerate(NAMES):
        rows = np.hstack([truth.reference, truth.displacement[i]])
        folder = write_table(f"{name}.txt", "a\tb\tc\td [mm]\te\tf", rows, separator="\t")
    columns = dict(zip(("x", "y", "z", "dx", "dy", "dz"), "abcdef", strict=True))
    options = {"format": "table", "pressure": str(log(NAMES)), **SPECIMEN}
    holds(read_test(folder, columns=columns, **options))
    with pytest.raises(InputError, match=r"run-0000_0.txt: has no line with the columns x, y, z"):
        read_test(folder, **options)
    with pytest.raises(InputError, match="--columns: unknown 'w'"):
        read_test(folder, columns={"w": "a"}, **options)


# ---- cells that cannot be ----


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda text: text.replace("0.01,", "0.01x,", 1), "line 2, column.*not a number"),
        (lambda text: text.replace('"X"', '"X [furlong]"'), "'X .furlong.' has the unit"),
        (
            lambda text: text[: len(text) // 2].rsplit(",", 3)[0],
            "line [0-9]+ ends before the column",
        ),
        (lambda text: text.replace("\n", "\n1,", 1), "line 2 has 13 cells, the header 12"),
    ],
)
def test_damaged_exports_are_named_by_file_and_line(truth, write_table, log, change, match):
    folder = vic_folder(truth, write_table)
    path = folder / "run-0002_0.csv"
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=f"run-0002_0.csv: {match}") as caught:
        read_test(folder, pressure=str(log(NAMES)), format="vic3d", **SPECIMEN)
    assert "\n" not in str(caught.value)
