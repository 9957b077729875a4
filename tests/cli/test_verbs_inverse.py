"""Do fit, evaluate and crossval keep their promises to scripts, and refuse in one line?"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc
from bulgefit.model.observation import operators
from bulgefit.model.simulation import simulate

TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
MATERIAL = ["--E1", "330", "--E2", "240", "--G12", "30"]
BOUNDS = ["--bounds", "E1=200:500,E2=150:400,G12=10:60"]
VERBS = {
    "fit": BOUNDS,
    "crossval": BOUNDS,
    "evaluate": MATERIAL,
}
REFINE = 2
#: The mesh that the test was made on, and its error with it.
SAME_MESH = ["--refine", "2", "--keep-mesh-error"]


class Code:
    """Unpickled carelessly, it makes a folder."""

    def __reduce__(self):
        return os.mkdir, ("was_run",)


@pytest.fixture(scope="module")
def arrays():
    """A made test: 4 frames of some 130 points, by the mesh that the fits below use."""
    rng = np.random.default_rng(6)
    points = rng.uniform(-90, 90, (200, 2))
    points = points[np.hypot(*points.T) < 90]
    pressure = np.array([0.02, 0.06, 0.12, 0.2])
    mesh = disc(100.0, REFINE)
    seen = operators(mesh, points, "smooth")(simulate(TRUTH, pressure, mesh=mesh).displacement)
    seen += rng.normal(0, [0.005, 0.005, 0.012], seen.shape)
    seen[1, 5] = np.nan
    return {
        "reference": np.column_stack([points, np.zeros(len(points))]),
        "displacement": seen,
        "pressure": pressure,
        "radius": np.float64(100.0),
        "thickness": np.float64(0.81),
        "poisson_ratio": np.float64(0.24),
    }


@pytest.fixture
def folder(arrays, tmp_path, monkeypatch):
    """The working folder, with good.npz and other.npz."""
    monkeypatch.chdir(tmp_path)
    np.savez("good.npz", **arrays)
    np.savez("other.npz", **{**arrays, "displacement": arrays["displacement"] + 0.01})
    return tmp_path


def run(*words):
    return main([str(word) for word in words])


def refused(capsys, folder, message, *words):
    """Status 2, one line that says what is wrong, nothing on stdout, nothing written."""
    before = contents(folder)
    assert run(*words, "--quiet") == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith(f"bulgefit {words[0]}: error: ")
    assert output.err.count("\n") == 1
    assert message in output.err
    assert contents(folder) == before


def contents(folder):
    return {
        path.relative_to(folder): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def changed(**changes):
    """Write bad.npz: the good test with other arrays; None leaves one out."""

    def write(arrays):
        content = {**arrays, **changes}
        np.savez("bad.npz", **{key: value for key, value in content.items() if value is not None})

    return write


def object_array(arrays):
    rows = np.empty(1, dtype=object)
    rows[0] = Code()
    return rows


def pickled(name):
    def write(arrays):
        if name.endswith(".npz"):
            np.savez(name, **{**arrays, "pressure": object_array(arrays)})
        else:
            np.save(name, object_array(arrays), allow_pickle=True)

    return write


def plain(name, content):
    return lambda arrays: Path(name).write_bytes(content)


def cut_short(arrays):
    Path("bad.npz").write_bytes(Path("good.npz").read_bytes()[:5000])


def lost(arrays):
    changed(displacement=np.full_like(arrays["displacement"], np.nan))(arrays)


NOT_FINITE = np.array([0.02, np.nan, 0.12, 0.2])

#: How the file is made, its name, and what the line says.
BAD_FILES = {
    "missing": (lambda arrays: None, "nowhere.npz", "nowhere.npz: no such file or folder"),
    "no archive": (plain("bad.npz", b"x,y\n1,2\n"), "bad.npz", "bad.npz: not an npz file"),
    "empty": (plain("bad.npz", b""), "bad.npz", "bad.npz: not an npz file"),
    "cut short": (cut_short, "bad.npz", "bad.npz: damaged or cut short"),
    "unknown kind": (plain("bad.xls", b"x"), "bad.xls", "bad.xls: not a file of a known format"),
    "empty folder": (lambda arrays: Path("d").mkdir(), "d", "d: none of its files is of a format"),
    "not a bulge test": (
        lambda arrays: np.savez("bad.npz", holiday=np.zeros(3)),
        "bad.npz",
        "bad.npz: not a bulge test, it has no reference",
    ),
    "pickled code in npy": (pickled("bad.npy"), "bad.npy", "bad.npy: refused, the pickle asks for"),
    "pickled code in npz": (pickled("bad.npz"), "bad.npz", "bad.npz: holds pickled Python objects"),
    "no pressure": (changed(pressure=None), "bad.npz", "it has no pressure"),
    "no frame": (
        lambda arrays: changed(
            pressure=np.zeros(0), displacement=arrays["displacement"][:0]
        )(arrays),
        "bad.npz",
        "no pressure, hence no frame",
    ),
    "not finite": (changed(pressure=NOT_FINITE), "bad.npz", "pressure of frame 1 is nan"),
    "never under pressure": (changed(pressure=np.zeros(4)), "bad.npz", "no frame is under"),
    "all points lost": (lost, "bad.npz", "all points are lost in every frame"),
    "outside the clamp": (changed(radius=np.float64(60)), "bad.npz", "points lie outside the"),
    "radius in m": (changed(radius=np.float64(0.1)), "bad.npz", "radius 0.1 mm is too small"),
    "pressure in Pa": (
        changed(pressure=np.array([2e4, 6e4, 12e4, 3e5])),
        "bad.npz",
        "pressure 300000 MPa cannot be, it looks like Pa",
    ),
    "no thickness": (changed(thickness=None), "bad.npz", "thickness"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_FILES)
@pytest.mark.parametrize("verb", VERBS)
def test_bad_files(verb, case, folder, arrays, capsys):
    write, name, message = BAD_FILES[case]
    write(arrays)
    refused(capsys, folder, message, verb, "good.npz", name, *VERBS[verb])
    assert not Path("was_run").exists()


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_file_that_may_not_be_read(verb, folder, arrays, capsys):
    changed()(arrays)
    Path("bad.npz").chmod(0)
    assert run(verb, "bad.npz", *VERBS[verb]) == 2
    assert "Permission denied" in capsys.readouterr().err


SEARCH = {
    "bounds reversed": (["--bounds", "E1=400:200"], "bounds of E1 are reversed: 400:200"),
    "everything held": (["--bounds", "E1=3:3,E2=3:3,G12=3:3"], "nothing is left to fit"),
    "bounds below zero": (["--bounds", "G12=-1:5"], "bounds of G12 must be positive"),
    "bounds beyond numbers": (["--bounds", "E1=1:1e200"], "bounds of E1 must be at most 1e+30 MPa"),
    "bounds not finite": (["--bounds", "E1=100:inf"], "bounds of E1 must be finite"),
    "bounds of what": (["--bounds", "E9=1:2"], "bounds: 'E9' is no parameter of orthotropic"),
    "bounds of a held one": (["--bounds", "nu12=0:0.4"], "bounds: nu12 is held fixed"),
    "bounds without a name": (["--bounds", "100:200"], "not of the form NAME=LOW:HIGH"),
    "bounds given twice": (["--bounds", "E1=1:2,E2=1:2,E1=300:400"], "E1 is given twice"),
    "bounds of one number": (["--bounds", "E1=200"], "not of the form NAME=LOW:HIGH"),
    "objective": (["--objective", "e_y"], "choose from e, e_w, e_z, likelihood"),
    "material": (["--material", "steel", "--bounds", ""], "material: 'steel' is unknown"),
    "method": (["--method", "guess"], "method: 'guess' is unknown; choose from gauss-newton"),
    "free": (["--free", "colour"], "free: 'colour' is no parameter of orthotropic"),
    "no start": (["--starts", "0"], "--starts 0: give 1 or more"),
    "starts": (["--starts", "some"], "argument --starts: 'some' is no whole number"),
    "seed": (["--seed", "-1"], "--seed -1"),
    "workers": (["--workers", "0"], "--workers 0: give 1 or more"),
    "evaluations": (["--max-evaluations", "0"], "--max-evaluations 0: give 1 or more"),
    "tolerance": (["--tolerance", "2"], "--tolerance 2: give a part between 0 and 1"),
    "nu12": (["--nu12", "0.7x"], "argument --nu12"),
    "nu12 of shear": (["--material", "isotropic-EG", "--bounds", "", "--nu12", "0.3"], "--nu12"),
    "nu12 too large": (["--nu12", "9", "--starts", "1"], "E1/E2 must exceed nu12²"),
    "nu12 not finite": (["--nu12", "nan"], "--nu12 nan: give a finite ratio"),
    "nu12 held and free": (["--free", "nu12", "--nu12", "0.3"], "do not go together"),
    "nu12 free twice": (["--free", "nu12", "--with", "poisson_ratio"], "takes the place of nu12"),
    "nu12 held twice": (
        ["--nu12", "0.3", "--hold", "poisson_ratio.nu12=0.4"],
        "poisson_ratio.nu12 takes the place of nu12: give one of them",
    ),
}  # fmt: skip


#: One forward path.
QUICK = ["--starts", "1", "--max-evaluations", "1"]


#: What is refused by name or number before anything is said of a fit.
BEFORE = {
    "law": ["--law", "svkk"],
    "linear solver": ["--linear-solver", "abacus"],
    "evaluation": ["--evaluation", "guess"],
    "interpolation": ["--interpolation", "guess"],
    "refine": ["--refine", "0"],
    "objective": ["--objective", "e_y"],
    "average": ["--average", "median"],
    "material": ["--material", "steel"],
    "method": ["--method", "guess"],
    "starts": ["--starts", "0"],
    "nu12 beyond all moduli": ["--nu12", "300"],
    "nu of what keeps its volume": ["--material", "isotropic", "--nu12", "0.5"],
    "workers": ["--workers", "0"],
    "bounds of what": ["--bounds", "E9=1:2"],
    "bounds reversed": ["--bounds", "E1=400:200"],
    "bounds not finite": ["--bounds", "E1=100:inf"],
    "free": ["--free", "colour"],
    "weight below zero": ["--weight", "-1"],
    "weight not finite": ["--weight", "nan"],
    "prior of what": ["--prior", "E9=300+-1"],
    "prior without width": ["--prior", "E1=300+-0"],
    "with what": ["--with", "clamp_slap"],
    "hold what cannot be": ["--hold", "clamp_slip.compliance=-1e9"],
    "scheduler": ["--scheduler", "foo"],
    "scheduler and workers": ["--scheduler", "tcp://127.0.0.1:9", "--workers", "1"],
    "uncertainty": ["--uncertainty", "thickness=2"],
    "journal": ["--journal", "other.npz"],
    "journal elsewhere": ["--journal", "no/such"],
}


@pytest.mark.parametrize("case", BEFORE)
@pytest.mark.parametrize("verb", ["fit", "crossval", "batch"])
def test_names_and_numbers_are_refused_before_a_start(verb, case, folder, capsys):
    assert run(verb, "good.npz", "other.npz", *BEFORE[case]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith(f"bulgefit {verb}: error: ")
    assert "no start found" not in said


def test_a_batch_refuses_all_before_it_fits_one(folder, arrays, capsys):
    changed(displacement=arrays["displacement"] * [1.0, 1.0, np.nan])(arrays)
    words = ["batch", "good.npz", "bad.npz", "--objective", "e_z", *BOUNDS]
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert "bad: nothing was measured that e_z compares" in said
    assert "fitting" not in said


def test_a_fold_numbers_tests_anew(folder, capsys):
    words = ["crossval", "good.npz", "other.npz", "--hold", "pressure_gain.gain@0=1.01"]
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "is of one test alone" in said


@pytest.mark.parametrize("case", SEARCH)
@pytest.mark.parametrize("verb", ["fit", "crossval"])
def test_bad_searches(verb, case, folder, capsys):
    words, message = SEARCH[case]
    refused(capsys, folder, message, verb, "good.npz", "other.npz", *BOUNDS, *words)


COMPARISON = {
    "average": (["--average", "median"], "average: 'median' is unknown; choose from"),
    "evaluation": (["--evaluation", "guess"], "evaluation: 'guess' is unknown; choose from"),
    "interpolation": (["--interpolation", "cubic"], "interpolation: 'cubic' is unknown"),
    "weight": (["--weight", "much"], "--weight 'much': give one number"),
    "two weights": (["--weight", "1,2"], "weight: give one number of dz, or three"),
    "weight of nothing": (["--weight", "0,0,0"], "--weight 0,0,0: nothing would be compared"),
    "max pressure nan": (["--max-pressure", "nan"], "--max-pressure nan: give a pressure above 0"),
    "max pressure below": (["--max-pressure", "-1"], "--max-pressure -1: give a pressure above 0"),
    "max pressure": (["--max-pressure", "0.01"], "--max-pressure 0.01: every frame of good"),
    "law": (["--law", "hooke"], "law: 'hooke' is unknown; choose from hencky, svk, yarn"),
    "mesh": (["--mesh", "nowhere.npz"], "nowhere.npz: cannot be read"),
    "mesh of another radius": (["--mesh", "mesh.npz"], "its rim lies 50 to 50 mm from the centre"),
    "mesh elsewhere": (["--mesh", "beside.npz"], "its rim lies 23.7393 to 99.1788 mm from the"),
    "refine": (["--refine", "0"], "refine must be a whole number, 1 to 200, got 0"),
    "linear solver": (["--linear-solver", "abacus"], "abacus"),
    "format": (["--format", "png"], "unknown format 'png'"),
    "columns of an npz": (["--columns", "x=X"], "has no option --columns"),
    "radius": (["--radius", "-1"], "radius -1 mm must be positive"),
    "json exists": (["--json", "good.npz"], "good.npz: exists; use --force to replace it"),
    "json on the test": (["--json", "./good.npz", "--force"], "would replace what is read"),
    "json on the mesh": (["--mesh", "mesh.npz", "--json", "mesh.npz", "--force"], "would replace"),
    "json folder": (["--json", "."], "is a folder"),
    "json nowhere": (["--json", "no/such.json"], "does not exist"),
    "option": (["--colour", "red"], "unrecognized arguments: --colour red"),
}


@pytest.mark.parametrize("case", COMPARISON)
@pytest.mark.parametrize("verb", VERBS)
def test_bad_comparisons(verb, case, folder, capsys):
    small = disc(50.0, 1)
    np.savez("mesh.npz", nodes=small.nodes, cells=small.cells)
    shrunk = disc(60.0, 1)
    np.savez("beside.npz", nodes=shrunk.nodes + np.array([40.0, 0.0]), cells=shrunk.cells)
    words, message = COMPARISON[case]
    refused(capsys, folder, message, verb, "good.npz", "other.npz", *VERBS[verb], *words)


def test_frames_at_the_limit_are_kept(folder, arrays, capsys):
    """70 kPa and 0.07 MPa are 0.7 bar, whatever the last bits of their numbers say."""
    for highest in (70 * 1e-3, 0.07):
        changed(pressure=np.array([0.02, 0.06, highest, 0.2]))(arrays)
        words = ["--max-pressure", "0.7", *SAME_MESH, "--json", "-"]
        assert run("evaluate", "bad.npz", *MATERIAL, *words) == 0
        assert json.loads(capsys.readouterr().out)["sources"][0]["frames"] == 3


EVALUATED = {
    "no material": ([], "no material: give --E1 --E2 --G12"),
    "half a material": (["--E1", "300", "--E2", "200"], "--G12 missing"),
    "mixed": ([*MATERIAL, "--E", "200"], "do not go together"),
    "shear": (["--E1", "300", "--E2", "200", "--G12", "-5"], "G12 must be positive"),
    "energy": (["--E1", "5", "--E2", "200", "--G12", "5", "--nu12", "0.9"], "E1/E2 must exceed"),
    "nu": (["--E", "200", "--nu", "0.6"], "nu"),
    "too soft": (["--E", "1", "--refine", "1"], "no equilibrium"),
    "undeformed and a material": ([*MATERIAL, "--undeformed"], "--undeformed"),
    "undeformed and found": (
        ["--undeformed", "--from", "a.json"],
        "--undeformed and --from do not",
    ),
    "undeformed and held": (["--undeformed", "--hold", "a.b=1"], "--undeformed and --hold do not"),
    "two ratios": (
        [*MATERIAL, "--nu12", "0.3", "--hold", "poisson_ratio.nu12=0.4"],
        "poisson_ratio.nu12 takes the place of nu12: give one of them",
    ),
}


@pytest.mark.parametrize("case", EVALUATED)
def test_bad_materials(case, folder, capsys):
    words, message = EVALUATED[case]
    refused(capsys, folder, message, "evaluate", "good.npz", *words)


@pytest.mark.parametrize("verb", VERBS)
def test_ratios_that_differ(verb, folder, arrays, capsys):
    other = {"displacement": arrays["displacement"] + 0.01, "poisson_ratio": np.float64(0.3)}
    np.savez("stiffer.npz", **{**arrays, **other})
    words = [verb, "good.npz", "stiffer.npz", *VERBS[verb], "--refine", "1", "--quiet"]
    refused(capsys, folder, "Poisson ratios (0.24, 0.3); say which one holds for all", *words)
    assert run(*words, "--nu12", "0.3", *([] if verb == "evaluate" else QUICK)) == 0


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("copy", ["./good.npz", "link.npz", "copy.h5", "rest.npz"])
def test_one_specimen_is_not_two(verb, copy, folder, arrays, capsys):
    Path("link.npz").symlink_to("good.npz")
    # with its reference image beside it
    moved, pressure = arrays["displacement"], np.append(0.0, arrays["pressure"])
    moved = np.concatenate([np.zeros_like(moved[:1]), moved])
    np.savez("rest.npz", **{**arrays, "displacement": moved, "pressure": pressure})
    assert run("convert", "good.npz", "copy.h5", "--quiet") == 0
    message = f"good.npz and {copy.removeprefix('./')}: hold the same data; name each test once"
    refused(capsys, folder, message, verb, "other.npz", "good.npz", copy, *VERBS[verb])


def test_what_makes_a_comparison_meaningless_is_said(folder, arrays, capsys):
    turned = arrays["displacement"] * [1.0, 1.0, -1.0]
    np.savez("turned.npz", **{**arrays, "displacement": turned})
    assert run("evaluate", "good.npz", "turned.npz", *MATERIAL, "--refine", "1") == 0
    warnings = [w for w in capsys.readouterr().err.splitlines() if w.startswith("warning")]
    (warning,) = warnings
    assert warning.startswith(
        "warning: turned: the apex moves to -z under pressure: the z axis points into the "
        "specimen; bulgefit convert IN OUT --flip z,dz"
    )


def test_one_test_cannot_be_left_out(folder, capsys):
    refused(capsys, folder, "needs two tests or more, got 1", "crossval", "good.npz", *BOUNDS)


def test_figures_that_exist(folder, capsys):
    Path("f").mkdir()
    Path("f/good_residuals.png").touch()
    refused(capsys, folder, "exists; use --force", "fit", "good.npz", *BOUNDS, "--plots", "f")
    refused(capsys, folder, "is a file", "fit", "good.npz", "--plots", "good.npz/f")


def test_no_figures_folder_is_left_behind(folder, capsys):
    words = ["--bounds", "E1=400:200", "--plots", "f"]
    refused(capsys, folder, "reversed", "fit", "good.npz", *words)


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to read-only folders")
def test_read_only_folder(verb, folder, capsys):
    small = [*VERBS[verb], "--refine", 1]
    small += [] if verb == "evaluate" else ["--starts", 1, "--max-evaluations", 1]
    folder.chmod(0o555)
    try:
        refused(capsys, folder, "cannot be written", verb, "good.npz", "other.npz", *small,
                "--json", "r.json")  # fmt: skip
    finally:
        folder.chmod(0o755)


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("verb", VERBS)
def test_place_that_cannot_be_written(verb, folder, monkeypatch, capsys):
    """Even root may not make files in /proc; it is seen before the work."""
    monkeypatch.setattr("bulgefit.cli._fitting.read_tests", lambda args: pytest.fail("began"))
    words = [verb, "good.npz", *VERBS[verb], "--json", "/proc/r.json"]
    refused(capsys, folder, "/proc/r.json: cannot be written", *words)


def test_figures_stay_in_their_folder(folder, arrays, capsys):
    """Names of tests may be anything, and alike."""
    places = []
    for place, name in (("a", "../up"), ("b", "s"), ("c", "s"), ("d", "s_3")):
        Path(place).mkdir()
        content = {**arrays, "displacement": arrays["displacement"] + 0.001 * len(places)}
        write_frames(Path(place), content, name)
        places.append(place)
    words = ["fit", *places, "--material", "isotropic", "--starts", 1, "--refine", 1]
    assert run(*words, "--max-evaluations", 1, "--plots", "f/g") == 0
    stems = ["_up", "b", "c", "s_3"]  # the folders tell those of one name apart
    drawn = [f"{stem}_{kind}.png" for stem in stems for kind in ("profiles", "residuals")]
    assert sorted(os.listdir("f/g")) == sorted(drawn)
    assert os.listdir("f") == ["g"]


def write_frames(folder, arrays, name):
    """A folder of CSV frames with a test.json."""
    place, rows = arrays["reference"], ["file,pressure_bar"]
    for i, (moved, pressure) in enumerate(
        zip(arrays["displacement"], arrays["pressure"], strict=True)
    ):
        np.savetxt(folder / f"{i}.csv", np.hstack([place, moved]), delimiter=",",
                   header="x,y,z,dx,dy,dz", comments="")  # fmt: skip
        rows.append(f"{i}.csv,{10 * pressure}")
    (folder / "pressure.csv").write_text("\n".join(rows))
    about = {"name": name, "radius": 100.0, "thickness": 0.81}
    (folder / "test.json").write_text(json.dumps(about))


def test_json_that_is_a_figure(folder, capsys):
    Path("f").mkdir()
    words = ["fit", "good.npz", *BOUNDS, "--plots", "f", "--json", "f/good_profiles.png"]
    refused(capsys, folder, "two outputs have this name", *words)


@pytest.mark.parametrize(
    ("words", "output"),
    [(["measure", "good.npz", "--json"], "p.csv"), (["show", "good.npz"], "p.png")],
)
def test_outputs_on_the_table_of_pressures(words, output, folder, capsys):
    Path(output).touch()
    more = ["--pressure", f"./{output}", "--force"]
    refused(capsys, folder, "would replace what is read", *words, output, *more)


def test_json_on_a_test_that_info_reads(folder, capsys):
    words = ["info", "good.npz", "--json", "good.npz", "--force"]
    refused(capsys, folder, "good.npz: would replace what is read as input", *words)


def test_a_fit_is_given_whatever_becomes_of_the_rest(folder, monkeypatch, capsys):
    def fails(*_, **__):
        raise InputError("next to no frame")

    monkeypatch.setattr("bulgefit.fitting.bootstrap.bootstrap", fails)
    words = ["fit", "good.npz", "--material", "isotropic", "--starts", 1, "--refine", REFINE]
    words += ["--max-evaluations", 1, "--quiet", "--bootstrap", 20, "--workers", 1]
    assert run(*words, "--json", "r.json", "--plots", "f") == 2
    output = capsys.readouterr()
    assert "e_w = " in output.out
    assert output.err == "bulgefit fit: error: next to no frame\n"
    assert "bootstrap" not in json.loads(Path("r.json").read_text())
    assert len(os.listdir("f")) == 2


def test_figures_are_drawn_for_a_reader_who_leaves(folder):
    read, write = os.pipe()
    os.close(read)
    words = ["fit", "good.npz", "--material", "isotropic", "--starts", "1", "--refine", "2"]
    words += ["--max-evaluations", "1", "--quiet", "--plots", "f", "--json", "r.json"]
    with os.fdopen(write, "w") as gone:
        done = subprocess.run(
            [sys.executable, "-m", "bulgefit", *words], stdout=gone, stderr=subprocess.PIPE,
            text=True, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (141, "")
    assert sorted(os.listdir("f")) == ["good_profiles.png", "good_residuals.png"]
    assert Path("r.json").exists()


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's limit of file sizes")
def test_full_disk(verb, folder):
    """Files may not grow beyond 100 bytes, as on a full disk: the old result stays whole."""
    Path("r.json").write_text("old")
    words = [verb, "good.npz", "other.npz", *VERBS[verb], "--refine", "1"]
    words += [] if verb == "evaluate" else ["--starts", "1", "--max-evaluations", "1"]
    assert run(*words, "--json", "warm.json") == 0  # kernels are compiled and kept

    def limit():
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    done = subprocess.run(
        [sys.executable, "-m", "bulgefit", *words, "--json", "r.json", "--force", "--quiet"],
        capture_output=True, text=True, check=False, preexec_fn=limit,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    # Intel's OpenMP, where PARDISO is installed, has words of its own about such a limit
    said = [line for line in done.stderr.splitlines() if not line.startswith("OMP: Warning")]
    assert len(said) == 1
    # verbs that can be taken up again write what is done beside their output, and try that first
    first = "r.json" if verb == "evaluate" else "r.json.part"
    assert f"{first}: cannot be written (File too large); it is as it was" in said[0]
    assert Path("r.json").read_text() == "old"
    assert sorted(os.listdir()) == ["good.npz", "other.npz", "r.json", "warm.json"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk_behind_stdout(folder):
    words = ["evaluate", "good.npz", "--undeformed", "--refine", "1", "--json", "-"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bulgefit", *words], stdout=full, stderr=subprocess.PIPE,
            text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "bulgefit evaluate: error: No space left on device\n"


def json_alone(capsys, *words):
    """What `--json -` prints: nothing else on stdout, nothing at all on stderr under --quiet."""
    assert run(*words, *SAME_MESH, "--json", "-", "--quiet") == 0
    output = capsys.readouterr()
    assert output.err == ""
    return json.loads(output.out)


def test_evaluate(folder, capsys):
    result = json_alone(capsys, "evaluate", "good.npz", "other.npz", *MATERIAL)
    assert {"e", "e_w", "e_z", "weight", "tests", "versions", "sources"} <= result.keys()
    assert [test["name"] for test in result["tests"]] == ["good", "other"]
    for test in result["tests"]:
        assert {"name", "dx", "dy", "dz", "e", "e_w", "e_z"} <= test.keys()
        assert test["e"] == pytest.approx(test["dx"] + test["dy"] + test["dz"])
        weighted = test["dx"] + test["dy"] + result["weight"] * test["dz"]
        assert test["e_w"] == pytest.approx(weighted)
    # only noise is left: the mean of |Gaussian| is 0.798 standard deviations
    good = result["tests"][0]
    assert good["dx"] == pytest.approx(0.798 * 0.005, rel=0.15)
    assert good["dz"] == pytest.approx(0.798 * 0.012, rel=0.15)
    for key in ("e", "e_w", "e_z"):
        assert result[key] == pytest.approx(np.mean([test[key] for test in result["tests"]]))
    assert all(len(source["sha256"]) == 64 for source in result["sources"])


def test_a_pattern_that_the_shell_leaves_alone(folder, capsys):
    """As Windows' does; what a pattern names that is no .npz are frames of one test."""
    result = json_alone(capsys, "evaluate", "*o*d.npz", "oth*.npz", *MATERIAL)
    assert [test["name"] for test in result["tests"]] == ["good", "other"]
    assert run("evaluate", "good*", "none*.npz", *MATERIAL) == 2
    assert "none*.npz: no such file or folder" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["evaluate"], ["measure", "--window", "60"]])
