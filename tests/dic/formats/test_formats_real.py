"""Are real exports of the systems read, and are they what their formats declare?"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic import read_test
from bulgefit.dic.formats import dice, matchid, vic3d
from bulgefit.dic.formats.base import Ask
from bulgefit.dic.formats.davis import LAYOUTS as DAVIS
from bulgefit.dic.formats.positions import evidence
from bulgefit.dic.formats.text import read_text
from bulgefit.errors import InputError

SPECIMEN = {"radius": 500.0, "thickness": 1.0}


@pytest.fixture(scope="module")
def vendor() -> Path:
    """Folder of real exports, beside the repository."""
    folder = Path(__file__).resolve().parents[4] / "shared" / "vendor"
    if not folder.is_dir():
        pytest.skip("the real exports of DIC systems (../shared/vendor) are not on this machine")
    return folder


@pytest.mark.parametrize(
    ("files", "layouts", "says"),
    [
        ("vic3d/vic3d_points_*.csv", (vic3d.POINTS,), "reference"),
        ("davis/davis10_B*.csv", DAVIS, "reference"),
        ("matchid/matchid2023_B*.csv", matchid.LAYOUTS, "current"),
        ("dice/DICe_stereo_*.txt", (dice.STEREO,), "reference"),
    ],
)
def test_positions_are_what_the_format_declares(vendor, files, layouts, says):
    frames = [read_text(layouts, path, Ask())[0] for path in sorted(vendor.glob(files))]
    found = evidence(frames)
    assert found is not None
    assert found.says == says
    if says == "current":  # mm; six digits are written
        assert found.current < 1e-4


def table_of(tmp_path, names):
    path = tmp_path / "pressures.csv"
    path.write_text("file,pressure_bar\n" + "".join(f"{n},{i}\n" for i, n in enumerate(names)))
    return str(path)


def test_vic3d(vendor, tmp_path):
    names = [f"vic3d_points_{when}_excerpt" for when in ("init", "final")]
    table = table_of(tmp_path, names)
    test = read_test(vendor / "vic3d", pressure=table, **SPECIMEN)
    # of 562 rows in each file 96 have sigma -1, of which two are not zero
    assert test.n_points == 466
    rows = np.genfromtxt(vendor / "vic3d" / f"{names[1]}.csv", delimiter=",", skip_header=1)
    kept = rows[rows[:, 19] != -1]
    last = test.frame(0)  # `final` comes before `init`
    np.testing.assert_array_equal(np.hstack(last), kept[:, :6])
    assert test.pressure.tolist() == pytest.approx([0.1, 0.0])


def test_davis_with_its_load_file(vendor):
    told: list[str] = []
    with pytest.raises(InputError, match=r"davis10_load.csv: which of its columns is the pressure"):
        read_test(vendor / "davis", **SPECIMEN)
    force = "kilo Newton ADC channel 1"
    with pytest.raises(InputError, match=f"'{force}' is in kN, which is no pressure"):
        read_test(vendor / "davis", pressure_column=force, **SPECIMEN)
    test = read_test(
        vendor / "davis",
        pressure_column=force,
        pressure_unit="1bar/kN",
        say=told.append,
        **SPECIMEN,
    )
    assert any("joined by position into 717" in line for line in told)
    assert test.blocks[0].measured.sum(axis=1).tolist() == [699, 699]
    assert test.time is not None
    assert np.ptp(test.time) > 0


def test_matchid_turns_y_and_z(vendor):
    options = {"pressure_column": "ADC 1 channel 1", "pressure_unit": "-2.5bar/V"}
    told: list[str] = []
    with pytest.raises(InputError, match="pressure of frame 1 is negative"):
        read_test(vendor / "matchid", **options, say=told.append, **SPECIMEN)
    assert "y and z change sign: the file's y runs down the image" in told


def test_dice(vendor, tmp_path):
    table = table_of(tmp_path, [f"DICe_stereo_solution_{i}" for i in (0, 1)])
    test = read_test(vendor / "dice", pressure=table, **SPECIMEN)
    rows = np.genfromtxt(
        vendor / "dice" / "DICe_stereo_solution_1.txt", delimiter=",", skip_header=1
    )
    expected = rows[:, 5:11] * [1, -1, -1, 1, -1, -1]
    np.testing.assert_allclose(np.hstack(test.frame(1)), expected, atol=1e-12)


def test_aramis(vendor):
    test = read_test(
        vendor / "aramis", pressure_column="Kraft", pressure_unit="0.0001bar", **SPECIMEN
    )
    assert test.n_points == 12
    # the force stands twice with different values: what is asked for is taken
    assert test.pressure.tolist() == pytest.approx([15102.5390625e-5])


def test_several_systems_in_one_folder_are_asked_about(vendor, tmp_path):
    for path in vendor.glob("*/*_e*.csv"):
        shutil.copy(path, tmp_path)
    with pytest.raises(InputError, match="may be of the formats davis, matchid, vic3d"):
        read_test(tmp_path, **SPECIMEN)
