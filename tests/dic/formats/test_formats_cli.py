"""Does the command line read exports, list the formats, and see readers of other packages?"""

from __future__ import annotations

import argparse
import importlib
import json
import sys

import numpy as np
import pytest

from bulgefit.cli import convert, formats, info, tests_in
from bulgefit.dic import READERS, read_test
from bulgefit.dic.formats import plugins
from bulgefit.errors import InputError

NAMES = [f"run_{i}" for i in range(4)]


def run(verb, *arguments):
    parser = argparse.ArgumentParser(prog="bulgefit")
    verb.add_arguments(parser)
    return verb.run(parser.parse_args([str(argument) for argument in arguments]))


@pytest.fixture
def folder(truth, write_table):
    for i, name in enumerate(NAMES):
        rows = np.hstack([truth.reference, truth.displacement[i], truth.pixels])
        made = write_table(f"{name}.csv", "X,Y,Z,U,V,W,x,y", rows)
    return made


def test_an_export_is_converted(folder, truth, log, tmp_path, holds, capsys):
    lines = [f"{name},{p * 4}" for name, p in zip(NAMES, truth.pressure, strict=True)]
    (folder / "daq.csv").write_text("\n".join(["file,ai0 [V]", *lines]))
    options = ["--radius", 100, "--thickness", 1]
    with pytest.raises(InputError, match="--pressure-column NAME"):
        run(convert, folder, tmp_path / "o.npz", *options)
    options += ["--pressure-column", "ai0", "--pressure-unit", "2.5bar/V"]
    run(convert, folder, tmp_path / "o.npz", *options)
    holds(read_test(tmp_path / "o.npz"))
    output = capsys.readouterr()
    assert output.out == ""
    assert "81 points a frame, joined by id\npressure from 'ai0 [V]' of daq.csv" in output.err
    run(info, folder / "run_*.csv", *options, "--format", "vic3d", "--positions", "reference")
    assert "0 to 2 bar, increasing" in capsys.readouterr().out


def test_files_of_a_pattern_are_not_replaced(folder):
    read = tests_in.files_read([str(folder / "run_*.csv")])
    assert folder / "run_2.csv" in read


def test_formats_are_listed(capsys, tmp_path):
    assert run(formats) == 0
    shown = capsys.readouterr().out
    for reader in READERS.values():
        assert reader.name in shown
        assert reader.example in shown
        assert reader.example
        assert reader.lost
        assert reader.positions in ("reference", "current")
    run(formats, "--json", "-")
    listed = json.loads(capsys.readouterr().out)["formats"]
    assert [entry["name"] for entry in listed] == sorted(READERS)
    assert all("pressure_unit" in e["options"] for e in listed if e["name"] in ("dice", "vic3d"))


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a package with a good and two broken readers."""
    (tmp_path / "lab_readers.py").write_text(
        "from bulgefit.dic import Recording, reader\n"
        "@reader('lab', ['.lab'], example='a line of the lab')\n"
        "def read_lab(path):\n"
        "    x = [[0, 0, 0], [1, 0, 0]]\n"
        "    return Recording([0.1], '', x, [x], None, 100, 1)\n"
    )
    (tmp_path / "lab_broken.py").write_text("raise RuntimeError('no\\nlicence')\n")
    made = tmp_path / "lab-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (made / "entry_points.txt").write_text(
        "[bulgefit.readers]\ngood = lab_readers\nbad = lab_broken\nnone = lab_missing:reader\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    plugins.load_plugins.cache_clear()
    yield tmp_path
    READERS.pop("lab", None)
    sys.modules.pop("lab_readers", None)
    plugins.load_plugins.cache_clear()


def test_readers_of_other_packages(installed, capsys):
    (installed / "t.lab").touch()
    lines: list[str] = []
    test = read_test(installed / "t.lab", say=lines.append)
    assert test.pressure.tolist() == [0.1]
    assert lines == [
        "reader bad of lab is left out: no licence (lab_broken)",
        "reader none of lab is left out: No module named 'lab_missing' (lab_missing:reader)",
    ]
    run(formats)
    output = capsys.readouterr()
    assert "a line of the lab" in output.out
    assert output.err.splitlines() == lines
