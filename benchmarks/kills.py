"""Is anything lost where a verb is killed by SIGKILL at a random moment, itself or a worker?

    python benchmarks/kills.py --number 200 --seed 0

Each verb is run once in peace. Then it is begun again and again and killed at moments that are
drawn between its begin and the seconds that it took, the process itself or one of its workers.
After each kill

- no process of it is left,
- no input has changed,
- no file is there that is not whole: but for journals and hidden ones, all are as in peace or not
  there at all,
- and the same command with --resume (convert and align: --force) gives the same result to the last
  bit, and leaves nothing else.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

DATA = Path(__file__).parents[1] / "data"
EXAMPLES = ("example_bulge.npz", "example_slip.npz")
ONE, TWO = EXAMPLES
#: The second as a camera sees it whose axes are turned: with two causes, workers refit.
TURNED, ANGLE = "turned.npz", 1.0  # degree, about x
INPUTS = (*EXAMPLES, TURNED)

_SHORT = ("--bounds", "E1=300:400,E2=200:300,G12=20:40", "--refine", "2", "--max-evaluations", "6")

#: Words of each verb, and what takes up a run that was killed.
VERBS: dict[str, tuple[tuple[str, ...], str]] = {
    "fit": (
        ("fit", ONE, *_SHORT, "--starts", "2", "--bootstrap", "20", "--json", "out.json"),
        "--resume",
    ),
    "crossval": (
        ("crossval", ONE, TWO, *_SHORT, "--max-pressure", "1", "--json", "out.json"),
        "--resume",
    ),
    "diagnose": (
        (
            *("diagnose", TURNED, "--effects", "clamp_slip,frame_misalignment,prestrain"),
            *("--max-pressure", "1.2", "--workers", "2", "--json", "out.json"),
        ),
        "--resume",
    ),
    "trial": (
        ("trial", "--number", "2", "--effects", "none", "--output", "out", "--workers", "2"),
        "--resume",
    ),
    "convert": (("convert", ONE, "out.h5", "--rotate", "30"), "--force"),
    "align": (("align", ONE, "out.npz"), "--force"),
}

#: Seconds within which workers end after their parent.
ENDING = 20.0


def begun(
    words: tuple[str, ...], folder: Path, before: tuple[str, ...] = ()
) -> subprocess.Popen[str]:
    """A verb in a session of its own, so that its processes can be told; words before it."""
    return subprocess.Popen(
        [*before, sys.executable, "-m", "bulgefit", *words, "--quiet"],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def processes(session: int) -> dict[int, str]:
    """Command lines of the living processes of a session."""
    found = {}
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, *_ = fields = (place / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and state not in "ZX":
                words = (place / "cmdline").read_bytes().split(b"\0")
                found[int(place.name)] = b" ".join(words).decode(errors="replace")
    return found


def prepared(folder: Path) -> Path:
    """A new folder with the inputs."""
    folder.mkdir()
    for name in EXAMPLES:
        shutil.copy(DATA / name, folder)
    with np.load(DATA / TWO) as file:
        arrays = dict(file)
    turn = Rotation.from_euler("x", ANGLE, degrees=True).as_matrix()
    arrays["displacement"] = (arrays["displacement"] @ turn.T).astype(np.float32)
    np.savez(folder / TURNED, **arrays)
    return folder


def bare(value: Any) -> Any:
    """A result without the seconds that it took, and the command and date of its run."""
    if isinstance(value, dict):
        return {k: bare(v) for k, v in value.items() if k not in ("seconds", "run")}
    return [bare(v) for v in value] if isinstance(value, list) else value


def contents(folder: Path, *, hidden: bool) -> dict[str, object]:
    """What stands in a folder: JSON without seconds, of other files the checksum."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or (not hidden and (path.name[0] == "." or path.suffix == ".part")):
            continue
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".json":
            found[name] = bare(json.loads(path.read_text()))
        else:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def in_peace(verb: str, folder: Path) -> tuple[dict[str, object], float]:
    """What a verb writes, and the seconds that it takes."""
    began = time.monotonic()
    run = begun(VERBS[verb][0], prepared(folder))
    said = run.communicate()[1]
    assert run.returncode == 0, said
    return contents(folder, hidden=True), time.monotonic() - began


def killed(
    verb: str, folder: Path, whole: dict[str, object], seconds: float, draw: random.Random
) -> str:
    """Kill a verb once and take it up again; who was killed, after how long, and what was done."""
    words, again = VERBS[verb]
    run = begun(words, prepared(folder))
    delay = draw.uniform(0.0, seconds)
    worker = draw.random() < 0.5
    with suppress(subprocess.TimeoutExpired):
        run.wait(delay)
    others = [pid for pid, line in processes(run.pid).items() if "spawn_main" in line]
    victim = draw.choice(others) if worker and others else run.pid
    with suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
    said = run.communicate()[1]
    until = time.monotonic() + ENDING
    while left := processes(run.pid):
        assert time.monotonic() < until, f"still there: {left}"
        time.sleep(0.1)
    there = contents(folder, hidden=False)
    assert all(there[name] == whole[name] for name in INPUTS), "an input has changed"
    for name, content in there.items():
        assert content == whole.get(name), f"{name} is not as in peace"
    if run.returncode != 0:
        assert victim == run.pid, f"the loss of a worker ended it: {said}"
    # killed once all was written, there is nothing to take up; its journal may lie there still
    if run.returncode != 0 and there != whole:
        next_one = begun((*words, again), folder)
        said = next_one.communicate()[1]
        assert next_one.returncode == 0, said
    end = contents(folder, hidden=run.returncode == 0 or there != whole)
    assert end == whole, f"differs in {[n for n in {**end, **whole} if end.get(n) != whole.get(n)]}"
    who = "worker" if victim != run.pid else "itself"
    return f"{verb:<9} {who:<6} after {delay:5.1f} s: as in peace"


def kills(verbs: list[str], number: int, seed: int, folder: Path) -> list[str]:
    """A line for each kill, the verbs in turn."""
    draw = random.Random(seed)
    peace = {verb: in_peace(verb, folder / verb) for verb in verbs}
    lines = []
    for index in range(number):
        verb = verbs[index % len(verbs)]
        place = folder / f"{index}"
        lines.append(killed(verb, place, *peace[verb], draw))
        shutil.rmtree(place)
        print(f"{index + 1:4d} {lines[-1]}", flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbs", default=",".join(VERBS))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lines = kills(args.verbs.split(","), args.number, args.seed, Path(folder))
    print(f"{len(lines)} kills; nothing was lost")


if __name__ == "__main__":
    main()
