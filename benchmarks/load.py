"""Do diagnoses hold under load: others beside them, a stall, a lost scheduler, a slow disk?

    python benchmarks/load.py [--runs 8] [--cases together,stalled,restarted,slow]

A trial of two made tests, which two workers diagnose, is run alone. With what it gives the others
are compared, to the last bit:

- together: eight of them side by side, each with two workers of its own: twenty-four processes, of
  which none may grow by more than a tenth;
- stalled: one of the workers is stopped (SIGSTOP) in the midst of its diagnosis;
- restarted: the work is done on a Dask cluster, whose scheduler is killed in the midst of it and
  started again at its address, as are workers that leave with it. The trial goes on, or ends with
  one line and is taken up with --resume;
- slow: every file that is opened, read, written, brought to the disk, renamed or removed is waited
  for. strace does that, so the disk is slow for each of the processes and for all that they load.

Leaves with status 1 where something differs, is left behind, or is not told.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kills import ENDING, VERBS, begun, contents, prepared, processes

WORDS, RESUME = VERBS["trial"]
#: Seconds after which a run hangs: ten times what one alone takes, and a minute for a stall.
LONGEST = 10.0
#: Seconds of processor time after which a worker is in the midst of a diagnosis.
BUSY = 8.0
#: System calls and how long the disk takes for them.
DISK = {
    "openat,newfstatat,unlink,unlinkat": "2ms",
    "read,pread64,write,pwrite64": "2ms",
    "fsync,fdatasync,rename,renameat,renameat2": "1s",
}

Content = dict[str, object]


def side_by_side(folders: list[Path]) -> tuple[list[Content], float, float]:
    """What each trial leaves in its folder; seconds, and MB of the largest process so far."""
    began = time.monotonic()
    runs = [begun(WORDS, prepared(folder)) for folder in folders]
    for run in runs:
        said = run.communicate()[1]
        assert run.returncode == 0, said
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    seconds = time.monotonic() - began
    return [contents(folder, hidden=True) for folder in folders], seconds, largest


def together(place: Path, alone: Content, seconds: float, runs: int) -> list[str]:
    """Many side by side."""
    small = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    place.mkdir()
    found, took, large = side_by_side([place / str(k) for k in range(runs)])
    print(
        f"{runs} side by side: {took:.0f} s, largest process {large:.0f} MB, alone {small:.0f} MB"
    )
    wrong = [f"run {k} differs" for k, result in enumerate(found) if result != alone]
    return wrong + ["a process grew"] * (large > 1.1 * small)


def stalled(place: Path, alone: Content, seconds: float, runs: int) -> list[str]:
    """A worker that is stopped."""
    run = begun(WORDS, prepared(place))
    began = time.monotonic()
    os.kill(busy(run, lambda: processes(run.pid)), signal.SIGSTOP)
    said = ended(run, LONGEST * seconds + 60.0)
    print(f"a worker stopped: {time.monotonic() - began:.0f} s, status {run.returncode} {said}")
    return left_behind(run) + differences(place, alone)


def restarted(place: Path, alone: Content, seconds: float, runs: int) -> list[str]:
    """A scheduler that is killed and started again."""
    with cluster() as (address, kill, workers):
        words = without(WORDS, "--workers")
        run = begun((*words, "--scheduler", address), prepared(place))
        began = time.monotonic()
        busy(run, workers)
        kill()
        said = ended(run, LONGEST * seconds)
        print(
            f"the scheduler restarted: {time.monotonic() - began:.0f} s, status {run.returncode}"
            f" {said}"
        )
        wrong = left_behind(run)
        if run.returncode != 0:
            if run.returncode != 2 or said.count("\n") != 1:
                wrong.append(f"it ended with {said!r}")
            wait_for_workers(address)
            again = begun((*words, "--scheduler", address, RESUME), place)
            said = ended(again, LONGEST * seconds)
            print(f"taken up: {time.monotonic() - began:.0f} s, status {again.returncode} {said}")
    return wrong + differences(place, alone)


def slow(place: Path, alone: Content, seconds: float, runs: int) -> list[str]:
    """A disk that takes its time."""
    strace = shutil.which("strace")
    if strace is None:
        print("a slow disk: not run, strace is not installed")
        return []
    traced = ",".join(DISK)
    late = [f"--inject={calls}:delay_enter={wait}" for calls, wait in DISK.items()]
    before = (strace, "-f", "--seccomp-bpf", "-qqq", "-o", "/dev/null", f"--trace={traced}", *late)
    began = time.monotonic()
    run = begun(WORDS, prepared(place), before)
    said = ended(run, 4.0 * LONGEST * seconds)
    print(f"a slow disk: {time.monotonic() - began:.0f} s, status {run.returncode} {said}")
    return left_behind(run) + differences(place, alone)


def busy(run: subprocess.Popen[str], lines: Callable[[], dict[int, str]]) -> int:
    """The first worker process of some that is in the midst of its work."""
    while run.poll() is None:
        for pid, line in lines().items():
            if "spawn_main" in line and processor_time(pid) > BUSY:
                return pid
        time.sleep(0.05)
    raise AssertionError("it ended before")


def wait_for_workers(address: str) -> None:
    """Until a cluster has both of them again."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2)


