"""Offsets of the points: how large, and how far apart they go together, is told from residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.registry import catalogue
from bulgefit.gap.attempt import Attempt
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.specimen import Specimen

SIGMA = np.array([0.005, 0.005, 0.04])
FRAMES, POINTS = 12, 380


def seen(
    sizes: np.ndarray, length: float, seed: int, trust: float = 1.0
) -> tuple[Data, np.ndarray]:
    """A test whose every frame shows the same offsets under noise, and these (points, 3).

    Of the first frames no more is known than `trust` of the noise's inverse.
    """
    rng = np.random.default_rng(seed)
    radius, angle = 95.0 * np.sqrt(rng.uniform(size=POINTS)), 2 * np.pi * rng.uniform(size=POINTS)
    reference = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * radius])
    offset = rng.normal(size=(POINTS, 3))
    if length:
        apart = np.linalg.norm(reference[:, None] - reference, axis=2)
        q = np.sqrt(5.0) * apart / length
        correlation = (1.0 + q + q**2 / 3.0) * np.exp(-q) + 1e-9 * np.eye(POINTS)
        offset = np.linalg.cholesky(correlation) @ offset
    offset *= sizes
    share = np.where(np.arange(FRAMES) < FRAMES // 3, trust, 1.0)
    noise = rng.normal(size=(FRAMES, POINTS, 3)) * SIGMA / share[:, None, None]
    test = BulgeTest.from_arrays(reference, offset + noise, np.linspace(0.02, 0.3, FRAMES))
    data = Data(Specimen(test), SIGMA, np.ones(noise.shape, dtype=bool))
    return replace(data, trust=share), offset


def score(found: Creases, data: Data) -> float:
    """-2 ln of the evidence of all that is measured, but for a constant."""
    rows = (data.specimen.measured * data.weight)[None]
    beside = found.whitened(rows, data.weight * SIGMA, data.inflation)
    return float((beside**2).sum()) / data.inflation + found.cost(data.inflation)


@pytest.mark.parametrize("length", [0.0, 9.0, 20.0])
def test_the_likeliest_size_and_length_are_found(length: float) -> None:
    sizes = np.array([0.02, 0.01, 0.2])
    data, _ = seen(sizes, length, seed=4)
    found = Creases.likeliest(data, np.zeros_like(data.specimen.measured))
    assert found is not None
    # lengths are tried by factors of √2
    assert found.length == pytest.approx(length, rel=0.25)
    near = score(found, data)
    if length == 0.0:
        np.testing.assert_allclose(found.sizes, sizes, rtol=0.1)
        assert near < score(Creases.of(data, sizes, length), data)
    # no other size has more evidence, and no other length that is tried
    for c in range(3):
        for factor in (0.9, 1.1):
            other = np.array(found.sizes)
            other[c] *= factor
            assert near < score(Creases.of(data, other, found.length), data)
    for factor in (0.5, 2.0):
        if length:
            assert near < score(Creases.of(data, found.sizes, factor * found.length), data)


@pytest.mark.parametrize("trust", [1.0, 0.1])
def test_noise_alone_has_none_worth_their_cost(trust: float) -> None:
    """Twice the gain is χ² of what is looked for: 16 would be one in some thousand.

    Of frames that are doubted, too: in sums over frames they count as little as in the likelihood.
    """
    for seed in range(4):
        data, _ = seen(np.zeros(3), 0.0, seed, trust)
        found = Creases.likeliest(data, np.zeros_like(data.specimen.measured))
        if found is not None:
            none = Creases.of(data, np.zeros(3), 0.0)
            assert 0.0 < score(none, data) - score(found, data) < 16.0


def test_what_is_smooth_takes_less_of_noise_than_offsets_of_single_points() -> None:
    """It is known from all neighbours: that is what a length is worth."""
    data, offset = seen(np.array([0.02, 0.02, 0.2]), 22.0, seed=7)
    smooth = Creases.likeliest(data, np.zeros_like(data.specimen.measured))
    assert smooth is not None
    single = Creases.of(data, smooth.sizes, 0.0)
    assert smooth.cost(data.inflation) < 0.5 * single.cost(data.inflation)
    rows = np.stack([data.specimen.measured - offset, offset + 0 * data.specimen.measured]) / SIGMA
    noise, creases = (
        (found.whitened(rows, np.ones(rows.shape[1:]), 1.0) ** 2).sum(axis=(1, 2, 3))
        for found in (smooth, single)
    )
    assert noise[0] > creases[0]  # of noise less is taken away
    assert noise[1] == pytest.approx(creases[1], rel=0.2)  # of creases as much


def test_they_are_put_on_fewer_points() -> None:
    data, _ = seen(np.array([0.02, 0.02, 0.2]), 12.0, seed=8)
    whole = Creases.of(data, np.array([0.02, 0.02, 0.2]), 12.0)
    used = np.array(data.used)
    used[:, 7, 2] = False
    fewer = whole.on(replace(data, used=used).thinned(3))
    assert fewer.number.shape == (127, 3)
    assert fewer.length == whole.length


def test_what_grows_with_pressure_is_no_crease() -> None:
    data, offset = seen(np.array([0.02, 0.02, 0.2]), 12.0, seed=5)
    nothing = np.zeros_like(data.specimen.measured)
    assert Creases.likeliest(data, nothing) is not None
    load = np.cbrt(data.specimen.recorded / data.specimen.recorded.max())
    assert Creases.likeliest(data, offset * (1.0 - load[:, None, None])) is None


@pytest.mark.parametrize("size", [0.0, 0.05])
def test_they_are_let_go_where_the_best_model_can_do_without(
    made_by_the_model: Callable[..., Data], size: float
) -> None:
    """They may have let it be found; what they are worth is told beside it."""
    moduli = {"E1": 340.0, "E2": 210.0, "G12": 16.0}
    data = made_by_the_model({**moduli, "clamp_slip.compliance": 0.01}, 14.0, frames=8, seed=6)
    (block,) = data.specimen.test.blocks
    offset = size * np.random.default_rng(7).normal(size=block.reference.shape)
    test = BulgeTest.from_arrays(
        block.reference, block.displacement + offset, data.specimen.test.pressure
    )
    data = replace(data, specimen=data.specimen.of(test))
    coordinates = Coordinates.of([catalogue()["clamp_slip"]], [data.specimen.nulls()])
    layout = Layout.of(coordinates.groups)
    weighing = Weighing([data], coordinates, [Creases.of(data, np.full(3, 0.05), 0.0)])
    start = np.array(layout.null)
    start[:3] = np.log(list(moduli.values()))
    fit = descend(weighing, layout, layout.whole(), start)
    trial = Attempt.of(weighing, layout, fit, start, lambda _: None)
    trial.search.fits[fit.model] = fit
    found, worth = trial.with_offsets_if_worth(1e3)
    if size:
        assert found is trial
        assert worth == 1e3
    else:
        assert worth == 0.0
        assert found.search.problem.offsets is None
        assert found.score < trial.score
        assert found.search.best.model == fit.model