def test_moduli_in_pa_are_warned_of(words, folder, capsys):
    moduli = ["--E1", "330e6", "--E2", "240e6", "--G12", "30e6"]
    assert run(words[0], "good.npz", *words[1:], *moduli) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: E1 = 3.3e+08 MPa: nothing is stiffer than diamond")


def test_evaluate_at_rest_and_as_a_table(folder, arrays, capsys):
    result = json_alone(capsys, "evaluate", "good.npz", "--undeformed", "--weight", "0.1")
    mean = np.nanmean(np.abs(arrays["displacement"]), axis=(0, 1))
    assert [result["tests"][0][key] for key in ("dx", "dy", "dz")] == pytest.approx(list(mean))
    assert result["weight"] == 0.1
    assert run("evaluate", "good.npz", "--undeformed", "--json", "r.json") == 0
    table = capsys.readouterr().out
    assert f"{result['e']:.4f}" in table
    assert json.loads(Path("r.json").read_text())["e"] == pytest.approx(result["e"])


def test_fit(folder, capsys):
    words = ["fit", "good.npz", *BOUNDS, "--starts", 2, "--objective", "e_w"]
    result = json_alone(capsys, *words, "--workers", 2)
    assert {"parameters", "objective", "evaluations", "failures", "starts"} <= result.keys()
    for name, part in (("E1", 0.02), ("E2", 0.02), ("G12", 0.05)):
        entry = result["parameters"][name]
        assert entry["value"] == pytest.approx(TRUTH[name], rel=part)
        assert entry["unit"] == "MPa"
        assert entry["at_bound"] is False
    assert result["parameters"]["nu12"]["value"] == 0.24
    assert result["objective"]["name"] == "e_w"
    assert len(result["starts"]) == 2
    assert result["evaluations"] == sum(start["evaluations"] for start in result["starts"])
    assert result["failures"] == 0
    assert all(start["reason"] for start in result["starts"])
    assert result["settings"]["seed"] == 0
    # what was found is what evaluate says of it, and it is no worse than the truth
    found = [
        word
        for name, entry in result["parameters"].items()
        for word in (f"--{name}", repr(entry["value"]))
    ]
    judged = json_alone(capsys, "evaluate", "good.npz", *found)
    # a path with derivatives has levels of its own: both are right to the path's tolerance
    assert judged["e_w"] == pytest.approx(result["objective"]["value"], abs=1e-5)
    truth = json_alone(capsys, "evaluate", "good.npz", *MATERIAL)
    assert judged["e_w"] <= truth["e_w"]
    # neither the number of workers nor the time of day makes a difference
    again = json_alone(capsys, *words, "--workers", 1)
    assert again["parameters"] == result["parameters"]
    assert again["starts"] == result["starts"]


