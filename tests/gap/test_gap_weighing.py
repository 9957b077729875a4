"""Specimens as a problem of evidence: derivatives, the mesh's direction, errors, the temper."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import catalogue, fields
from bulgefit.errors import Cause, SolveError
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.brink import LostStabilityError
from bulgefit.gap.evidence.coordinates import Coordinates, is_field, with_fields
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.outcome import posterior, regression_of, seen_by
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.temper import taken_up, temper
from bulgefit.gap.evidence.weighing import Weighing, _balanced
from bulgefit.gap.normal import normal_equations
from bulgefit.gap.prepare import _trust
from bulgefit.gap.specimen import Specimen

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}
NAMES = ("clamp_slip", "dic_smoothing", "rigid_motion", "stiffness_field", "pressure_field")


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model({**TRUTH, "clamp_slip.compliance": 0.01}, 15.0, frames=6, seed=5)


def weighing_of(data: list[Data]) -> tuple[Weighing, Layout]:
    effects = [{**catalogue(), **fields()}[name] for name in NAMES]
    coordinates = Coordinates.of(effects, [d.specimen.nulls() for d in data])
    return Weighing(data, coordinates), Layout.of(coordinates.groups)


def near_the_truth(weighing: Weighing, layout: Layout) -> np.ndarray:
    """Every coordinate off its null, by less than its prior."""
    x = layout.null + layout.width * np.random.default_rng(1).uniform(0.05, 0.2, len(layout.null))
    x[:3] = np.log([TRUTH[name] for name in ("E1", "E2", "G12")])
    return x


def test_every_coordinate_is_of_its_group_and_specimen(data: Data) -> None:
    weighing, layout = weighing_of([data, data])
    names = [g.id for g in weighing.groups]
    assert names[0] == Owned("moduli")
    assert {Owned("clamp_slip", 0), Owned("clamp_slip", 1), Owned("stiffness_field", 1)} <= {*names}
    assert is_field(Owned("rim_field", 1))
    assert not is_field(Owned("clamp_lobes"))
    x = np.array(layout.null)
    x[layout.part(Owned("clamp_slip", 1))] = 0.02
    values = [weighing.coordinates.values(x, index) for index in (0, 1)]
    assert "clamp_slip.compliance" not in values[0]
    assert values[1]["clamp_slip.compliance"] == 0.02
    assert values[0]["E1"] == pytest.approx(300.0)


def test_fields_are_freed_where_every_test_tells_what_they_need(data: Data) -> None:
    assert data.specimen.test.time is None
    test = replace(data.specimen.test, time=np.arange(6.0))
    timed = replace(data, specimen=data.specimen.of(test))
    tests = data.specimen.test, timed.specimen.test
    untold, told = (
        {f.id for f in with_fields([], some, several=True)} for some in (tests, tests[1:])
    )
    assert "frame_field" in untold
    assert "reference_field" not in untold
    assert told - untold == {"drift_field", "slow_slip_field"}
    alone = {f.id for f in with_fields([], tests, several=False)}
    assert untold - alone == {"law_curve", "specimen_factor"}


def test_gradients_are_those_of_the_misfit(data: Data) -> None:
    """-Jᵀr against differences of |r|²/2, the mesh's direction taken off."""
    pattern = np.random.default_rng(2).normal(size=data.used.shape) * 1e-3
    weighing, layout = weighing_of([replace(data, mesh=pattern, inflation=2.0)])
    x = near_the_truth(weighing, layout)
    columns = np.array(
        [0, 2, *(layout.part(Owned(n)).start for n in NAMES), len(x) - 1], dtype=np.intp
    )
    columns = np.unique([*columns, layout.part(Owned("stiffness_field")).start + 28])
    here = weighing.linearise(x, columns)
    for place, column in enumerate(columns):
        step = 1e-3 * layout.width[column]
        ahead, behind = np.array(x), np.array(x)
        ahead[column] += step
        behind[column] -= step
        none = columns[:0]
        change = (
            weighing.linearise(ahead, none, here.near).square
            - weighing.linearise(behind, none, here.near).square
        )
        assert -0.5 * change / (2 * step) == pytest.approx(here.gradient[place], rel=5e-3), column


