"""Do factors solve the system, however wide the band, and whoever else is at work?"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import lapack

from bulgefit.fem.banded import stored_height
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import flat_guess
from bulgefit.fem.linear import _IDLE, BandedFactor, has_pardiso
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import disc

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"


@pytest.mark.parametrize("columns", [None, 1, 5])
@pytest.mark.parametrize(
    ("size", "height"),
    [(1, 1), (3, 3), (4, 4), (9, 4), (23, 7), (30, 30), (90, 17), (90, 18)],
)
def test_banded_substitution(size: int, height: int, columns: int | None) -> None:
    rng = np.random.default_rng(1)
    band = np.asfortranarray(rng.normal(size=(height, size)))
    band[0] += 4.0 * height
    full = np.zeros((size, size))
    for k in range(height):
        full += np.diag(band[k, : size - k], -k)
    full += np.tril(full, -1).T
    factor = np.zeros((stored_height(height - 1), size), order="F")
    factor[:height], info = lapack.dpbtrf(band, lower=1)
    assert info == 0
    right = rng.normal(size=size if columns is None else (size, columns))
    kept = right.copy()
    np.testing.assert_allclose(full @ BandedFactor(factor).solve(right), right, atol=1e-12)
    np.testing.assert_array_equal(right, kept)


def test_memory_of_factors_that_are_gone_is_used_again_but_not_all_kept() -> None:
    """Twenty that were alive at once had stayed in memory for good."""
    membrane = Membrane(disc(100.0, 2), 0.81)
    stiffness = orthotropic_stiffness(330.0, 240.0, 30.0, 0.24)
    shape = flat_guess(membrane, 0.1, stiffness)
    factors = [membrane.factorise(membrane.state(shape, 0.1, stiffness)) for _ in range(20)]
    laid_by = membrane.linear._idle
    assert not laid_by
    del factors
    gc.collect()
    assert len(laid_by) == _IDLE
    kept = membrane.factorise(membrane.state(shape, 0.1, stiffness), spent=True)
    assert len(laid_by) == _IDLE - 1
    del kept


@pytest.mark.skipif(not has_pardiso(), reason="pypardiso is not installed")
def test_pardiso_serves_several_threads() -> None:
    """Its own threads, of which the machine may have many, crashed under those of a fit."""
    command = ["fit", str(EXAMPLE), "--bounds", "E1=200:500,E2=150:400,G12=10:60", "--quiet"]
    options = ["--linear-solver", "pardiso", "--workers", "2", "--starts", "3"]
    run = subprocess.run(
        [sys.executable, "-m", "bulgefit", *command, *options],
        env={**os.environ, "OMP_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert "3 converged" in run.stdout
