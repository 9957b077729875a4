"""Damage good files at random and read them: how often, how long, and with how much memory?

    python benchmarks/fuzz.py [COUNT] [--seed N] [--formats npz,hdf5,npy,pickle,csv,mat,matchid]

Every input must be read or refused with one line, within 5 s of processor time and four times the
file and 200 MB, running no code and opening nothing but itself. Inputs are read in child processes
of a thousand each, so that a crash of a library is one failure and not the end; HDF5 in that by the
process of bulgefit's own, which serves a folder's files and is replaced where a file ends it. A
failure is named by format, seed and number, which make the same input again.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import pickle
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

BATCH = 1000
SECONDS, BYTES = 5.0, 200_000_000
# A process that waits takes no processor time; other work on the machine may slow it tenfold.
LONGEST = 60.0
FORMATS = ("npz", "hdf5", "npy", "pickle", "csv", "mat", "matchid")
# What Python tells of code that runs; files are looked at one by one.
CODE = ("os.system", "os.exec", "os.spawn", "os.posix_spawn", "socket.connect")
SOURCE = str(Path(__file__).resolve().parents[1])


def good_files(folder: Path) -> dict[str, tuple[str, bytes]]:
    """Name and bytes of a good file of each format; of csv, of each file of its folder."""
    rng = np.random.default_rng(7)
    reference = rng.uniform(-60, 60, (20, 3))
    displacement = rng.normal(size=(3, 20, 3))
    arrays: dict[str, Any] = {
        "reference": reference,
        "displacement": displacement,
        "pressure": np.array([0.1, 0.2, 0.3]),
        "radius": 100.0,
        "thickness": 0.81,
        "time": np.arange(3.0),
    }
    np.savez_compressed(folder / "t.npz", **arrays)
    _write_hdf5(folder / "t.h5", arrays)
    rows = np.empty((3, 2), dtype=object)
    for i in range(3):
        rows[i, 0], rows[i, 1] = np.hstack([reference, displacement[i]]), 1e-4 * (i + 1)
    np.save(folder / "t.npy", rows, allow_pickle=True)
    (folder / "t.pkl").write_bytes(pickle.dumps(rows, protocol=2))
    names = {"npz": "t.npz", "hdf5": "t.h5", "npy": "t.npy", "pickle": "t.pkl"}
    return {kind: (name, (folder / name).read_bytes()) for kind, name in names.items()}


def _write_hdf5(path: Path, arrays: dict[str, Any]) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for key, value in arrays.items():
            packed = key == "displacement"
            file.create_dataset(key, data=value, compression="gzip" if packed else None)
            file[key].attrs["unit"] = {"pressure": "MPa", "time": "s"}.get(key, "mm")


def mat_file(folder: Path) -> bytes:
    """A MATLAB export of one frame with two areas of interest."""
    from scipy.io import savemat

    rng = np.random.default_rng(7)
    arrays = {
        f"{name}_{area}": rng.uniform(-60, 60, (4, 5)) for name in "XYZUVW" for area in (0, 1)
    }
    savemat(folder / "run_1bar.mat", arrays, do_compression=True)
    return (folder / "run_1bar.mat").read_bytes()


def matchid_file(folder: Path) -> bytes:
    """A MatchID test of three steps in one file."""
    import h5py

    rng = np.random.default_rng(7)
    names = ("Horizontal Displacement U", "Vertical Displacement V", "Out-Of-Plane: W")
    with h5py.File(folder / "m.h5", "w") as file:
        for name in ("X", "Y", "Z"):
            file[f"DIC Data/Point Data/{name}"] = rng.uniform(-60, 60, (3, 20))
        for name in names:
            file[f"DIC Data/Point Data/{name}"] = rng.uniform(-2, 2, (3, 20))
        file["DIC Data/Mapping Data/Spatial - Point Locations"] = rng.uniform(0, 999, (20, 2))
        file["DIC Data/Temporal Data/Force"] = np.array([[1.0, 2.0, 3.0]])
    return (folder / "m.h5").read_bytes()


def csv_files() -> dict[str, bytes]:
    """The files of a good folder of frames."""
    rng = np.random.default_rng(7)
    files = {"pressure.csv": b"file,pressure_bar\na.csv,1\nb.csv,2\n"}
    files["test.json"] = b'{"radius": 100, "thickness": 0.81}'
    for name in ("a.csv", "b.csv"):
        rows = rng.uniform(-60, 60, (8, 6))
        lines = ["x,y,z,dx,dy,dz", *(",".join(f"{value:.4f}" for value in row) for row in rows)]
        files[name] = "\n".join(lines).encode()
    return files


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Flip, cut, repeat, overwrite: one to four times."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(len(found) + 1))
        length = int(2 ** rng.uniform(0, 7))
        match rng.integers(6):
            case 0 if at < len(found):
                found[at] ^= 1 << int(rng.integers(8))
            case 1:
                del found[at : at + length]
            case 2:
                found[at:at] = found[at : at + length]
            case 3:
                found[at : at + length] = rng.bytes(length)
            case 4:  # numbers at the edges of what fits
                width = int(rng.choice([2, 4, 8]))
                edge = int(rng.choice([0, 1, -1, 2 ** (8 * width - 1) - 1, 1 << (4 * width)]))
                found[at : at + width] = edge.to_bytes(width, "little", signed=edge < 0)
            case _:
                found[at : at + 1] = rng.choice([b"\xff", b"\x00", b",", b'"', b"\n", b"9" * 30])
    return bytes(found)


def archived(data: bytes, rng: np.random.Generator) -> bytes:
    """An npz with one of its members damaged."""
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as good, zipfile.ZipFile(found, "w") as bad:
        hit = str(rng.choice(good.namelist()))
        for name in good.namelist():
            content = good.read(name)
            bad.writestr(name, damaged(content, rng) if name == hit else content)
    return found.getvalue()


def writers(folder: Path) -> dict[str, Callable[[np.random.Generator], Path]]:
    """For each format, what writes a damaged input and says where it is."""
    with tempfile.TemporaryDirectory() as good:
        single, csv = good_files(Path(good)), csv_files()
        single["matchid"] = ("m.h5", matchid_file(Path(good)))
        mat = mat_file(Path(good))

    def of(kind: str) -> Callable[[np.random.Generator], Path]:
        name, data = single[kind]

        def write(rng: np.random.Generator) -> Path:
            # a name of its own: of one that has ended the process apart no more is asked
            place = folder / f"{rng.integers(1 << 60)}{name}"
            place.write_bytes(damaged(data, rng))
            return place

        return write

    def write_npz(rng: np.random.Generator) -> Path:
        name, data = single["npz"]
        # half of them are damaged within the archive, whose checksums then are right
        spoil = archived if rng.integers(2) else damaged
        (folder / name).write_bytes(spoil(data, rng))
        return folder / name

    def write_csv(rng: np.random.Generator) -> Path:
        (folder / "csv").mkdir(exist_ok=True)
        hit = str(rng.choice(sorted(csv)))
        for name, data in csv.items():
            (folder / "csv" / name).write_bytes(damaged(data, rng) if name == hit else data)
        return folder / "csv"

    def write_mat(rng: np.random.Generator) -> Path:
        (folder / "mat").mkdir(exist_ok=True)
        (folder / "mat" / "run_1bar.mat").write_bytes(damaged(mat, rng))
        return folder / "mat"

    singly = {kind: of(kind) for kind in single}
    return {**singly, "npz": write_npz, "csv": write_csv, "mat": write_mat}


#: What exports do not say themselves.
TOLD: dict[str, dict[str, Any]] = {
    "mat": {"radius": 100.0, "thickness": 0.8, "pressure": "names"},
    "matchid": {
        "radius": 100.0, "thickness": 0.8, "pressure_column": "Force", "pressure_unit": "bar",
    },
}  # fmt: skip


def read_one(path: Path, kind: str) -> str:
    """`read` or `refused`; anything else is raised."""
    from bulgefit.dic import describe, read_test
    from bulgefit.errors import InputError

    try:
        describe(read_test(path, **TOLD.get(kind, {})))
    except InputError as error:
        if "\n" in str(error):
            raise AssertionError(f"not one line: {error}") from None
        return "refused"
    return "read"


def watch(folder: Path) -> None:
    """Raise where Python runs a program or opens a file outside the folder."""
    inside = str(folder.resolve())
    own = (sys.prefix, sys.base_prefix, SOURCE, f"/proc/{os.getpid()}/maps", os.devnull)

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        # HDF5 is read in a process of bulgefit's own
        own_process = event == "subprocess.Popen" and arguments[0] == sys.executable
        if event in CODE or (event == "subprocess.Popen" and not own_process):
            raise AssertionError(f"ran {event} {arguments}")
        # Python's own modules are imported when they are first needed; a descriptor is open already
        if event == "open" and isinstance(arguments[0], str):
            place = os.path.realpath(arguments[0])
            if not place.startswith((inside, *own)):
                raise AssertionError(f"opened {place}")

    sys.addaudithook(hook)


def batch(kind: str, seed: int, count: int, folder: Path) -> dict[str, object]:
    """Read `count` inputs of one format in this process."""
    from bulgefit.dic.hdf5_apart import one_helper

    write = writers(folder)[kind]
    read_one(write(np.random.default_rng(0)), kind)  # imports what is needed
    watch(folder)
    signal.signal(signal.SIGALRM, _too_long)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tally = {"read": 0, "refused": 0}
    slowest = 0.0
    with one_helper():
        for number in range(count):
            (folder / "now").write_text(f"{kind} {seed} {number}")
            path = write(np.random.default_rng((seed, number)))
            began = processor_time(), time.monotonic()
            signal.setitimer(signal.ITIMER_REAL, LONGEST)
            try:
                tally[read_one(path, kind)] += 1
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
                if path.is_file():
                    path.unlink()
            # a process that ended brings the time of all files that it has served
            took = min(processor_time() - began[0], time.monotonic() - began[1])
            slowest = max(slowest, took)
            if slowest > SECONDS:
                raise TimeoutError(f"took {slowest:.1f} s")
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if grown > BYTES:
        raise AssertionError(f"took {grown / 1e6:.0f} MB")
    return {**tally, "slowest": slowest, "memory": grown}


def processor_time() -> float:
    """Seconds that this process and those it waited for have used."""
    return sum(os.times()[:4])


def _too_long(*_: object) -> None:
    raise TimeoutError(f"took more than {LONGEST:g} s")


def batches(kind: str, seed: int, count: int) -> Iterator[tuple[str, dict[str, object]]]:
    """Each batch's input number and what its process says."""
    for start in range(0, count, BATCH):
        size = min(BATCH, count - start)
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, __file__, "--child", kind, str(seed + start), str(size)]
            done = subprocess.run(
                [*command, folder], capture_output=True, text=True, env=os.environ, check=False
            )
            if done.returncode == 0:
                yield "", json.loads(done.stdout)
            else:
                now = Path(folder) / "now"
                where = now.read_text() if now.exists() else kind
                last = done.stderr.strip().splitlines()[-1:] or [f"signal {-done.returncode}"]
                yield f"{where}: {last[0]}", {}


