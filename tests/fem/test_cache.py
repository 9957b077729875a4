"""Are compiled kernels kept, and dropped when a source that went into them changes?"""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit
from numba.core.errors import TypingError
from numba.extending import overload

import bulgefit
from bulgefit.fem import jit

#: A kernel that is quick to compile, but stamped like the others.
SCRIPT = """
import numpy as np
from bulgefit.fem.kernels import assemble_pressure
assert not assemble_pressure.signatures, "compiled at import"
x = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
assemble_pressure(x, np.array([[0, 1, 2, 3]]), np.ones(1), np.empty((4, 3)))
print(sum(assemble_pressure.stats.cache_hits.values()))
"""


#: A membrane that is wrinkled here and there, where a point takes the most arithmetic.
WRINKLED = """
import hashlib
import numpy as np
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
mesh = disc(100.0, 3)
x, y = mesh.nodes.T
height = 1.0 - (x**2 + y**2) / 1e4
u = np.stack([-0.02 * x * height * np.cos(y / 20.0), 0.01 * y * height, 5.0 * height], axis=1)
stiffness = orthotropic_stiffness(900.0, 300.0, 8.0, 0.24)
fabric = Fabric(bend=(-300.0, 100.0))
membrane = Membrane(mesh, 0.81, "hencky", relaxation=True, fabric=fabric)
state = membrane.state(u, 0.01, stiffness)
assert 0 < state.wrinkled < 4 * len(mesh.cells)
print(hashlib.sha256(state.residual.tobytes() + state.tangent.tobytes()).hexdigest())
"""


def hits(source: Path, cache: Path) -> int:
    """How often a fresh process finds the kernel in the cache."""
    environment = {**os.environ, "PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(cache)}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
    )
    return int(run.stdout)


def test_cache_notices_edits_of_other_files(tmp_path: Path) -> None:
    source = tmp_path / "source"
    package = Path(bulgefit.__file__).parent
    shutil.copytree(
        package / "fem", source / "bulgefit/fem", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(package / "errors.py", source / "bulgefit")
    (source / "bulgefit/__init__.py").touch()
    cache = tmp_path / "cache"
    assert [hits(source, cache), hits(source, cache)] == [0, 1]
    laws = source / "bulgefit/fem/laws/hencky.py"
    laws.write_text(laws.read_text() + "# edited\n")
    assert [hits(source, cache), hits(source, cache)] == [0, 1]


def test_a_process_that_compiles_finds_what_later_ones_find(tmp_path: Path) -> None:
    """To the last bit: sums may be reordered, but once and for all."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", WRINKLED]
    said = [
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert "compiling kernels" in said[0].stderr
    assert said[1].stderr == ""
    assert said[0].stdout == said[1].stdout


def test_runs_without_a_folder_to_cache_in(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*, cache: bool = False, **options: object) -> object:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return njit(**options)

    monkeypatch.setattr(jit, "njit", refuse)
    assert jit.compiled(lambda x: x + 1.0)(1.0) == 2.0


def test_compiling_is_announced_once_and_a_cached_kernel_is_not(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", SCRIPT]
    said = [
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr
        for _ in range(2)
    ]
    assert said[0].count("compiling kernels") == 1
    assert said[1] == ""


def test_garbage_is_collected_again_after_compiling() -> None:
    """Also after a kernel that does not compile, and not for one who had switched it off."""
    during = []

    def look() -> None: ...

    @overload(look)
    def looked():  # called while numba compiles
        during.append(gc.isenabled())
        return lambda: None

    njit(lambda: look())()  # a cached kernel would not be compiled at the next run
    assert during
    assert not any(during)
    assert gc.isenabled()
    with pytest.raises(TypingError):
        jit.compiled(lambda x: x.missing)(1.0)
    assert gc.isenabled()
    gc.disable()
    try:
        jit.compiled(lambda x: x + 2.0)(1.0)
        assert not gc.isenabled()
    finally:
        gc.enable()
