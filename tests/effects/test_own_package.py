"""Does a package of one's own bring an effect, a law and a reader, by docs/own_package.md alone?"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import bulgefit

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "docs" / "own_package"
TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0}


def installed(source: Path, target: Path) -> dict[str, str]:
    """Install a package into a folder; the environment in which it is found."""
    if int(version("setuptools").split(".")[0]) < 77:
        pytest.skip("setuptools 77 or later builds the package; install bulgefit[test]")
    options = ["--no-build-isolation", "--no-deps", "--quiet", "--no-index"]
    words = [sys.executable, "-m", "pip", "install", *options, "--target", str(target)]
    # building writes beside the sources
    copy = target.with_name(f"{target.name}_source")
    shutil.copytree(source, copy)
    done = subprocess.run([*words, str(copy)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    places = [str(target), str(Path(bulgefit.__file__).parents[1])]
    places += filter(None, [os.environ.get("PYTHONPATH")])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places)}


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return installed(PACKAGE, tmp_path_factory.mktemp("hose") / "site")


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], env=environment, capture_output=True, text=True, check=False
    )


def test_the_command_line_fits_it(environment: dict[str, str], tmp_path: Path) -> None:
    """A test whose chamber gets less than the gauge says: the loss comes back."""
    loss, recorded = 0.03, np.array([0.02, 0.05, 0.1, 0.15, 0.2])
    rng = np.random.default_rng(4)
    points = rng.uniform(-90, 90, (150, 3)) * [1, 1, 0]
    points = points[np.hypot(points[:, 0], points[:, 1]) < 90]
    blank = np.zeros((5, len(points), 3))
    true = bulgefit.BulgeTest.from_arrays(points, blank, recorded * (1.0 - loss * 10.0 * recorded))
    seen = bulgefit.predict(true, TRUTH).displacement + rng.normal(0, 0.002, blank.shape)
    file = tmp_path / "hose.npz"
    bulgefit.write_test(bulgefit.BulgeTest.from_arrays(points, seen, recorded), file)
    done = run(
        environment, "-m", "bulgefit", "fit", str(file), "--with", "hose_lag", "--starts", "1",
        "--json", "-", "--quiet",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["parameters"]["hose_lag.loss"]
    assert found["unit"] == "1/bar"
    assert found["value"] == pytest.approx(loss, abs=4 * found["stderr"])
    assert found["stderr"] < 0.1 * loss


def test_python_knows_it(environment: dict[str, str]) -> None:
    said = (
        "from bulgefit.effects.registry import catalogue; e = catalogue()['hose_lag'];"
        "print(e.place, e.names)"
    )
    done = run(environment, "-c", said)
    assert done.stdout.strip() == "load ('hose_lag.loss',)", done.stderr


def test_the_command_line_takes_its_law(environment: dict[str, str]) -> None:
    """A stiffening law rises less than the one whose stiffness at rest it shares."""
    words = "-m bulgefit simulate --E 1.2 --nu 0.45 --pressure 0.05 --refine 2 --json - --quiet"
    apexes = {}
    for law in ("fung", "svk"):
        done = run(environment, *words.split(), "--law", law)
        assert done.returncode == 0, done.stderr
        apexes[law] = json.loads(done.stdout)["apex_mm"][0]
    # c = 40 MPa is far above psi here: the exponential stiffens a little
    assert 0.9 < apexes["fung"] / apexes["svk"] < 0.9999


def test_the_command_line_reads_its_files(environment: dict[str, str], tmp_path: Path) -> None:
    """Numbers come back with their units, and a lost point is lost."""
    points = [[10.0 * i, 10.0 * j, 0.0] for i in range(-5, 6) for j in range(-5, 6)]
    rise = [5.0 * (1.0 - (x * x + y * y) / 1e4) for x, y, _ in points]
    moved: list[list[float] | None] = [[0.0, 0.0, dz] for dz in rise]
    moved[7] = None
    images = [{"mbar": 250, "moved": [[0.0, 0.0, 0.6 * dz] for dz in rise]}]
    images.append({"mbar": 1000, "moved": moved})
    file = tmp_path / "test.rig"
    file.write_text(json.dumps({"clamp_mm": [100, 0.81], "points": points, "images": images}))
    out = tmp_path / "test.npz"
    done = run(environment, "-m", "bulgefit", "convert", str(file), str(out), "--quiet")
    assert done.returncode == 0, done.stderr
    with np.load(out) as arrays:
        np.testing.assert_allclose(arrays["pressure"], [0.025, 0.1], rtol=1e-12)
        assert arrays["radius"] == 100.0
        np.testing.assert_allclose(arrays["displacement"][1, :7, 2], rise[:7], rtol=1e-6)
        assert np.isnan(arrays["displacement"][1, 7]).all()
    done = run(environment, "-m", "bulgefit", "formats")
    assert "a test of our own rig" in done.stdout


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("place =", "place = 1 / 0 #", "effect hose_lag of an installed package cannot be loaded"),
        ('place = "load"', 'place = "attic"', "effect hose_lag of an installed package is no"),
        ('id = "hose_lag"', 'id = "clamp_slip"', "there is one of that name"),
    ],
    ids=["broken", "of no place", "twice"],
)
def test_a_broken_one_is_named_in_one_line(old: str, new: str, said: str, tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(PACKAGE, source)
    module = source / "bulge_lab" / "hose.py"
    text = module.read_text(encoding="utf-8")
    assert old in text
    module.write_text(text.replace(old, new), encoding="utf-8")
    environment = installed(source, tmp_path / "site")
    file = str(ROOT / "data" / "example_bulge.npz")
    done = run(environment, "-m", "bulgefit", "fit", file, "--with", "prestrain", "--quiet")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert "hose_lag" in done.stderr or "bulge_lab" in done.stderr
