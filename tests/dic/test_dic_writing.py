"""Does an output appear whole or not at all?"""

from __future__ import annotations

import errno
import os
import resource
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from bulgefit.dic import read_test, write_test
from bulgefit.errors import InputError
from bulgefit.files import atomic_path, atomic_write_text, check_output


def test_existing_output_needs_force(made_test, tmp_path):
    path = tmp_path / "t.npz"
    path.write_text("old")
    with pytest.raises(InputError, match=r"t.npz: exists; use --force"):
        write_test(made_test, path)
    assert path.read_text() == "old"
    write_test(made_test, path, force=True)
    assert read_test(path).n_frames == 6
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.npz"]


@pytest.mark.parametrize("name", ["t.csv", "t", "t.npy"])
def test_unknown_suffix(made_test, tmp_path, name):
    with pytest.raises(InputError, match=r"a test is written as .npz, .h5, .hdf5"):
        write_test(made_test, tmp_path / name)


@pytest.mark.parametrize("name", ["t.npz", "t.h5"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES])
@pytest.mark.parametrize("call", ["open", "fsync", "replace"])
def test_a_failing_system_leaves_nothing(made_test, tmp_path, monkeypatch, name, code, call):
    def fail(*arguments, **options):
        raise OSError(code, os.strerror(code))

    (tmp_path / name).write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(f"bulgefit.files.os.{call}", fail)
        with pytest.raises(InputError, match=rf"cannot be written \({os.strerror(code)}\)"):
            write_test(made_test, tmp_path / name, force=True)
    assert (tmp_path / name).read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_a_file_that_the_system_cuts_short(made_test, tmp_path):
    # a real failure in the middle of writing: the system refuses files above 10 kB
    write_test(made_test, tmp_path / "in.npz")
    script = (
        "from bulgefit.dic import read_test, write_test\n"
        "from bulgefit.errors import InputError\n"
        f"test = read_test({str(tmp_path / 'in.npz')!r})\n"
        "try:\n"
        f"    write_test(test, {str(tmp_path / 'out.npz')!r})\n"
        "except InputError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)),
    )
    assert "cannot be written (File too large)" in done.stdout
    assert [entry.name for entry in tmp_path.iterdir()] == ["in.npz"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to read-only folders")
def test_read_only_folder(made_test, tmp_path):
    tmp_path.chmod(0o555)
    with pytest.raises(InputError, match="cannot be written"):
        write_test(made_test, tmp_path / "t.npz")
    tmp_path.chmod(0o755)


def test_an_error_of_the_writer_itself_passes(tmp_path):
    def write_half():
        with atomic_path(tmp_path / "t.txt") as path:
            path.write_text("half")
            raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        write_half()
    assert not list(tmp_path.iterdir())


def test_the_temporary_file_is_beside_and_keeps_the_suffix(tmp_path):
    with atomic_path(tmp_path / "t.vtu") as path:
        assert path.parent == tmp_path
        assert path.suffix == ".vtu"
        assert path.name.startswith(".t.")
        path.write_text("whole")
    assert (tmp_path / "t.vtu").read_text() == "whole"


def test_text_is_utf8_with_the_usual_rights(tmp_path):
    atomic_write_text(tmp_path / "t.txt", "µm")
    assert (tmp_path / "t.txt").read_bytes() == "µm".encode()
    (tmp_path / "usual").touch()
    assert stat.S_IMODE((tmp_path / "t.txt").stat().st_mode) == stat.S_IMODE(
        (tmp_path / "usual").stat().st_mode
    )


def test_a_symbolic_link_stays_one(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    atomic_write_text(tmp_path / "link.txt", "new", force=True)
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


def test_outputs_that_cannot_be(tmp_path):
    with pytest.raises(InputError, match="is a folder"):
        check_output(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        check_output(tmp_path / "no" / "t.npz")
    with pytest.raises(InputError, match="not a regular file"):
        check_output("/dev/null", force=True)
    assert Path("/dev/null").is_char_device()