def test_fit_says_what_ends_at_a_bound(folder, capsys):
    words = ["--starts", 1, "--bounds", "E1=200:300,E2=150:400,G12=10:60", "--plots", "f"]
    assert run("fit", "good.npz", *words, "--refine", REFINE, "--json", "r.json") == 0
    output = capsys.readouterr()
    assert "AT BOUND 200..300" in output.out
    assert "fitting 1 test, " in output.err
    entry = json.loads(Path("r.json").read_text())["parameters"]["E1"]
    assert entry["at_bound"] is True
    assert entry["value"] == pytest.approx(300, rel=1e-3)
    assert sorted(os.listdir("f")) == ["good_profiles.png", "good_residuals.png"]


def test_fit_with_a_bootstrap(folder, capsys):
    words = ["fit", "good.npz", "--material", "isotropic", "--starts", 1, "--bootstrap", 20]
    result = json_alone(capsys, *words, "--workers", 1)
    assert result["bootstrap"]["replicates"] == 20
    low, high = result["bootstrap"]["parameters"]["E"]["interval"]
    assert low < high
    assert run(*words, "--refine", REFINE, "--keep-mesh-error", "--workers", 2) == 0
    assert f"  E    {low:>12.6g} to {high:.6g} MPa" in capsys.readouterr().out


