"""A misfit as noise of its own: what rows count beside it, its size, and what is sure beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.effects.parameter import Owned
from bulgefit.effects.registry import catalogue
from bulgefit.gap.attempt import Attempt
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.improve import improved
from bulgefit.gap.evidence.misfit import Misfit
from bulgefit.gap.evidence.probability import weighed
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.shares import scores
from bulgefit.gap.evidence.weighing import Weighing

COURSES = 18
TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    """Of 68 points: 21 modes up to the fifth degree are less than half as many, 66 are more."""
    return made_by_the_model(TRUTH, 20.0, frames=7, seed=6)


@pytest.fixture(scope="module")
def modes(data: Data) -> list[np.ndarray]:
    """Of either octave, what each coefficient adds: (modes, courses, frames, points, 3).

    Polynomials up to the fifth degree, then what these are not; times such in p^(1/3), one
    component at a time.
    """
    x, y = data.specimen.reference[:, :2].T / data.specimen.test.radius
    smooth = np.stack([x**i * y ** (n - i) for n in range(6) for i in range(n + 1)], axis=1)
    whole, _ = np.linalg.qr(np.hstack([smooth, np.eye(len(x))]))
    load = np.cbrt(data.specimen.recorded)
    along, _ = np.linalg.qr(np.stack([load**k for k in range(6)], axis=1))
    course = np.einsum("fl,cd->clfd", along, np.eye(3)).reshape(COURSES, len(load), 3)
    return [np.einsum("qk,jfc->kjfqc", part, course) for part in np.split(whole, [21], axis=1)]


@pytest.fixture(scope="module")
def spread() -> list[np.ndarray]:
    """Covariances of coefficients: one direction of each octave is far beyond the noise."""
    directions = np.random.default_rng(1).normal(size=(2, COURSES))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return [
        size * np.outer(u, u) + 0.05 * np.eye(COURSES)
        for size, u in zip((40.0, 12.0), directions, strict=True)
    ]


def drawn(modes: list[np.ndarray], spread: list[np.ndarray], seed: int) -> np.ndarray:
    """Noise and misfit (frames, points, 3)."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=modes[0].shape[2:])
    for part, s in zip(modes, spread, strict=True):
        found = rng.normal(size=part.shape[:2]) @ np.linalg.cholesky(s).T
        out += np.einsum("kjfqc,kj->fqc", part, found)
    return out


def covariance(modes: list[np.ndarray], spread: list[np.ndarray]) -> np.ndarray:
    """Of noise and misfit over all values."""
    size = modes[0][0, 0].size
    out = np.eye(size)
    for part, s in zip(modes, spread, strict=True):
        values, turn = np.linalg.eigh(s)
        root = turn * np.sqrt(np.maximum(values, 0.0))
        flat = np.einsum("kj...,ji->ki...", part, root).reshape(-1, size)
        out += flat.T @ flat
    return out


def of_nothing_known(data: Data, residual: np.ndarray) -> Misfit:
    """Of a model whose only parameter has next to no derivative."""
    rows = np.stack([np.full_like(residual, 1e-9), residual])
    return Misfit.of(data, rows, np.eye(1))


def test_rows_count_by_noise_and_misfit(data, modes, spread):
    """r C⁻¹ r by a dense matrix."""
    found = replace(of_nothing_known(data, drawn(modes, spread, 2)), spread=tuple(spread))
    rows = np.random.default_rng(3).normal(size=(4, *data.used.shape))
    rows[0] += 5.0 * modes[0][3, 4]
    white, flat = found.whitened(rows).reshape(4, -1), rows.reshape(4, -1)
    exact = flat @ np.linalg.solve(covariance(modes, spread), flat.T)
    np.testing.assert_allclose(white @ white.T, exact, rtol=1e-8, atol=1e-8 * exact.max())


def test_no_other_covariance_is_likelier(data, modes, spread):
    """Along each octave's largest directions, and turned between them, by a dense matrix."""
    residual = drawn(modes, spread, 2)
    found = list(of_nothing_known(data, residual).spread)

    def lost(spread: list[np.ndarray]) -> float:
        whole = covariance(modes, spread)
        value = residual.ravel() @ np.linalg.solve(whole, residual.ravel())
        return float(value + np.linalg.slogdet(whole)[1])

    best = lost(found)
    for octave, s in enumerate(found):
        values, turn = np.linalg.eigh(s)
        first, second = turn[:, -1], turn[:, -2]
        turned = np.array(turn)
        turned[:, -1], turned[:, -2] = 0.98 * first + 0.2 * second, 0.98 * second - 0.2 * first
        others = [(turn * np.append(values[:-1], by * values[-1])) @ turn.T for by in (0.8, 1.25)]
        for other in (*others, (turned * values) @ turned.T):
            assert lost([other if k == octave else t for k, t in enumerate(found)]) > best