def main() -> int:
    """Run, tell a line a format, and leave with 1 where something failed."""
    if sys.argv[1:2] == ["--child"]:
        kind, seed, count, folder = sys.argv[2:]
        try:
            print(json.dumps(batch(kind, int(seed), int(count), Path(folder))))
        except BaseException:
            traceback.print_exc()
            return 1
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=100_000, help="inputs in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--formats", default=",".join(FORMATS))
    args = parser.parse_args()
    kinds = args.formats.split(",")
    failures = []
    print(f"{'format':<8}{'read':>9}{'refused':>9}{'failed':>8}{'slowest':>10}{'memory':>9}")
    for kind in kinds:
        tally = {"read": 0, "refused": 0, "failed": 0, "slowest": 0.0, "memory": 0.0}
        for failure, told in batches(kind, args.seed * 10**9, args.count // len(kinds)):
            if failure:
                failures.append(failure)
                tally["failed"] += 1
                continue
            for key in ("read", "refused"):
                tally[key] += int(str(told[key]))
            for key in ("slowest", "memory"):
                tally[key] = max(tally[key], float(str(told[key])))
        print(
            f"{kind:<8}{tally['read']:>9}{tally['refused']:>9}{tally['failed']:>8}"
            f"{tally['slowest']:>8.2f} s{tally['memory'] / 1e6:>6.0f} MB"
        )
    for failure in failures:
        print(failure)
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