def test_bootstraps_that_cannot_be(folder, arrays, monkeypatch, capsys):
    """They are refused before the fit."""
    monkeypatch.setattr("bulgefit.fitting.fit.fit", lambda *_, **__: pytest.fail("began"))
    for number in (0, 1, 19):
        words = ["fit", "good.npz", *BOUNDS, "--bootstrap", number]
        refused(capsys, folder, f"--bootstrap {number}: give 20 or more", *words)
    changed(displacement=arrays["displacement"][3:], pressure=arrays["pressure"][3:])(arrays)
    words = ["fit", "good.npz", "bad.npz", *BOUNDS, "--bootstrap", 20]
    refused(capsys, folder, "bad.npz has one frame to draw from", *words)


@pytest.mark.parametrize(("kind", "name"), [("isotropic", "nu"), ("orthotropic", "nu12")])
def test_different_poisson_ratios(kind, name, folder, arrays, capsys):
    """The option that is asked for is one that there is."""
    changed(displacement=arrays["displacement"] + 0.02, poisson_ratio=np.float64(0.3))(arrays)
    words = ["fit", "good.npz", "bad.npz", "--material", kind, "--starts", 1, "--refine", REFINE]
    words += ["--max-evaluations", 1]
    said = "(0.24, 0.3); say which one holds for all (--nu12, or --nu of an isotropic material)"
    refused(capsys, folder, said, *words)
    result = json_alone(capsys, *words, f"--{name}", 0.25)
    assert result["parameters"][name]["value"] == 0.25