def test_it_is_found_as_it_was_drawn(data, modes, spread):
    """A variance of k modes is known to √(2/k)."""
    found = of_nothing_known(data, drawn(modes, spread, 2))
    for s, truth, count in zip(found.spread, spread, (21, 47), strict=True):
        (values, turn), (sizes, axes) = np.linalg.eigh(s), np.linalg.eigh(truth)
        assert values[-1] == pytest.approx(sizes[-1], rel=3.0 * np.sqrt(2.0 / count))
        assert abs(turn[:, -1] @ axes[:, -1]) > 0.95


def test_the_loudest_is_the_largest_of_any_octave(data, modes, spread):
    """Also of what is finer than effects go: a narrow seam is seen there alone."""
    fine = [0.0 * spread[0] + 1e-9 * np.eye(COURSES), spread[1]]
    for drawn_by, largest, count in ((spread, 40.0, 21), (fine, 12.0, 47)):
        found = of_nothing_known(data, drawn(modes, drawn_by, 2))
        assert found.largest == pytest.approx(largest, rel=3.0 * np.sqrt(2.0 / count))
        louder = Weighing([data], Coordinates.of([], [data.specimen.nulls()]), misfits=[found])
        assert louder.loudest == 1.0 + found.largest
    assert Weighing([data], louder.coordinates).loudest == 1.0


def test_what_the_parameters_took_is_made_up_for(data, modes):
    """Of 378 smooth coefficients 189 are parameters: 189 tell the mean variance to √(2/189)."""
    residual = drawn(modes, [20.0 * np.eye(COURSES), 1e-9 * np.eye(COURSES)], 4)
    turn, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(378, 189)))
    slopes = np.tensordot(turn.T, modes[0].reshape(378, *residual.shape), 1)
    flat = slopes.reshape(189, -1)
    residual -= np.tensordot(flat @ residual.ravel(), slopes, 1)
    rows = np.concatenate([slopes, residual[None]])
    found = Misfit.of(data, rows, np.linalg.inv(flat @ flat.T + 1e-6 * np.eye(189)))
    assert np.trace(found.spread[0]) / COURSES == pytest.approx(20.0, rel=3 * np.sqrt(2 / 189))


def test_by_more_points_it_takes_as_much(made_by_the_model: Callable[..., Data]):
    """What goes smoothly counts alike, however many points show it; white noise as white noise."""
    whole = made_by_the_model(TRUTH, 12.0, frames=7, seed=6)
    thin = whole.thinned(2)
    rng = np.random.default_rng(8)
    x, y = whole.specimen.reference[:, :2].T / whole.specimen.test.radius
    powers = np.stack([x**i * y ** (n - i) for n in range(6) for i in range(n + 1)], axis=1)
    modes, _ = np.linalg.qr(powers[::2])
    left = np.einsum("qk,kfc->fqc", modes, 30.0 * rng.normal(size=(21, 7, 3)))[None]
    left += rng.normal(size=left.shape)
    rows = np.concatenate([np.full_like(left, 1e-9), left])
    told = Misfit.of(thin, rows, np.eye(1))
    on = told.on(whole, 1.0)
    assert (len(told.spread), len(on.spread)) == (2, 3)
    load = np.cbrt(whole.specimen.recorded)[:, None, None]
    smooth = ((0.3 + x * y - y**3)[:, None] * load * [1.0, -2.0, 0.5])[None]
    # of noise with four times the variance, rows are half
    louder = told.on(whole, 4.0)
    few, many, half = (
        float((m.whitened(r) ** 2).sum())
        for m, r in ((told, smooth[:, :, ::2]), (on, smooth), (louder, 0.5 * smooth))
    )
    assert few < 0.1 * float((smooth[:, :, ::2] ** 2).sum())
    assert many == pytest.approx(few, rel=0.1)
    assert half == pytest.approx(few, rel=0.1)
    noise = rng.normal(size=(1, *whole.used.shape))
    kept = [
        float((m.whitened(r) ** 2).sum() / (r**2).sum())
        for m, r in ((told, noise[:, :, ::2]), (on, noise))
    ]
    assert kept[0] < kept[1] < 1.0


