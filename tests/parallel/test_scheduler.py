"""Does --scheduler work, and say in one line why it does not?"""

from __future__ import annotations

import json
import socket
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic.writers import write_test
from bulgefit.fem.mesh import disc
from bulgefit.model.observation import operators
from bulgefit.model.simulation import simulate
from bulgefit.parallel import cluster as dask
from bulgefit.trial import run as trial
from bulgefit.trial.make import Recipe, make_test

TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
SMALL = ["--bounds", "E1=200:500,E2=150:400,G12=10:60", "--refine", "2", "--starts", "2"]
#: Just enough for a diagnosis to judge.
LITTLE = Recipe(frames=12, spacing=12.0, fineness=16)


@pytest.fixture(scope="module")
def tests_made(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Two made tests of 60 points."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-60, 60, (60, 2))
    pressure = np.array([0.05, 0.1, 0.2])
    mesh = disc(100.0, 2)
    seen = operators(mesh, points, "shape")(simulate(TRUTH, pressure, mesh=mesh).displacement)
    files = []
    for i in range(2):
        files.append(str(tmp_path_factory.mktemp("made") / f"test{i}.npz"))
        np.savez(
            files[-1],
            reference=np.column_stack([points, np.zeros(60)]),
            displacement=seen + rng.normal(0, 0.01, seen.shape),
            pressure=pressure,
            radius=100.0,
            thickness=0.81,
            poisson_ratio=0.24,
        )
    return files


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line on stderr."""
    assert main([*words, "--quiet"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize("verb", ["fit", "crossval"])
def test_a_cluster_gives_the_same(
    verb: str, tests_made: list[str], cluster: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for where in (["--workers", "1"], ["--scheduler", cluster]):
        assert main([verb, *tests_made, *SMALL, *where, "--json", "-", "--quiet"]) == 0
        output = capsys.readouterr()
        found.append(json.loads(output.out))
        found[-1].pop("seconds", None)
        del found[-1]["run"]  # the command and its date
    assert found[0] == found[1]


def test_a_diagnosis_on_a_cluster(
    cluster: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "made.npz"
    write_test(make_test("clamp_slip", 0, LITTLE).test, file)
    words = ["diagnose", str(file), "--effects", "clamp_slip,rigid_motion", "--json", "-"]
    found = []
    # one worker finds the same as two: tests/gap/test_gap_diagnose.py
    for where in (["--workers", "2"], ["--scheduler", cluster]):
        assert main([*words, *where, "--quiet"]) == 0
        found.append(json.loads(capsys.readouterr().out))
        del found[-1]["meta"]["seconds"], found[-1]["run"]
    assert found[0] == found[1]
    assert found[0]["verdict"] == "named"


def test_a_trial_on_a_cluster(
    cluster: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = trial.run_trial

    def little(*numbers: int, **options: Any) -> dict[str, Any]:
        few = {"effects": ["clamp_slip", "rigid_motion"]}
        return whole(*numbers, **{**options, "recipe": LITTLE, "options": few})

    monkeypatch.setattr(trial, "run_trial", little)
    found = []
    for name, where in (("here", ["--workers", "1"]), ("there", ["--scheduler", cluster])):
        words = ["--number", "1", "--effects", "none", "--output", str(tmp_path / name)]
        assert main(["trial", *words, *where, "--json", "-", "--quiet"]) == 0
        found.append(json.loads(capsys.readouterr().out))
        del found[-1]["meta"]["seconds"], found[-1]["run"]
    assert found[0] == found[1]
    assert found[0]["tests"][0]["verdict"] == "none"


@pytest.mark.parametrize(
    "address", ["here", "tcp://here", "tcp://127.0.0.1", "http://127.0.0.1:80", "tcp://a:b", "tcp:"]
)
def test_bad_addresses(
    address: str, tests_made: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    said = refused(capsys, "fit", *tests_made, *SMALL, "--scheduler", address)
    assert "give its address as tcp://host:port" in said


@pytest.mark.parametrize("speaks", [None, b"", b"SSH-2.0-OpenSSH_9.2", b"short"])
def test_nobody_or_somebody_else_answers(
    speaks: bytes | None,
    tests_made: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(dask, "PATIENCE", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        if speaks is None:
            server.close()
        else:

            def answer() -> None:
                with server.accept()[0] as line, suppress(OSError):
                    line.sendall(speaks)
                    line.settimeout(5)
                    line.recv(1)

            threading.Thread(target=answer, daemon=True).start()
        said = refused(capsys, "fit", *tests_made, *SMALL, "--scheduler", address)
    assert f"scheduler {address}: no Dask scheduler answers there (" in said
    assert "start one with `dask scheduler`" in said


def test_a_scheduler_without_workers(
    tests_made: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask, "PATIENCE", 0.5)
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0", protocol="tcp") as empty:
        said = refused(capsys, "fit", *tests_made, *SMALL, "--scheduler", empty.scheduler_address)
    assert "it has no workers; start some with `dask worker tcp://" in said


def test_workers_with_other_versions(
    tests_made: list[str],
    cluster: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dask, "version", lambda name: "0.0")
    said = refused(capsys, "fit", *tests_made, *SMALL, "--scheduler", cluster)
    assert "(here 0.0)" in said
    assert "install there what is installed here" in said


def test_dask_is_not_installed(
    tests_made: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    folder = tmp_path / "trial"
    fit, diagnose = ["fit", *tests_made, *SMALL], ["diagnose", *tests_made]
    for words in (fit, diagnose, ["trial", "--output", str(folder)]):
        said = refused(capsys, *words, "--scheduler", "tcp://127.0.0.1:8786")
        assert "pip install 'bulgefit[cluster]'" in said
    assert not folder.exists()


def test_not_with_workers(tests_made: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--scheduler", "tcp://127.0.0.1:8786", "--workers", "2"]
    assert "do not go together" in refused(capsys, "fit", *tests_made, *SMALL, *words)