def test_a_cross_table_without_dz(folder, arrays, capsys):
    """What cannot be fitted is missing from the table, not the table."""
    moved = arrays["displacement"].copy()
    moved[..., 2] = np.nan
    changed(displacement=moved)(arrays)
    words = ["fit", "bad.npz", "--material", "isotropic", "--starts", 1, "--max-evaluations", 1]
    table = json_alone(capsys, *words, "--cross-table")["cross_table"]
    assert table["optimum of e_z"] == {"e": None, "e_w": None, "e_z": None}
    assert table["optimum of e"]["e"] > 0.0
    assert run(*words, "--refine", REFINE, "--cross-table") == 0
    output = capsys.readouterr()
    assert "no optimum of e_z: bad: nothing was measured that e_z compares" in output.err
    assert [line.split()[-3:] for line in output.out.splitlines() if "optimum of e_z" in line] == [
        ["-", "-", "-"]
    ]


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["--material", "isotropic"], ["E", "nu"]),
        (["--material", "isotropic-EG"], ["E", "G"]),
        (["--free", "nu12", "--method", "L-BFGS-B", *BOUNDS], ["E1", "E2", "G12", "nu12"]),
    ],
)
def test_other_materials(words, names, folder, capsys):
    words = [*words, "--objective", "e", "--starts", 1, "--max-evaluations", 8]
    result = json_alone(capsys, "fit", "good.npz", *words)
    assert list(result["parameters"]) == names
    held = [name for name, entry in result["parameters"].items() if not entry["free"]]
    assert held == (["nu"] if "isotropic" in words else [])


