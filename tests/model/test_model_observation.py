"""Operators from nodes to points: exact where they must be, and honest at the rim."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc, rectangle
from bulgefit.model.observation import METHODS, operators

MESH = disc(100.0, 2)


def points_inside(count: int = 200, radius: float = 98.0) -> np.ndarray:
    rng = np.random.default_rng(5)
    r, angle = radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


@pytest.mark.parametrize("method", METHODS)
def test_exact_at_the_nodes(method: str) -> None:
    field = np.random.default_rng(1).normal(size=(2, len(MESH.nodes), 3))
    np.testing.assert_allclose(operators(MESH, MESH.nodes, method)(field), field, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_stays_constant_but_for_the_studys_functions(method: str) -> None:
    field = np.full((1, len(MESH.nodes), 3), 2.5)
    seen = operators(MESH, points_inside(), method)(field)
    # the study's radial basis functions carry no constant, so they miss one by a little
    np.testing.assert_allclose(seen, 2.5, atol=2e-2 if method == "rbf" else 1e-10)


def test_shape_functions_reproduce_linear_fields_up_to_the_rim() -> None:
    points = np.vstack([points_inside(), points_inside(100, 100.0)])
    angle = np.linspace(0, 2 * np.pi, 200)
    points = np.vstack([points, 99.99 * np.column_stack([np.cos(angle), np.sin(angle)])])

    def linear(at: np.ndarray) -> np.ndarray:
        x, y = at.T
        return np.column_stack([1 + 2 * x - y, 0.3 * y, x])

    seen = operators(MESH, points, "shape")(linear(MESH.nodes)[None])[0]
    np.testing.assert_allclose(seen, linear(points), atol=1e-9)


def test_shape_functions_reproduce_bilinear_fields_on_a_regular_grid() -> None:
    mesh = rectangle((-1.0, 2.0), (0.0, 1.0), 5, 4)
    points = np.random.default_rng(2).uniform((-1, 0), (2, 1), (50, 2))

    def bilinear(at: np.ndarray) -> np.ndarray:
        x, y = at.T
        return np.column_stack([x * y, 1 + x - 3 * x * y, y])

    # a bilinear field of the whole rectangle is bilinear in each of its cells
    seen = operators(mesh, points, "shape")(bilinear(mesh.nodes)[None])[0]
    np.testing.assert_allclose(seen, bilinear(points), atol=1e-12)


def test_points_beyond_a_chord_of_the_rim_are_extrapolated_by_less_than_a_cell() -> None:
    # between two rim nodes the clamp bulges out over the straight edge of the cell
    first, second = 0.25 * np.pi, 0.25 * np.pi + 2 * np.pi / 24
    middle = 0.5 * (first + second)
    beyond = 99.999 * np.array([[np.cos(middle), np.sin(middle)]])
    weights = operators(MESH, beyond, "shape").value.toarray()[0]
    assert weights.sum() == pytest.approx(1.0)
    assert np.abs(weights).sum() < 1.5
    field = 1 - (MESH.nodes**2).sum(axis=1) / 1e4
    assert abs(weights @ field) < 0.03


def test_rbf_is_the_studys_interpolator() -> None:
    points = points_inside(60)
    field = np.random.default_rng(3).normal(size=(2, len(MESH.nodes), 3))
    seen = operators(MESH, points, "rbf")(field)
    for values, found in zip(field, seen, strict=True):
        theirs = RBFInterpolator(MESH.nodes, values, kernel="linear", degree=-1)(points)
        np.testing.assert_allclose(found, theirs, atol=1e-8)


def test_local_rbf_is_scipys_with_the_same_neighbours() -> None:
    points = points_inside(60)
    field = np.random.default_rng(4).normal(size=(1, len(MESH.nodes), 3))
    seen = operators(MESH, points, "local-rbf")(field)[0]
    theirs = RBFInterpolator(MESH.nodes, field[0], neighbors=16, kernel="linear", degree=0)(points)
    np.testing.assert_allclose(seen, theirs, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_smooth_fields_agree_between_methods(method: str) -> None:
    def dome(at: np.ndarray) -> np.ndarray:
        return 40 * (1 - (at**2).sum(axis=1) / 1e4)

    points = points_inside(100, 85.0)
    field = np.repeat(dome(disc(100.0, 4).nodes)[None, :, None], 3, axis=2)
    seen = operators(disc(100.0, 4), points, method)(field)[0, :, 0]
    assert np.abs(seen - dome(points)).max() < 0.15


def test_unknown_method_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"'spline' is unknown; choose from smooth, shape, rbf"):
        operators(MESH, points_inside(3), "spline")
