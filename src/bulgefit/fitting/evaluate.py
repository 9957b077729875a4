"""The objectives of given parameters, and tables of objectives against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import SolveError
from bulgefit.fitting.objective import OBJECTIVES, Objective, TestParts
from bulgefit.fitting.result import describe_tests, versions
from bulgefit.model.parameters import Material
from bulgefit.model.virtual_test import Setup
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["cross_table", "evaluate", "evaluate_resting"]


def evaluate(
    tests: BulgeTest | Sequence[BulgeTest],
    material: Material,
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> dict[str, Any]:
    """Every objective of a material on the tests, as JSON types (mm).

    Raises
    ------
    InputError
        Parameters that are not admissible, or tests that cannot be used.
    SolveError
        The membrane finds no equilibrium.
    """
    objective = _objective(tests, weight, average, setup)
    with one_blas_thread():
        parts = objective.parts(objective.virtual.fields(material))
    return {"parameters": dict(material.values), **_payload(objective, parts)}


def evaluate_resting(
    tests: BulgeTest | Sequence[BulgeTest],
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> dict[str, Any]:
    """Every objective of a model that does not deform (the study's Table 5), mm."""
    objective = _objective(tests, weight, average, setup)
    return _payload(objective, objective.parts(objective.resting()))


def cross_table(
    tests: BulgeTest | Sequence[BulgeTest],
    optima: Mapping[str, Material],
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> dict[str, dict[str, float | None]]:
    """Each objective under each optimum (the study's Table 4), and of a resting model, mm.

    Parameters
    ----------
    optima : mapping of name to Material
        Usually the optimum of each objective.

    Returns
    -------
    dict
        A row of e, e_w and e_z for each optimum; None where it finds no equilibrium at the tests'
        pressures.
    """
    objective = _objective(tests, weight, average, setup)

    def row(material: Material) -> dict[str, float | None]:
        try:
            fields = objective.virtual.fields(material)
        except SolveError:
            # an optimum over fewer pressures need not reach those of this table
            return dict.fromkeys(OBJECTIVES)
        return objective.combined(objective.parts(fields))

    with one_blas_thread():
        table = {name: row(material) for name, material in optima.items()}
    return table | {"undeformed": objective.combined(objective.parts(objective.resting()))}


def _objective(
    tests: BulgeTest | Sequence[BulgeTest],
    weight: float | Sequence[float] | None,
    average: str,
    setup: Setup | None,
) -> Objective:
    given = [tests] if isinstance(tests, BulgeTest) else list(tests)
    return Objective(given, "e_w", setup, weight=weight, average=average)


def _payload(objective: Objective, parts: Sequence[TestParts]) -> dict[str, Any]:
    return {
        **objective.combined(parts),
        "weight": objective.weight,
        "weights": objective.weights.tolist(),
        "unit": "mm",
        "tests": [asdict(p) for p in parts],
        "sources": describe_tests(objective.tests),
        "versions": versions(),
    }