def processor_time(pid: int) -> float:
    """Seconds that a process has used; none where it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return float(int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ended(run: subprocess.Popen[str], seconds: float) -> str:
    """What a run said by its end; one that does not end is killed, with all that belongs to it."""
    try:
        return run.communicate(timeout=seconds)[1]
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return f"it did not end in {seconds:.0f} s\n"


def left_behind(run: subprocess.Popen[str]) -> list[str]:
    """Processes of a run that are there after it."""
    until = time.monotonic() + ENDING
    while left := processes(run.pid):
        if time.monotonic() > until:
            os.killpg(run.pid, signal.SIGKILL)
            return [f"still there: {left}"]
        time.sleep(0.1)
    return []


def differences(place: Path, alone: Content) -> list[str]:
    """Files that are not as those of a run alone."""
    found = contents(place, hidden=True)
    return [f"{n} differs" for n in {**found, **alone} if found.get(n) != alone.get(n)]


def without(words: tuple[str, ...], option: str) -> tuple[str, ...]:
    """Words without an option and its value."""
    at = words.index(option)
    return words[:at] + words[at + 2 :]


class Kept:
    """A process that is started again whenever it ends, as a system's own keeper would."""

    def __init__(self, *words: str) -> None:
        self._words, self._wanted = words, True
        self._start()
        self._keeper = threading.Thread(target=self._keep)
        self._keeper.start()

    def _start(self) -> None:
        none = subprocess.DEVNULL
        self.process = subprocess.Popen(
            self._words, stdout=none, stderr=none, start_new_session=True
        )

    def _keep(self) -> None:
        while self._wanted:
            self.process.wait()
            time.sleep(0.5)
            if self._wanted:
                self._start()

    def kill(self) -> None:
        """Once, by SIGKILL."""
        self.process.kill()

    def end(self) -> None:
        """For good, with its own children."""
        self._wanted = False
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self._keeper.join()


@contextmanager
def cluster() -> Iterator[tuple[str, Callable[[], None], Callable[[], dict[int, str]]]]:
    """Address of a scheduler with two workers; what kills it; what tells the workers' processes."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    dask = (sys.executable, "-m", "dask")
    scheduler = Kept(*dask, "scheduler", "--port", str(port), "--no-dashboard")
    worker = (*dask, "worker", address, "--nthreads", "1", "--no-dashboard")
    workers = [Kept(*worker) for _ in range(2)]
    try:
        while not answers(port):
            time.sleep(0.1)
        yield (
            address, scheduler.kill,
            lambda: {p: line for k in workers for p, line in processes(k.process.pid).items()},
        )  # fmt: skip
    finally:
        for kept in (*workers, scheduler):
            kept.end()


def answers(port: int) -> bool:
    """Whether something listens there."""
    with socket.socket() as line:
        return line.connect_ex(("127.0.0.1", port)) == 0


CASES = {"together": together, "stalled": stalled, "restarted": restarted, "slow": slow}


def main() -> int:
    """One alone, then the cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--cases", default=",".join(CASES))
    args = parser.parse_args()
    wrong = []
    with tempfile.TemporaryDirectory() as place:
        (alone,), seconds, _ = side_by_side([Path(place, "alone")])
        print(f"alone: {seconds:.0f} s")
        for name in args.cases.split(","):
            found = CASES[name](Path(place, name), alone, seconds, args.runs)
            wrong += [f"{name}: {fault}" for fault in found]
    print("\n".join(wrong) or "all the same")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
