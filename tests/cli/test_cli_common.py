"""Do the parts that all verbs share refuse what cannot be, and pass on what can?"""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np
import pytest

from bulgefit.cli import _common
from bulgefit.cli.tests_in import files_read
from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc
from bulgefit.files import check_folder


def parsed(*words):
    parser = argparse.ArgumentParser()
    _common.add_material_arguments(parser)
    _common.add_solver_arguments(parser)
    _common.add_json_arguments(parser)
    _common.add_workers_argument(parser)
    return parser.parse_args(list(words))


@pytest.mark.parametrize(
    ("words", "kind", "values"),
    [
        ("--E1 3 --E2 2 --G12 1", "orthotropic", {"E1": 3, "E2": 2, "G12": 1, "nu12": 0.3}),
        ("--E1 3 --E2 2 --G12 1 --nu12 0", "orthotropic", {"E1": 3, "E2": 2, "G12": 1, "nu12": 0}),
        ("--E 3", "isotropic", {"E": 3, "nu": 0.3}),
        ("--E 3 --nu .4", "isotropic", {"E": 3, "nu": 0.4}),
        ("--E 3 --G 1.2", "isotropic-EG", {"E": 3, "G": 1.2}),
    ],
)
def test_material(words, kind, values):
    made = _common.material_from(parsed(*words.split()), poisson_ratio=0.3)
    assert (made.kind, made.values) == (kind, values)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "no material"),
        ("--E1 3 --E2 2", "--G12 missing"),
        ("--nu12 0.2", "--E1 and --E2 and --G12 missing"),
        ("--nu 0.2", "--E missing"),
        ("--E1 3 --E2 2 --G12 1 --nu 0.2", "--E1 and --nu do not go together"),
        ("--E 3 --E2 2", "--E2 and --E do not go together"),
        ("--E 3 --nu .2 --G 1", "--nu and --G do not go together"),
        ("--E 3 --nu 0.5", "nu must lie in"),
        ("--E 3 --G 3", "nu must lie in"),
        ("--E1 3 --E2 2 --G12 0", "G12 must be positive"),
        ("--E1 3 --E2 2 --G12 nan", "G12 must be positive"),
        ("--E1 1 --E2 200 --G12 1", "E1/E2 must exceed"),
    ],
)
def test_materials_that_cannot_be(words, message):
    with pytest.raises(InputError, match=message):
        _common.material_from(parsed(*words.split()))


def test_mesh_of_ones_own(tmp_path):
    made = disc(50.0, 1)
    np.savez(tmp_path / "m.npz", nodes=made.nodes, cells=made.cells)
    read = _common.mesh_from(parsed("--mesh", str(tmp_path / "m.npz")), 100.0)
    np.testing.assert_array_equal(read.nodes, made.nodes)
    assert len(_common.mesh_from(parsed(), 100.0).cells) == 912
    assert len(_common.mesh_from(parsed("--refine", "1"), 100.0).cells) == 57
    with pytest.raises(InputError, match="do not go together"):
        _common.mesh_from(parsed("--refine", "1", "--mesh", "m.npz"), 100.0)


def test_meshes_that_cannot_be(tmp_path):
    made = disc(50.0, 1)
    file = tmp_path / "m.npz"

    def refused(message):
        with pytest.raises(InputError, match=message) as caught:
            _common.load_mesh(str(file))
        assert str(file) in str(caught.value)
        file.unlink(missing_ok=True)

    refused("No such file")
    file.write_text("no mesh")
    refused("not an npz")
    file.write_bytes(b"")
    refused("not an npz")
    file.write_bytes(b"PK\x03\x04 cut short")
    refused("not an npz")
    np.savez(file, nodes=made.nodes)
    refused("no cells; found nodes")
    np.savez(file, other=made.nodes)
    refused("no nodes and no cells")
    np.savez(file, nodes=made.nodes, cells=made.cells.astype(float))
    refused("cells holds float64")
    np.savez(file, nodes=made.nodes, cells=np.array([{}], dtype=object))
    refused("not an npz file with nodes and cells")
    np.savez(file, nodes=made.nodes, cells=made.cells + 1)
    refused("cells name nodes")
    with open(file, "wb") as handle:
        np.save(handle, made.nodes)
    refused("is one array")
    file = tmp_path
    with pytest.raises(InputError, match="Is a directory"):
        _common.load_mesh(str(file))


