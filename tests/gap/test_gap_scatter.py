"""Scatter over specimens: against draws of known scatter, and free of how factors are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import catalogue, scatter
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.scatter import modulus_errors, of_the_cloth, scatter_of

#: Standard deviation of a factor's prior in a fit.
PRIOR = 0.08
E1 = Key.of("E1")
MODULI = {E1: 300.0, Key.of("E2"): 200.0, Key.of("G12"): 10.0}


@dataclass(frozen=True)
class Told:
    """What `scatter_of` asks of a regression: factors whose logarithms were seen with one error."""

    values: dict[Key, float]
    error: float

    @property
    def columns(self) -> tuple[Key, ...]:
        return tuple(self.values)

    @property
    def covariance(self) -> np.ndarray:
        """The posterior under the fit's prior: moduli are known up to what factors may take."""
        columns = list(self.columns)
        logs = np.zeros((len(columns), len(columns)))
        logs[:3, :3] = np.diag([10.0**-2] * 3)
        for modulus, axis in (("E1", "warp"), ("E2", "fill")):
            for factor in (c for c in columns if c.parameter == axis):
                row = np.zeros(len(columns))
                row[columns.index(Key.of(modulus))] = 1.0
                row[columns.index(factor)] = 1.0
                logs += np.outer(row, row) / self.error**2
        factors = np.arange(len(columns)) >= 3
        logs[factors, factors] += PRIOR**-2
        by = np.array(list(self.values.values()))
        return np.linalg.inv(logs) * np.outer(by, by)

    def standard_errors(self) -> dict[Key, float]:
        return dict(zip(self.columns, np.sqrt(np.diag(self.covariance)), strict=True))


def told(logs: np.ndarray, error: float = 0.003) -> Told:
    """Of logarithms (specimens, 2) that were seen, as the posterior's mean tells them."""
    centred = (logs - logs.mean(axis=0)) * PRIOR**2 / (PRIOR**2 + error**2)
    factors = {
        Key("specimen_factor", axis, i): float(np.exp(centred[i, k]))
        for i in range(len(logs))
        for k, axis in enumerate(("warp", "fill"))
    }
    return Told({**MODULI, **factors}, error)


def test_scatter_of_many_specimens_is_met() -> None:
    """Of 400 specimens with 7 % and 4 %, known by 0.3 % each: to three of s/√(2n)."""
    rng = np.random.default_rng(5)
    found = scatter_of(told(rng.normal(size=(400, 2)) * [0.07, 0.04]))
    for modulus, true in (("E1", 0.07), ("E2", 0.04)):
        error = true / np.sqrt(2.0 * 400)
        assert abs(found[modulus].value - true) < 3.0 * error
        assert found[modulus].stderr == pytest.approx(error, rel=0.25)


def test_errors_of_the_scatter_hold() -> None:
    """Three specimens, scatter drawn from what is believed of it: off by its error, squared."""
    rng = np.random.default_rng(6)
    units = []
    for _ in range(400):
        true = np.exp(rng.normal(np.log(np.sqrt(0.05 * 0.10)), 0.5 * np.log(2.0)))
        found = scatter_of(told(rng.normal(size=(3, 2)) * true))["E1"]
        units.append((found.value - true) / found.stderr)
    # a mean square of 400 is known to 7 %; the posterior is a little skew
    assert np.mean(np.square(units)) == pytest.approx(1.0, abs=0.25)
    assert abs(np.mean(units)) < 0.15


def test_what_is_not_seen_is_believed() -> None:
    """Where the data say next to nothing of the factors, the belief is all there is."""
    found = scatter_of(told(np.zeros((3, 2)), error=5.0))["E1"]
    spread = 0.5 * np.log(2.0)
    mean = np.sqrt(0.05 * 0.10) * np.exp(0.5 * spread**2)
    assert found.value == pytest.approx(mean, rel=0.02)
    assert found.stderr == pytest.approx(mean * np.sqrt(np.expm1(spread**2)), rel=0.05)


def test_moduli_are_the_mean_specimens() -> None:
    """Factors and moduli that go opposite ways change neither the cloth nor its errors."""
    logs = np.array([[0.05, 0.02], [-0.03, 0.04], [0.01, -0.06]])
    plain = told(logs)
    shifted = dict(plain.values)
    shifted[E1] *= 1.04
    for i in range(3):
        shifted[Key("specimen_factor", "warp", i)] /= 1.04
    other = Told(shifted, plain.error)
    assert of_the_cloth(shifted) == pytest.approx(of_the_cloth(plain.values), rel=1e-12)
    assert scatter_of(other)["E1"].value == pytest.approx(scatter_of(plain)["E1"].value, rel=1e-9)
    # n specimens seen with 0.3 % each: what factors may take from the modulus alone is left out
    expected = 300.0 * plain.error / np.sqrt(3.0)
    assert modulus_errors(plain)[E1] == pytest.approx(expected, rel=0.01)
    assert plain.standard_errors()[E1] > 10.0 * expected


def test_one_specimen_has_no_scatter() -> None:
    assert scatter_of(Told(MODULI, 0.003)) == {}
    assert of_the_cloth(MODULI) == MODULI


def test_factors_are_in_every_model_of_several() -> None:
    nulls = [{"poisson_ratio.nu12": 0.24}] * 3
    effects = [catalogue()[name] for name in ("clamp_shape", "prestrain")]
    coordinates = Coordinates.of([*effects, *scatter().values()], nulls)
    layout = Layout.of(coordinates.groups)
    smallest = layout.columns(frozenset())
    keys = {str(coordinates.every[c].key) for c in smallest}
    factors = {f"specimen_factor.{axis}@{i}" for axis in ("warp", "fill") for i in range(3)}
    assert keys == {"E1", "E2", "G12"} | factors
    assert {c.width for c in coordinates.every if c.key.effect == "specimen_factor"} == {PRIOR}
    one = coordinates.of_specimen(smallest, 1)
    assert {coordinates.every[c].key.specimen for c in one} == {None, 1}


def test_one_rig_has_one_clamp() -> None:
    nulls = [{"poisson_ratio.nu12": 0.24}] * 2
    effects = [catalogue()[name] for name in ("clamp_shape", "lens_distortion", "prestrain")]
    apart, same = (
        [str(g.id) for g in Coordinates.of(effects, nulls, same_rig=rig).groups]
        for rig in (False, True)
    )
    assert "clamp_shape@1" in apart
    shared = ["clamp_shape", "lens_distortion", "moduli"]
    assert sorted(same) == [*shared, "prestrain@0", "prestrain@1"]