def test_crossval(folder, capsys):
    words = ["crossval", "good.npz", "other.npz", *BOUNDS, "--starts", 1]
    result = json_alone(capsys, *words)
    assert [fold["left_out"] for fold in result["folds"]] == ["good", "other"]
    for fold in result["folds"]:
        assert fold["parameters"]["E1"] == pytest.approx(TRUTH["E1"], rel=0.05)
        assert fold["left_out_objectives"].keys() == {"e", "e_w", "e_z"}
        assert fold["failures"] == 0
    scores = [fold["left_out_objectives"]["e_w"] for fold in result["folds"]]
    assert result["mean"] == pytest.approx(np.mean(scores))
    assert run(*words, "--refine", 1, "--max-evaluations", 2) == 0
    assert "left out" in capsys.readouterr().out


def test_crossval_says_what_ends_at_a_bound(folder, capsys):
    words = ["--starts", 1, "--bounds", "E1=200:300,E2=150:400,G12=10:60", "--refine", REFINE]
    assert run("crossval", "good.npz", "other.npz", *words, "--json", "r.json") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [fold["at_bound"] for fold in json.loads(Path("r.json").read_text())["folds"]] == [
        ["E1"],
        ["E1"],
    ]
    for left_out in ("good", "other"):
        (row,) = (line for line in lines if line.startswith(f"{left_out} "))
        assert [cell.endswith("*") for cell in row.split()[1:4]] == [True, False, False]
    assert "* E1 AT BOUND without good, other: no result; widen --bounds E1=..." in lines
