"""One result wherever the work is done, whoever dies over it, and the data sent once."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.errors import BulgefitError, InputError
from bulgefit.fitting.bootstrap import bootstrap
from bulgefit.fitting.fit import fit
from bulgefit.fitting.result import FitResult
from bulgefit.model.setup import Setup
from bulgefit.parallel.parcels import sent_once
from bulgefit.parallel.processes import Processes
from bulgefit.parallel.spread import spread
from bulgefit.parallel.workers import open_executor

Maker = Callable[..., BulgeTest]
BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}


class Data:
    """Something large that writes down which process unpickles it."""

    def __init__(self, log: Path) -> None:
        self.log = log

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state
        with self.log.open("a") as file:
            file.write(f"{os.getpid()}\n")

    def readers(self) -> list[int]:
        """The processes that unpickled it, in order."""
        return [int(line) for line in self.log.read_text().split()] if self.log.exists() else []


@sent_once
class Measured(Data):
    """Data that never change."""


def who_of(shared: tuple[Measured, str], item: int) -> tuple[int, int]:
    data, call = shared
    assert call in ("first", "second")
    return who(data, item)


def who(data: Data, item: int) -> tuple[int, int]:
    assert data.log.name == "readers"
    time.sleep(0.05)
    return os.getpid(), item


def die_once(data: Data, item: int) -> int:
    """The process that gets item 2 kills itself, the first time."""
    mark = data.log.with_name("died")
    time.sleep(0.1)
    if item == 2 and not mark.exists():
        mark.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def stop_once(data: Data, item: int) -> int:
    """The process that gets item 2 stops itself, the first time."""
    mark = data.log.with_name("stopped")
    if item == 2 and not mark.exists():
        mark.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGSTOP)
    return item * item


def take_long(data: Data, item: int) -> int:
    """Longer than a process that stands still is waited for."""
    with data.log.with_name("begun").open("a") as file:
        file.write("x")
    time.sleep(6.0)
    return item


def tell(data: None, item: int) -> tuple[int, int]:
    return os.getpid(), item


def die_when_busy(dask_worker: Any) -> None:
    """Let a worker of a cluster kill itself in the midst of its first task from now on."""

    def wait() -> None:
        while not dask_worker.state.executing:
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def die(data: None, item: int) -> None:
    os._exit(1)


def refuse(data: None, item: int) -> None:
    raise InputError(f"item {item} is refused")


def test_threads_share_the_data_themselves(tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    with open_executor(2) as pool:
        found = spread(pool, who, data, range(6))
    assert found == [(os.getpid(), i) for i in range(6)]
    assert data.readers() == []


@pytest.mark.parametrize("own", [True, False], ids=["ours", "the caller's"])
def test_each_process_reads_the_data_once(own: bool, tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    with Processes(2) if own else ProcessPoolExecutor(2) as pool:
        for _ in range(2):
            found = spread(pool, who, data, range(10))
    workers = {pid for pid, _ in found}
    assert [item for _, item in found] == list(range(10))
    assert os.getpid() not in workers
    assert workers <= set(data.readers())
    assert len(data.readers()) == len(set(data.readers())) <= 2


def test_each_worker_of_a_cluster_reads_the_data_once(cluster: str, tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    with open_executor(scheduler=cluster) as pool:
        found = spread(pool, who, data, range(20))
    workers = [pid for pid, _ in found]
    assert [item for _, item in found] == list(range(20))
    assert len(set(workers)) == 2
    assert sorted(data.readers()) == sorted(set(workers))


@pytest.mark.parametrize("place", ["processes", "cluster"])
def test_what_never_changes_is_sent_for_the_first_call_alone(
    place: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    data, other = Measured(tmp_path / "readers"), Measured(tmp_path / "other" / "readers")
    other.log.parent.mkdir()
    options: dict[str, Any] = {"workers": 2, "processes": True}
    if place == "cluster":
        options = {"scheduler": request.getfixturevalue("cluster")}
    with open_executor(**options) as pool:
        workers = {pid for pid, _ in spread(pool, who_of, (data, "first"), range(20))}
        workers |= {pid for pid, _ in spread(pool, who_of, (data, "second"), range(20))}
        assert sorted(data.readers()) == sorted(workers)
        spread(pool, who_of, (other, "first"), range(20))
        assert set(other.readers()) <= workers
    assert len(workers) == 2


def test_files_of_what_is_sent_go_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = tmp_path / "files"
    files.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(files))
    data = Measured(tmp_path / "readers")
    with open_executor(1, processes=True) as pool:
        for call in ("first", "second"):
            spread(pool, who_of, (data, call), range(2))
            assert len(list(files.iterdir())) == 1
    del data
    assert not list(files.iterdir())


def test_a_process_that_dies_is_replaced(tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    said: dict[int, int] = {}
    with open_executor(2, processes=True) as pool:
        found = spread(pool, die_once, data, range(6), said.__setitem__)
    assert (tmp_path / "died").exists()
    assert found == [0, 1, 4, 9, 16, 25]
    assert said == dict(enumerate(found))


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals that stop a process")
def test_a_process_that_stands_still_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped in the midst of its task; one that merely takes long is left alone."""
    monkeypatch.setattr("bulgefit.parallel.spread.SILENCE", 0.2)
    data = Data(tmp_path / "readers")
    with open_executor(2, processes=True) as pool:
        assert spread(pool, stop_once, data, range(4)) == [0, 1, 4, 9]
    stopped = int((tmp_path / "stopped").read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(stopped, 0)
    with open_executor(1, processes=True) as pool:
        assert spread(pool, take_long, data, [5]) == [5]
    assert (tmp_path / "begun").read_text() == "x"


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals that stop a process")
def test_a_process_that_stands_still_is_not_waited_for_at_the_end() -> None:
    with open_executor(1, processes=True) as pool:
        [(stopped, _)] = spread(pool, tell, None, [0])
        os.kill(stopped, signal.SIGSTOP)
    with pytest.raises(ProcessLookupError):
        os.kill(stopped, 0)


def test_processes_that_always_die_are_given_up() -> None:
    with (
        open_executor(2, processes=True) as pool,
        pytest.raises(BulgefitError, match=r"3 of 3 tasks were lost 3 times .* fewer workers"),
    ):
        spread(pool, die, None, range(3))
    with (
        ProcessPoolExecutor(1) as pool,
        pytest.raises(BulgefitError, match="a worker process died, and its executor with it"),
    ):
        spread(pool, die, None, range(3))


def test_a_worker_of_a_cluster_that_dies(cluster: str, tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    with open_executor(scheduler=cluster) as pool:
        assert spread(pool, die_once, data, range(8)) == [i * i for i in range(8)]
    assert (tmp_path / "died").exists()


def linger(data: Measured | None, item: int) -> int:
    time.sleep(0.5)
    return item


class Cluster:
    """A scheduler and its worker, as their own processes; `begin` starts them, also once more."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self._port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self._port}"
        self.begun: list[subprocess.Popen[bytes]] = []
        self.begin()
        _wait_for(self._port)

    def begin(self) -> None:
        """Start both of them."""
        scheduler = ("scheduler", "--port", str(self._port), "--no-dashboard")
        for words in (scheduler, ("worker", self.address, "--no-nanny", "--no-dashboard")):
            program = [sys.executable, "-m", "dask", *words]
            quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            self.begun.append(subprocess.Popen(program, **quiet))

    def lose(self) -> None:
        """Kill the scheduler, once; its worker ends by itself."""
        self.begun[0].kill()

    def end(self) -> None:
        """Kill all that was begun."""
        for process in self.begun:
            process.kill()
            process.wait()


@pytest.fixture
def own_cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    """One that may be lost."""
    pytest.importorskip("distributed")
    # the worker, which is not our child, has to find `linger`
    places = [str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(places))
    # a machine under load may take longer to start it again
    monkeypatch.setattr("bulgefit.parallel.cluster.PATIENCE", 60.0)
    cluster = Cluster()
    yield cluster
    cluster.end()


def test_a_scheduler_that_dies_is_told_of(
    own_cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_executor(scheduler=own_cluster.address) as pool:
        monkeypatch.setattr("bulgefit.parallel.cluster.PATIENCE", 0.5)
        with pytest.raises(BulgefitError, match="the cluster's scheduler was lost"):
            spread(pool, linger, None, range(40), lambda index, result: own_cluster.lose())


def test_what_a_scheduler_had_is_done_again_where_it_is_restarted(
    own_cluster: Cluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """In the midst of a call; the next one is done by the worker that has the data since."""
    data = Measured(tmp_path / "readers")

    def restart(index: int, result: int) -> None:
        if len(own_cluster.begun) == 2:
            own_cluster.lose()
            own_cluster.begin()

    with open_executor(scheduler=own_cluster.address) as pool:
        assert spread(pool, linger, data, range(12), restart) == [*range(12)]
        assert spread(pool, linger, data, range(2)) == [*range(2)]
        assert len(data.readers()) == len(set(data.readers())) == 2
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def _wait_for(port: int) -> None:
    def answers() -> bool:
        with socket.socket() as line:
            return line.connect_ex(("127.0.0.1", port)) == 0

    while not answers():
        time.sleep(0.1)


def test_errors_of_tasks_come_through(cluster: str) -> None:
    for options in ({}, {"processes": True}, {"scheduler": cluster}):
        with (
            open_executor(1, **options) as pool,
            pytest.raises(InputError, match="item 0 is refused"),
        ):
            spread(pool, refuse, None, [0])


class Losing(Executor):
    """A cluster that lost the data that its tasks need, for a while."""

    def __init__(self, times: int) -> None:
        self.times, self.status, self._client, self.id = times, "running", self, "client"
        self.parcels: list[SimpleNamespace] = []
        self.scheduler = SimpleNamespace(address="inproc://here")

    def scatter(self, values: list[Any], **_: Any) -> list[Any]:
        self.times -= 1
        self.parcels = [SimpleNamespace(opened=v.opened, status="finished") for v in values]
        return self.parcels

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if self.times < 0:
            future.set_result(fn(*args))
        else:
            future.cancel()
            future.set_running_or_notify_cancel()
        return future


def test_a_client_that_does_not_notice_its_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its futures are never finished and never cancelled, and it says that it runs."""
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    monkeypatch.setattr("bulgefit.parallel.spread.SILENCE", 0.1)
    monkeypatch.setattr("bulgefit.parallel.cluster.PATIENCE", 0.1)
    deaf = Losing(0)
    deaf.scheduler = SimpleNamespace(address=f"tcp://127.0.0.1:{port}")
    monkeypatch.setattr(deaf, "submit", lambda *_: Future())
    with pytest.raises(BulgefitError, match="the cluster's scheduler was lost"):
        spread(deaf, who, None, range(3))


def test_data_that_a_cluster_lost_are_sent_again(tmp_path: Path) -> None:
    data = Data(tmp_path / "readers")
    assert [i for _, i in spread(Losing(1), who, data, range(3))] == [0, 1, 2]
    with pytest.raises(BulgefitError, match="3 of 3 tasks were lost 3 times"):
        spread(Losing(3), who, data, range(3))
    gone = Losing(1)
    gone.status = "closed"
    with pytest.raises(BulgefitError, match="scheduler was lost"):
        spread(gone, who, data, range(3))


def test_a_scheduler_that_goes_away_while_it_is_sent_data(tmp_path: Path) -> None:
    """And answers again at once."""
    data, cluster = Data(tmp_path / "readers"), Losing(0)
    scatter, refused = cluster.scatter, [OSError("closed"), TimeoutError("no workers")]

    def lost_at_first(values: list[Any], **options: Any) -> list[Any]:
        if refused:
            raise refused.pop()
        return scatter(values, **options)

    cluster.scatter = lost_at_first  # type: ignore[method-assign]
    assert [i for _, i in spread(cluster, who, data, range(3))] == [0, 1, 2]
    assert not refused


def test_only_what_a_cluster_lacks_is_sent(tmp_path: Path) -> None:
    data, cluster = Measured(tmp_path / "readers"), Losing(0)

    def parcels_of(call: str) -> list[SimpleNamespace]:
        assert [i for _, i in spread(cluster, who_of, (data, call), range(2))] == [0, 1]
        return cluster.parcels

    _, held = parcels_of("first")
    assert len(parcels_of("second")) == 1
    held.status = "lost"
    assert len(parcels_of("second")) == 2


def same_but_for_time(result: FitResult) -> dict[str, Any]:
    found = result.to_dict()
    del found["seconds"]
    return found


def test_a_fit_is_the_same_to_the_last_bit(
    make: Maker, setup: Setup, cluster: str, tmp_path: Path
) -> None:
    """One thread, two, two processes, and a cluster of which a worker is killed in mid-run."""
    distributed = pytest.importorskip("distributed")
    tests = [make(noise=0.05, name="a"), make(noise=0.05, seed=1, name="b")]
    options: dict[str, Any] = {"bounds": BOUNDS, "starts": 6, "setup": setup}
    one = same_but_for_time(fit(tests, **options))
    assert same_but_for_time(fit(tests, workers=2, **options)) == one
    with open_executor(2, processes=True) as pool:
        assert same_but_for_time(fit(tests, executor=pool, **options)) == one
    with distributed.Client(cluster, set_as_default=False) as client:
        address, doomed = min(client.run(os.getpid).items())
        client.run(die_when_busy, workers=[address])
        found = same_but_for_time(fit(tests, executor=client.get_executor(), **options))
        assert doomed not in client.run(os.getpid).values()
    assert found == one


def read(log: str, *parts: Any) -> Block:
    """A block, in the process that unpickles it; an apex alone is nothing to speak of."""
    block = Block(*parts)
    if len(block.reference) > 1:
        with Path(log).open("a") as file:
            file.write(f"{os.getpid()}\n")
    return block


def test_a_fit_and_its_bootstrap_send_the_data_once(
    make: Maker, setup: Setup, cluster: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, packed = tmp_path / "readers", Block.__reduce__
    monkeypatch.setattr(Block, "__reduce__", lambda self: (read, (str(log), *packed(self)[1])))
    test = make(noise=0.05)
    options: dict[str, Any] = {"bounds": BOUNDS, "setup": setup}
    alone = bootstrap(fit(test, **options), test, replicates=4)
    assert not log.exists()
    with open_executor(scheduler=cluster) as pool:
        for name in ("e", "e_w"):
            found = fit(test, name, executor=pool, **options)
        sure = bootstrap(found, test, replicates=4, executor=pool)
    readers = log.read_text().split()
    assert len(readers) == len(set(readers)) == 2
    assert sure.values.tolist() == alone.values.tolist()