def test_along_one_coordinate_specimens_that_lack_it_are_not_looked_at(data: Data) -> None:
    weighing, layout = weighing_of([data, data])
    x = near_the_truth(weighing, layout)
    of_first = layout.part(Owned("clamp_slip", 0)).start
    own = np.array([0, of_first])
    here = weighing.linearise(x, own, weighing.linearise(x, own).near)
    for place, column in enumerate(own):
        slope, curvature = weighing.along(x, column, here.near)
        assert slope == pytest.approx(here.gradient[place], rel=1e-9)
        assert curvature == pytest.approx(here.hessian[place, place], rel=1e-9)
    unsound = np.array(x)
    unsound[layout.part(Owned("clamp_slip", 1)).start] = np.nan
    assert np.isfinite(weighing.along(unsound, of_first, here.near)).all()
    with pytest.raises(SolveError, match="no such values"):
        weighing.along(unsound, 0, here.near)


def test_threads_change_no_bit(data: Data) -> None:
    """Of the misfit, of its derivatives, and of what they make together."""
    weighing, layout = weighing_of([data])
    threads, _ = weighing_of([data.afresh()])
    threads.data[0].specimen.threads = 2
    x, columns = near_the_truth(weighing, layout), np.arange(0, len(layout.null), 7)
    one, two = (w.linearise(x, columns) for w in (weighing.afresh(), threads))
    flat = one.rows[0]
    np.testing.assert_allclose(one.hessian, flat[:-1] @ flat[:-1].T, rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(one.hessian, two.hessian)
    np.testing.assert_array_equal(one.gradient, two.gradient)
    assert one.square == two.square


@pytest.mark.parametrize("creased", [False, True])
def test_what_a_fit_predicts_is_what_its_regression_does(data: Data, creased: bool) -> None:
    weighing, layout = weighing_of([data])
    if creased:
        weighing = Weighing(
            [data], weighing.coordinates, [Creases.of(data, np.full(3, 0.01), 12.0)]
        )
    start = near_the_truth(weighing, layout)
    fit = descend(weighing, layout, freeze({Owned("clamp_slip"): 0}), start)
    whole, seen = regression_of(weighing, fit), seen_by(weighing, fit)
    assert seen.keys == whole.keys
    np.testing.assert_allclose(
        seen.predictions[0].displacement, whole.predictions[0].displacement, atol=1e-12
    )


def test_the_meshs_remainder_is_noise_of_one_more_direction(data: Data) -> None:
    """r C⁻¹ r with C = v 1 + m mᵀ, by a dense matrix."""
    pattern = np.random.default_rng(3).normal(size=data.used.shape) * 1e-3
    plain, layout = weighing_of([replace(data, inflation=3.0)])
    with_mesh, _ = weighing_of([replace(data, inflation=3.0, mesh=pattern)])
    x, columns = near_the_truth(plain, layout), np.arange(3)
    found = with_mesh.linearise(x, columns)
    own = plain.seen(x, list(columns), 0)
    rows = plain._rows(plain.data[0], own, x, list(columns)).reshape(4, -1)
    m = (pattern / data.sigma).ravel()
    covariance = 3.0 * np.eye(len(m)) + np.outer(m, m)
    exact = rows @ np.linalg.solve(covariance, rows.T)
    assert found.square == pytest.approx(exact[-1, -1], rel=1e-9)
    np.testing.assert_allclose(found.hessian, exact[:-1, :-1], rtol=1e-9)
    np.testing.assert_allclose(found.gradient, exact[:-1, -1], rtol=1e-7)


def test_each_specimen_is_weighed_by_its_own_noise(data: Data) -> None:
    """Σ |r|²/v over the specimens; noise leaves as many as are independent."""
    both = [data, replace(data, inflation=9.0)]
    weighing, layout = weighing_of(both)
    alone, own = weighing_of(both[:1])
    columns, points = np.arange(3), (np.array(layout.null), np.array(own.null))
    for x in points:
        x[:3] = np.log([300.0, 200.0, 25.0])
    found, one = weighing.linearise(points[0], columns), alone.linearise(points[1], columns)
    assert found.square == pytest.approx((1.0 + 1.0 / 9.0) * one.square, rel=1e-9)
    np.testing.assert_allclose(found.hessian, (1.0 + 1.0 / 9.0) * one.hessian, rtol=1e-9)
    assert weighing.noise == pytest.approx((1.0 + 1.0 / 9.0) * data.used.sum())
    predictions = [d.specimen.predict(TRUTH, [key.name for key in MODULI]) for d in both]
    normal = normal_equations(both, predictions, MODULI)
    single = normal_equations(both[:1], predictions[:1], MODULI)
    np.testing.assert_allclose(normal.whole.matrix, (1.0 + 1.0 / 9.0) * single.whole.matrix)
    assert normal.held_out() == pytest.approx((1.0 + 1.0 / 9.0) * single.held_out())
    assert normal.noise == pytest.approx(weighing.noise)


@pytest.mark.parametrize("length", [0.0, 12.0])
def test_offsets_of_points_are_integrated_out(length: float, data: Data) -> None:
    """r C⁻¹ r and ln det C/v, C = v + K for each two frames of two points, by a dense matrix."""
    prior = np.array([0.01, 0.02, 0.05])
    used = np.array(data.used)
    used[2, ::3] = False
    some = replace(data, used=used, inflation=3.0)
    plain, layout = weighing_of([some])
    x, columns = near_the_truth(plain, layout), np.arange(3)
    weighing = Weighing([some], plain.coordinates, [Creases.of(some, prior, length)])
    found = weighing.linearise(x, columns)
    rows = plain._rows(some, plain.seen(x, list(columns), 0), x, list(columns))
    points = some.specimen.reference[:, :2]
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    q = np.sqrt(5.0) * apart / (length or 1.0)
    alike = (1.0 + q + q**2 / 3.0) * np.exp(-q) if length else np.eye(len(points))
    exact, log_det = np.zeros((4, 4)), 0.0
    for axis in range(3):
        frame, point = np.nonzero(used[..., axis])
        of_offsets = (prior[axis] / some.sigma[axis]) ** 2 * alike[np.ix_(point, point)]
        covariance = np.eye(len(point)) + of_offsets / 3.0
        own = rows[:, frame, point, axis]
        exact += own @ np.linalg.solve(covariance, own.T) / 3.0
        log_det += np.linalg.slogdet(covariance)[1]
    assert found.square == pytest.approx(exact[-1, -1], rel=1e-9)
    np.testing.assert_allclose(found.hessian, exact[:-1, :-1], rtol=1e-8)
    np.testing.assert_allclose(found.gradient, exact[:-1, -1], rtol=1e-6)
    assert weighing.cost == pytest.approx(log_det, rel=1e-9)
    assert plain.cost == 0.0


def test_a_regression_of_a_fit_has_the_posteriors_errors(data: Data) -> None:
    weighing, layout = weighing_of([data])
    start = np.array(layout.null)
    start[:3] = np.log([320.0, 200.0, 25.0])
    model = freeze({Owned(n): 0 for n in ("clamp_slip", "rigid_motion", "stiffness_field")})
    fit = descend(weighing, layout, model, start)
    assert fit.converged
    found = regression_of(weighing, fit)
    errors = found.standard_errors()
    slipping = Key("clamp_slip", "compliance")
    assert found.values[slipping] == pytest.approx(0.01, rel=0.1)
    for key, truth in zip(MODULI, TRUTH.values(), strict=True):
        assert abs(found.values[key] - truth) < 4 * errors[key]
    # of moduli by their logarithms
    sd = np.sqrt(np.diag(fit.covariance))
    for place, key in enumerate(MODULI):
        assert errors[key] / found.values[key] == pytest.approx(sd[place], rel=1e-6)
    slip = layout.columns(model).tolist().index(layout.part(Owned("clamp_slip")).start)
    assert errors[slipping] == pytest.approx(sd[slip], rel=1e-6)
    # what the data hardly say of is known by its prior, held out or not
    assert max(errors[k] for k in found.keys if k.effect == "stiffness_field") < 0.15
    assert found.held_out() < 1.3 * found.normal.noise


def test_beside_offsets_errors_are_the_posteriors_too(data: Data) -> None:
    """Not as if each point's offset were free; a specimen without any has none taken off."""
    both, plain = [data, data], weighing_of([data, data])[0]
    sizes = np.array([0.004, 0.004, 0.008])
    creases = [Creases.of(data, size, 20.0) for size in (sizes, 0.0 * sizes)]
    weighing, layout = Weighing(both, plain.coordinates, creases), Layout.of(plain.groups)
    start = np.array(layout.null)
    start[:3] = np.log([320.0, 200.0, 25.0])
    model = freeze({Owned(n, i): 0 for n in ("clamp_slip", "rigid_motion") for i in (0, 1)})
    fit = descend(weighing, layout, model, start)
    found = regression_of(weighing, fit, posterior(weighing, fit))
    sd = np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose(list(found.standard_errors().values())[3:], sd[3:], rtol=1e-9)
    assert found.offsets[0] is not None
    assert found.offsets[1] is None


def test_a_misfit_counts_in_all_directions(data: Data) -> None:
    """The noise's variances times its excess; of what the data hardly say, the prior's."""
    weighing, layout = weighing_of([data])
    model = layout.whole([Owned(n) for n in ("clamp_slip", "stiffness_field")])
    fit = descend(weighing, layout, model, near_the_truth(weighing, layout), roughly=True)
    misfits = weighing.beside_misfit(weighing.linearise(fit.x, fit.here.columns)).misfits
    beside = Weighing([data], weighing.coordinates, misfits=misfits, excess=4.0)
    found, width = posterior(beside, fit), layout.width[fit.here.columns]
    exact = np.linalg.inv(fit.here.hessian / 4.0 + np.diag(width**-2))
    np.testing.assert_allclose(np.diag(found), np.diag(exact), rtol=1e-3)
    assert (np.sqrt(np.diag(found)) <= width * (1 + 1e-9)).all()
    assert regression_of(beside, fit, found).standard_errors()[MODULI[0]] == pytest.approx(
        np.exp(fit.x[0]) * np.sqrt(found[0, 0])
    )


def test_a_regression_keeps_no_derivatives(data: Data) -> None:
    """Nor a view of them: a hundred megabytes each, where fields are free and refits are many."""
    weighing, layout = weighing_of([data])
    model = layout.whole((Owned("clamp_slip"),))
    fit = descend(weighing, layout, model, near_the_truth(weighing, layout), roughly=True)
    (kept,) = regression_of(weighing, fit).predictions
    assert kept.derivative.size == 0
    assert kept.derivative.base is None


def test_noise_alone_is_not_tempered_and_a_smooth_miss_is(data: Data) -> None:
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    assert temper([data], [prediction], taken=4) == pytest.approx(1.0, abs=0.2)
    # a plane of one noise unit in every frame is one mode of 21 times those of the frames
    x, frames = data.specimen.reference[:, 0], len(data.used)
    miss = (x / np.std(x))[:, None] * data.sigma
    off = replace(prediction, displacement=prediction.displacement + miss)
    expected = 1.0 + frames * len(x) / (21 * min(frames, 6))
    assert temper([data], [off], taken=0) == pytest.approx(expected, rel=0.2)
    # correlated noise is granted its inflation
    granted = replace(data, inflation=expected)
    assert temper([granted], [off], taken=0) == pytest.approx(1.0, abs=0.2)


def test_noise_that_persists_tempers_by_what_the_evidence_takes_it_for(data: Data) -> None:
    """A miss that is less than what all modes are granted is no reason to count evidence for less.

    Though noise leaves courses that are not constant what it has anew in each frame alone.
    """
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    rng, shape = np.random.default_rng(2), data.used.shape
    persists = replace(data, inflation=0.8 * shape[0] + 0.2, persistent=0.8)
    modes = 21 * min(shape[0], 6)
    turn = np.linspace(-1.0, 1.0, shape[0])

    def tempered(miss: float) -> float:
        """Mean over draws of such noise, and of a turn of all points over the frames.

        By as much as that many times what is granted to all modes together.
        """
        size = np.sqrt(miss * modes * persists.inflation / (shape[1] * float(turn @ turn)))
        found = []
        for _ in range(20):
            noise = np.sqrt(0.8) * rng.normal(size=(1, *shape[1:]))
            noise = noise + np.sqrt(0.2) * rng.normal(size=shape) + size * turn[:, None, None]
            shown = data.specimen.measured - noise * data.sigma
            found.append(temper([persists], [replace(prediction, displacement=shown)], taken=0))
        return float(np.mean(found))

    assert tempered(0.0) == 1.0
    assert tempered(0.5) == 1.0
    left = 1.0 / 6.0 + 5.0 / 6.0 * 0.2 / persists.inflation
    assert tempered(5.0) == pytest.approx(5.0 + left, rel=0.02)


def test_what_is_left_of_the_mesh_is_no_misfit(data: Data) -> None:
    """A smooth error of the mesh in one frame, ten times the noise: as models are judged beside."""
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    mesh = np.zeros_like(data.weight)
    mesh[-1] = (data.specimen.reference[:, :1] / 100.0) ** 2 * 10.0 * data.sigma
    off = replace(prediction, displacement=prediction.displacement - 1.7 * mesh)
    known = replace(data, mesh=mesh)
    assert temper([data], [off], taken=4) > 2.0
    noise = temper([data], [prediction], taken=4)
    assert temper([known], [off], taken=4) == pytest.approx(noise, rel=0.1)


def test_frames_that_hang_on_the_mesh_are_doubted(data: Data) -> None:
    """Where more than the noise is left of the mesh's error, a miss is the model's own doubt."""
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    modelled = np.array(prediction.displacement)
    modelled[-2:] += 5.0 * data.sigma
    mesh = np.zeros_like(modelled)
    mesh[-1, :, 1] = 2.0 * data.sigma[1]
    mesh[-2, :, 1] = 0.5 * data.sigma[1]
    known = replace(data, mesh=mesh)
    trust = _trust(known, modelled, prediction.shapes)
    np.testing.assert_array_equal(known.hangs_on_mesh, trust < 1.0)
    assert not data.hangs_on_mesh.any()
    assert trust[-1] == pytest.approx(1.0 / np.sqrt(26.0), rel=0.05)
    np.testing.assert_array_equal(trust[:-1], 1.0)


def test_frames_with_any_cloth_that_is_slack_are_doubted(data: Data) -> None:
    """One integration point is enough; a frame that is met all the same keeps its weight."""
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    modelled = np.array(prediction.displacement)
    modelled[:2] += 5.0 * data.sigma
    modelled[2] = data.specimen.measured[2]
    wrinkled = np.zeros(len(modelled))
    wrinkled[1:3] = 1.0 / (4.0 * len(data.specimen.inflation.mesh.cells))
    trust = _trust(data, modelled, replace(prediction.shapes, wrinkled=wrinkled))
    assert trust[1] == pytest.approx(1.0 / np.sqrt(26.0), rel=0.05)
    np.testing.assert_array_equal(np.delete(trust, 1), 1.0)


def test_modes_that_parameters_took_tell_nothing(data: Data) -> None:
    """Of a hundredth of a mode a square as large as the noise's of one is no hundredfold."""
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    modes = 21 * 3 * min(len(data.used), 6)
    still = replace(prediction, displacement=np.where(data.used, data.specimen.measured, 0.0))
    x = data.specimen.reference[:, 0]
    unit = np.zeros_like(data.weight)
    unit[0, :, 0] = (x / np.linalg.norm(x)) / data.weight[0, :, 0]
    off = replace(still, displacement=still.displacement + np.sqrt(data.inflation) * unit)
    assert temper([data], [off], taken=modes - 0.01) == pytest.approx(2.0, rel=0.3)
    assert temper([data], [still], taken=modes + 5.0) == 1.0


def test_what_differs_from_frame_to_frame_counts_once(data: Data) -> None:
    """The same plane by a size of each frame's own is spread over as many modes as frames."""
    prediction = data.specimen.predict({**TRUTH, "clamp_slip.compliance": 0.01})
    x, frames = data.specimen.reference[:, 0], len(data.used)
    sizes = np.random.default_rng(2).normal(size=(200, frames))
    found = []
    for size in sizes:
        miss = size[:, None, None] * (x / np.std(x))[:, None] * data.sigma
        off = replace(prediction, displacement=prediction.displacement + miss)
        found.append(temper([data], [off], taken=0))
    assert np.mean(found) == pytest.approx(1.0 + len(x) / 21, rel=0.1)


def test_modes_are_taken_up_by_what_data_determine_and_by_what_is_seen_in_them(data: Data) -> None:
    """Moduli, slip and a turned frame are seen in smooth modes; bumps are finer, and held."""
    weighing, layout = weighing_of([data])
    model = layout.whole((Owned("clamp_slip"), Owned("rigid_motion")))
    fit = descend(weighing, layout, model, near_the_truth(weighing, layout), roughly=True)
    few = taken_up(weighing, fit, layout)
    count = len(fit.here.columns)
    assert 0.9 * count < few < count
    rough = layout.whole([Owned(n) for n in ("clamp_slip", "rigid_motion", "stiffness_field")])
    more = descend(weighing, layout, rough, fit.x, fit.here.near, roughly=True)
    bumps = layout.part(Owned("stiffness_field"))
    known = np.diag(more.covariance) / layout.width[more.here.columns] ** 2
    determined = (1.0 - np.clip(known, 0.0, 1.0)).sum()
    assert bumps.stop - bumps.start > 100
    assert few < taken_up(weighing, more, layout) < determined
    # where the prior leaves no room nothing is taken
    firm = Weighing([replace(data, inflation=1e12)], weighing.coordinates)
    assert taken_up(firm, fit, layout) < 1e-3 * count


def test_offsets_take_up_what_is_alike_in_all_frames(data: Data) -> None:
    """21 polynomials by three components, but for what parameters had of them already."""
    plain, layout = weighing_of([data])
    model = layout.whole((Owned("clamp_slip"),))
    fit = descend(plain, layout, model, near_the_truth(plain, layout), roughly=True)
    for size, expected in ((0.004, 63.0), (0.0, 0.0)):
        creases = [Creases.of(data, np.full(3, size), 0.0)]
        creased = Weighing([data], plain.coordinates, creases)
        more = taken_up(creased, fit, layout) - taken_up(plain, fit, layout)
        assert more == pytest.approx(expected, abs=4.0)


def test_beside_a_misfit_evidence_is_that_of_so_much_more_noise(data: Data) -> None:
    weighing, layout = weighing_of([data])
    noisier, _ = weighing_of([replace(data, sigma=3.0 * data.sigma)])
    x = near_the_truth(weighing, layout)
    columns = layout.columns(layout.whole((Owned("clamp_slip"), Owned("rigid_motion"))))
    beside = weighing.beside(3.0).beside(3.0)
    assert (beside.tempered, beside.afresh().tempered) == (9.0, 9.0)
    found, same = (laplace(w.linearise(x, columns), layout, columns) for w in
                   (beside, noisier))  # fmt: skip
    assert found.score == pytest.approx(same.score, rel=1e-9)
    np.testing.assert_allclose(found.covariance, same.covariance, rtol=1e-6)


def test_a_fabric_that_cannot_be_is_no_shape(data: Data) -> None:
    """Steps may lead to moduli whose energy is negative somewhere: E1 below nu12² E2."""
    weighing, layout = weighing_of([data])
    x = near_the_truth(weighing, layout)
    x[0] -= 10.0  # of ln E1
    with pytest.raises(SolveError, match="no such fabric"):
        weighing.linearise(x, layout.columns(layout.whole((Owned("clamp_slip"),))))


@pytest.mark.parametrize("knee", [60.0, 800.0])
def test_a_descent_ends_where_a_value_is_beyond_all_measure(data: Data, knee: float) -> None:
    """A linear step may lead to e^60 or to no number at all: to an end, or an error that says so.

    A difference over a step that such a value's digits do not hold was none over none.
    """
    coordinates = Coordinates.of([catalogue()["nonlinear_material"]], [data.specimen.nulls()])
    layout, weighing = Layout.of(coordinates.groups), Weighing([data], coordinates)
    x = np.array(layout.null)
    x[:3] = np.log([TRUTH[name] for name in ("E1", "E2", "G12")])
    names = [c.key.parameter for c in coordinates.every]
    x[names.index("s_x")] = 0.2
    x[names.index("knee_x")] = knee
    if knee > 700.0:
        with pytest.raises(SolveError, match="there are no such values"):
            weighing.linearise(x, layout.columns(layout.whole()))
    else:
        here = weighing.linearise(x, layout.columns(layout.whole()))
        assert np.isfinite(here.hessian).all()
        assert np.isfinite(descend(weighing, layout, layout.whole(), x, steps=3).score)


def test_thinned_points_count_for_as_many(data: Data) -> None:
    whole = replace(data, inflation=4.0, mesh=np.ones(data.used.shape))
    some = whole.thinned(3)
    assert some.used.shape[1] == -(-whole.used.shape[1] // 3)
    np.testing.assert_array_equal(some.specimen.reference, whole.specimen.reference[::3])
    assert some.mesh is not None
    assert some.mesh.shape == some.used.shape
    assert some.inflation == pytest.approx(2.0)
    assert whole.thinned(1) is whole


def test_thinned_points_keep_what_persists_in_them(data: Data) -> None:
    """Half of the variance, alike in six frames; of the other half a mean counts 1 + 6/3 times."""
    frames = len(data.used)
    whole = replace(data, inflation=0.5 * frames + 0.5 * 7.0, persistent=0.5)
    assert whole.in_space == pytest.approx(7.0)
    some = whole.thinned(3)
    assert some.inflation == pytest.approx(0.5 * frames + 0.5 * 3.0)
    assert some.in_space == pytest.approx(3.0)


#: Cloth that is not flat, far from flat cloth: it lies loosely under light pressures.
FAR = {"initial_shape.h0": 8.0, "initial_shape.c2": -6.0, "initial_shape.s4": 3.0}
#: Of a shear so soft that the law is not elliptic at 2 bar.
SOFT = {**TRUTH, "G12": 2.0}


def at_three_pressures() -> Specimen:
    at = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    test = BulgeTest.from_arrays(at, np.zeros((3, 2, 3)), [0.002, 0.02, 0.2], poisson_ratio=0.24)
    return Specimen(test, refine=3)


def test_cloth_that_lies_loosely_is_found_by_descent_from_a_neighbour_far_away() -> None:
    specimen, values = at_three_pressures(), {**TRUTH, **FAR}
    found = specimen.shapes(values, near=specimen.shapes(TRUTH, list(FAR)))
    assert found.stable.all()
    afresh = specimen.shapes(values).displacement
    np.testing.assert_allclose(found.displacement, afresh, rtol=0.0, atol=1e-9)


def test_where_the_law_is_not_elliptic_no_descent_leaps_and_it_is_found_from_rest() -> None:
    specimen, values = at_three_pressures(), {**SOFT, **FAR}
    near = specimen.shapes(SOFT, list(FAR))
    with pytest.raises(SolveError, match="near the last shape"):
        specimen.shapes(values, near=near)
    found = _balanced(specimen, values, (), near)
    np.testing.assert_array_equal(found.displacement, specimen.shapes(values).displacement)


def test_from_a_stable_neighbour_the_path_from_rest_goes_no_further_than_it_is_stable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What lies beyond is refused anyhow, and a path to it takes long."""
    specimen, slips = at_three_pressures(), {"clamp_slip.compliance": 0.01}
    near, values = specimen.shapes({**TRUTH, **slips}), {**SOFT, **slips}
    assert not specimen.shapes(values).stable.all()
    with pytest.raises(SolveError) as lost:
        specimen.shapes(values, within=True)
    assert lost.value.cause is Cause.LOSS_OF_ELLIPTICITY
    asked = list[bool]()
    shapes = Specimen.shapes

    def told(self: Specimen, *args: Any, within: bool = False, **more: Any) -> Any:
        asked.append(within)
        return shapes(self, *args, within=within, **more)

    monkeypatch.setattr(Specimen, "shapes", told)
    with pytest.raises(SolveError) as again:
        _balanced(specimen, values, (), near)
    assert str(again.value) == str(lost.value)
    assert asked == [False, True]
    beyond = shapes(specimen, {**SOFT, "clamp_slip.compliance": 0.0101})
    assert not _balanced(specimen, values, (), beyond).stable.all()


def test_a_step_that_its_neighbour_does_not_lead_to_is_too_long() -> None:
    """To begin at, it is found from rest all the same."""
    data = Data(at_three_pressures(), np.full(3, 0.01), np.ones((3, 2, 3), dtype=bool))
    coordinates = Coordinates.of([catalogue()["initial_shape"]], [data.specimen.nulls()])
    layout, weighing = Layout.of(coordinates.groups), Weighing([data], coordinates)
    columns = layout.columns(layout.whole())
    x = np.array(layout.null)
    x[:3] = np.log([SOFT[name] for name in ("E1", "E2", "G12")])
    here = weighing.linearise(x, columns)
    far, names = np.array(x), [c.key.name for c in coordinates.every]
    for name, height in FAR.items():
        far[names.index(name)] = height
    with pytest.raises(SolveError, match="near the last shape"):
        weighing.again(here, far)
    from_rest = weighing.linearise(far, columns, here.near)
    assert from_rest.square == pytest.approx(weighing.linearise(far, columns).square, rel=1e-12)


def test_a_step_that_loses_stability_tells_the_mode_and_what_kept_it_from_that() -> None:
    """What that changes by is the forecast of where steps have to end: by differences, as well."""
    data = Data(at_three_pressures(), np.full(3, 0.01), np.ones((3, 2, 3), dtype=bool))
    # what changes the law, the surface, the weights, the clamp, its edge and the load
    names = ("nonlinear_material", "clamp_shape", "stiffness_gradient", "clamp_slip", "slip_field")
    effects = [{**catalogue(), **fields()}[n] for n in (*names, "prestrain", "pressure_offset")]
    coordinates = Coordinates.of(effects, [data.specimen.nulls()])
    layout, weighing = Layout.of(coordinates.groups), Weighing([data], coordinates)
    columns = layout.columns(layout.whole())
    x = np.array(layout.null)
    x[:3] = np.log([TRUTH["E1"], TRUTH["E2"], 5.0])
    x[layout.part(Owned("clamp_slip"))] = 0.1
    here = weighing.linearise(x, columns)
    beyond = np.array(x)
    beyond[2] = np.log(SOFT["G12"])
    with pytest.raises(LostStabilityError, match="loses its stability at 2 bar") as lost:
        weighing.again(here, beyond)
    brink = lost.value.brink
    assert brink is not None
    assert (brink.specimen, brink.frame) == (0, 2)
    row = weighing.kept_from(brink, here)
    assert row is not None

    def kept(x: np.ndarray) -> float:
        names = [coordinates.every[c].key.name for c in columns]
        at = weighing.linearise(x, columns).near[0]
        return data.specimen.kept_by(at, names[:1], brink.frame, brink.mode).stiffness

    for number, column in enumerate(columns):
        step = 1e-4 * layout.width[column]
        ends = [kept(x + sign * step * (np.arange(len(x)) == column)) for sign in (-1.0, 1.0)]
        by_hand = np.log(ends[1] / ends[0]) / (2.0 * step)
        assert row[number] == pytest.approx(by_hand, rel=1e-3, abs=1e-5 * np.abs(row).max())
    assert row[2] * (beyond[2] - x[2]) < -0.5  # shear that is softer takes it away
    gone = weighing.linearise(beyond, columns)
    assert weighing.kept_from(brink, gone) is None
    told = pickle.loads(pickle.dumps(lost.value))
    assert type(told) is SolveError
    assert str(told) == str(lost.value)


def test_a_reference_image_hides_heights_and_nothing_else() -> None:
    """Each specimen's own, and none that is not weighed beside it; fields are called in anyhow."""
    effects = [*catalogue().values(), *(f for f in fields().values() if f.parameters)]
    groups = Coordinates.of(effects, [{"poisson_ratio.nu12": 0.24}] * 2).groups
    hidden = {g.id: g.hidden_by for g in groups if g.hidden_by}
    assert hidden == {Owned("initial_shape", k): (Owned("reference_state", k),) for k in range(2)}
    alone = Coordinates.of([catalogue()["initial_shape"]], [{}]).groups
    assert not any(g.hidden_by for g in alone)


def test_what_is_known_is_not_stepped_in(data: Data) -> None:
    """Moduli and a shared effect by value; what is stepped in is the same as beside them."""
    cloth = {"E1": 330.0, "E2": 220.0, "G12": 25.0, "nonlinear_material.s_x": -0.2}
    effects = [catalogue()["clamp_slip"]]
    nulls = [data.specimen.nulls()]
    known, free = Coordinates.of(effects, nulls, known=cloth), Coordinates.of(effects, nulls)
    assert [g.id.effect for g in known.groups] == ["clamp_slip"]
    x = np.array([g.null for g in known.groups]).ravel() + 0.01
    assert known.values(x, 0).items() >= cloth.items()
    assert known.scaled({}).known == cloth
    moduli = np.log([cloth[m] for m in ("E1", "E2", "G12")])
    beside = Weighing([data], free)
    alone = Weighing([data], Coordinates.of(effects, nulls, known=dict(list(cloth.items())[:3])))
    whole, own = np.concatenate([moduli, x]), np.arange(len(x))
    one, other = beside.linearise(whole, own + 3), alone.linearise(x, own)
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-9)
    assert one.square == pytest.approx(other.square, rel=1e-12)


def test_a_neighbour_is_found_as_well_by_derivatives_in_single_precision(data: Data) -> None:
    """They take half the memory, and what is balanced does not tell where it was begun from."""
    weighing, layout = weighing_of([data])
    x = near_the_truth(weighing, layout)
    columns = layout.columns(layout.whole())
    here = weighing.linearise(x, columns)
    (whole,), (rounded,) = here.near, weighing.rounded(here.near)
    sizes = [sum(d.nbytes for d in s.derivative.values()) for s in (rounded, whole)]
    assert sizes[0] == sizes[1] / 2
    step = x + 0.02 * layout.width
    found = [weighing.seen(step, [], 0, near).shapes for near in (whole, rounded)]
    np.testing.assert_allclose(found[1].displacement, found[0].displacement, atol=2e-9)
    assert found[0].factorisations == found[1].factorisations