def test_json(tmp_path, capsys):
    payload = {"a": np.float64(1.5), "b": np.array([1, 2]), "c": [float("nan"), np.inf],
               "d": {"e": (np.bool_(True), None, "µ")}}  # fmt: skip
    plain = {"a": 1.5, "b": [1, 2], "c": [None, None], "d": {"e": [True, None, "µ"]}}
    _common.write_json(payload, "-")
    assert json.loads(capsys.readouterr().out) == plain
    file = tmp_path / "r.json"
    _common.write_json(payload, str(file))
    assert json.loads(file.read_text(encoding="utf-8")) == plain
    with pytest.raises(InputError, match="exists; use --force"):
        _common.write_json(payload, str(file))
    _common.write_json({"name": "caf\udce9"}, str(file), force=True)  # as of a Latin-1 file name
    assert json.loads(file.read_text()) == {"name": "caf\udce9"}
    _common.write_json({}, str(file), force=True)
    assert json.loads(file.read_text()) == {}


def test_outputs_are_checked_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("r.json", "in.npz", "frames/f.csv", "frames/f.txt", "frames/r.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "link.npz").symlink_to("in.npz")

    def check(*words, inputs=("in.npz", None), others=()):
        _common.check_outputs(parsed(*words), files_read(inputs), others)

    with pytest.raises(InputError, match="exists"):
        check("--json", "r.json")
    check("--json", "r.json", "--force", others=["s.npz"])
    check("--json", "-", others=["-"])
    check()
    for name in ("in.npz", "./in.npz", "link.npz", str(tmp_path / "in.npz")):
        with pytest.raises(InputError, match="would replace what is read"):
            check("--json", name, "--force")
    for name in ("f.csv", "f.txt", "test.json"):
        with pytest.raises(InputError, match="would replace what is read"):
            check("--json", f"frames/{name}", "--force", inputs=["./frames"])
    check("--json", "frames/r.json", "--force", inputs=["frames"])
    with pytest.raises(InputError, match="two outputs have this name"):
        check("--json", "r.json", "--force", others=["./r.json"])


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_places_that_take_no_file_are_refused_first(tmp_path):
    """Even root may not make files in /proc."""
    for file in ("/proc/r.json", str(tmp_path / ("a" * 250))):
        with pytest.raises(InputError, match="cannot be written"):
            _common.check_outputs(parsed("--json", file), [])
    with pytest.raises(InputError, match="/proc/new: cannot be written"):
        check_folder("/proc/new")
    (tmp_path / "gone").symlink_to("nowhere")
    with pytest.raises(InputError, match="gone is a file; name a folder"):
        check_folder(tmp_path / "gone" / "new")
    check_folder(tmp_path / "new" / "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["gone"]


def test_what_fails_keeps_back_none_of_the_rest(tmp_path, capsys):
    done = []

    def work(name, error=None):
        def do():
            done.append(name)
            if error:
                raise error

        return do

    file = tmp_path / "r.json"
    args = parsed("--json", str(file))
    with pytest.raises(InputError, match="no picture"):
        _common.deliver(args, {"a": 1}, "table", work(1, InputError("no picture")), work(2))
    assert (done, json.loads(file.read_text())) == ([1, 2], {"a": 1})
    assert capsys.readouterr().out == "table\n"
    with pytest.raises(InputError, match="exists"):
        _common.deliver(args, {"a": 2}, "table", work(3))
    assert (done[2:], json.loads(file.read_text())) == ([3], {"a": 1})
    assert capsys.readouterr().out == "table\n"
    _common.deliver(parsed("--json", "-"), {"a": 3}, "table")
    assert json.loads(capsys.readouterr().out) == {"a": 3}


def test_workers():
    assert _common.workers_from(parsed("--workers", "3")) == 3
    assert _common.workers_from(parsed()) >= 1
    with pytest.raises(InputError, match="--workers 0"):
        _common.workers_from(parsed("--workers", "0"))


def test_progress(capsys):
    _common.progress(argparse.Namespace(quiet=False), "at work")
    _common.progress(argparse.Namespace(quiet=True), "silent")
    output = capsys.readouterr()
    assert (output.out, output.err) == ("", "at work\n")


def test_deliver_in_the_midst_of_an_interrupt(tmp_path, capsys):
    """The result is given; pictures, which take seconds, are not drawn."""
    drawn = []
    args = parsed("--json", str(tmp_path / "r.json"))

    def run():
        try:
            raise KeyboardInterrupt
        finally:
            _common.deliver(args, {"a": 1}, "table", lambda: drawn.append(1))

    with pytest.raises(KeyboardInterrupt):
        run()
    assert json.loads((tmp_path / "r.json").read_text()) == {"a": 1}
    assert capsys.readouterr().out == "table\n"
    assert drawn == []
