"""Do substitutions with a banded factor solve the system, however wide the band?"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import lapack

from bulgefit.fem.banded import stored_height
from bulgefit.fem.linear import BandedFactor


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