EFFECTS = (
    "clamp_slip", "rigid_motion", "fixture_motion", "registration", "dic_scale", "pressure_offset",
    "lens_distortion", "clamp_shape", "stiffness_gradient", "prestrain", "initial_shape",
)  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_beside_a_misfit_only_true_causes_are_sure(made_by_the_model, seed):
    """A slip beside smooth displacements of some noise units that no effect makes."""
    data = made_by_the_model({**TRUTH, "clamp_slip.compliance": 0.01}, 15.0, frames=8, seed=seed)
    test, rng = data.specimen.test, np.random.default_rng(seed)
    x, y = data.specimen.reference[:, :2].T / test.radius
    waves = [
        np.cos(k * x + rng.uniform(0, 6)) * np.cos(m * y + rng.uniform(0, 6))
        for k in (3.0, 4.5, 6.0, 7.5)
        for m in (3.0, 4.5, 6.0, 7.5)
    ]
    shape = np.einsum("wq,wc->qc", waves, rng.normal(size=(16, 3))) * data.sigma
    course = (test.pressure / test.pressure.max()) ** (2 / 3)
    (block,) = test.blocks
    seen = block.displacement + course[:, None, None] * shape
    other = type(test).from_arrays(block.reference, seen, test.pressure)
    data = replace(data, specimen=data.specimen.of(other))
    coordinates = Coordinates.of([catalogue()[e] for e in EFFECTS], [data.specimen.nulls()])
    weighing, layout = Weighing([data], coordinates), Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[:3] = np.log(list(TRUTH.values()))
    rough = descend(weighing, layout, layout.whole(), start, roughly=True)
    trial = Attempt.of(weighing, layout, rough, start, lambda _: None)
    trial.search.fits[rough.model] = rough

    def sure(search: Search[Weighing]) -> set[str]:
        improved(search, search.best)
        chances = weighed(scores(search, 1.0), search.names).groups
        return {str(group) for group, p in chances.items() if p >= 0.95}

    settled = trial.settled()
    assert sure(trial.search) > {"clamp_slip"}
    assert sure(settled.search) == {"clamp_slip"}
    part = layout.part(Owned("clamp_slip"))
    assert settled.search.best.x[part] == pytest.approx(0.01, abs=0.001)


def test_each_specimen_has_a_misfit_of_its_own(made_by_the_model: Callable[..., Data]):
    """Two specimens, one of which has something that no model follows, and heights at rest."""
    whole = [made_by_the_model(TRUTH, 20.0, frames=7, seed=seed) for seed in (6, 7)]
    test = whole[1].specimen.test
    (block,) = test.blocks
    reference = np.array(block.reference)
    reference[:, 2] = 0.3
    bumps = np.cos(reference[:, 0] / 9.0) * np.cos(reference[:, 1] / 7.0)
    seen = block.displacement + 0.1 * test.pressure[:, None, None] * bumps[:, None]
    other = type(test).from_arrays(reference, seen, test.pressure)
    whole[1] = replace(whole[1], specimen=whole[1].specimen.of(other))
    effects = [catalogue()[e] for e in ("clamp_slip", "initial_shape", "registration")]
    coordinates = Coordinates.of(effects, [d.specimen.nulls() for d in whole])
    plain, layout = Weighing(whole, coordinates), Layout.of(coordinates.groups)
    columns = layout.columns(layout.whole([Owned("initial_shape", 0), Owned("registration", 1)]))
    x = np.array(layout.null)
    x[:3] = np.log(list(TRUTH.values()))
    here = plain.linearise(x, columns)
    beside = plain.beside_misfit(here)
    assert beside.afresh().misfits is beside.misfits
    found = beside.linearise(x, columns)
    square = []
    for before, after in zip(here.rows, found.rows, strict=True):
        square.append((float(before[-1] @ before[-1]), float(after[-1] @ after[-1])))
        # heights are the last: 68 points by three components
        np.testing.assert_array_equal(before[:, 7 * 68 * 3 :], after[:, 7 * 68 * 3 :])
    # of noise, too, 18 courses look unlike in 21 modes
    assert square[0][1] > 0.7 * square[0][0]
    assert square[1][1] < 0.5 * square[1][0]
    assert found.square == pytest.approx(sum(after for _, after in square), rel=1e-12)
    # balanced once more from where it was: to the solver's tolerance
    assert beside.again(found, x).square == pytest.approx(found.square, rel=1e-4)
