"""The objectives of given parameters, and tables of objectives against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTests, given_tests
from bulgefit.effects.parameter import of_specimen
from bulgefit.errors import SolveError
from bulgefit.fitting.answers import Evaluation
from bulgefit.fitting.free import key_among, stated_ratio
from bulgefit.fitting.objective import OBJECTIVES, Objective, TestParts
from bulgefit.fitting.result import FORMAT, FitResult, describe_tests, versions
from bulgefit.model.inflation import Shapes
from bulgefit.model.parameters import Material, as_effects, as_material
from bulgefit.model.setup import Setup
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["cross_table", "evaluate", "evaluate_resting"]


def evaluate(
    tests: GivenTests,
    material: Material | Mapping[str, float],
    *,
    effects: Mapping[str, float] | None = None,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> Evaluation:
    """Every objective of a material on the tests, as JSON types (mm).

    Parameters
    ----------
    material : Material or mapping
        Or E1, E2, G12 (MPa) and nu12 of an orthotropic one.
    effects : mapping of `effect.parameter` to value, optional
        What else the tests have; `effect.parameter@i` is test i's own.

    Raises
    ------
    InputError
        Parameters that are not admissible, tests that cannot be used, or no Poisson's ratio where
        the tests state different ones.
    SolveError
        The membrane finds no equilibrium.
    """
    objective = _objective(tests, weight, average, setup)
    made = _of_all(material, objective.tests)
    with one_blas_thread():
        parts = objective.parts(_shapes(objective, made, as_effects(effects)))
    answer = Evaluation({"parameters": dict(made.values), **_payload(objective, parts)})
    if effects:
        answer["effects"] = as_effects(effects)
    return answer


def _of_all(given: Material | Mapping[str, float], tests: Sequence[BulgeTest]) -> Material:
    """A material; of the Poisson's ratio that all tests state, where it needs one."""
    needs = isinstance(given, Mapping) and not {"nu12", "nu", "G"} & set(given)
    return as_material(given, stated_ratio(tests) if needs else tests[0].poisson_ratio)


def _shapes(objective: Objective, material: Material, effects: Mapping[str, float]) -> list[Shapes]:
    """Corrected for the mesh's error, where the setup asks for that."""
    count = len(objective.tests)
    given = {key_among(name, count, "effects"): value for name, value in effects.items()}
    values = [{**material.constants(), **of_specimen(given, i)} for i in range(count)]
    shapes = objective.shapes(values)
    if objective.setup.corrects_mesh:
        objective.correct_mesh(shapes)
    return shapes


def evaluate_resting(
    tests: GivenTests,
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> Evaluation:
    """Every objective of a model that does not deform (the study's Table 5), mm."""
    objective = _objective(tests, weight, average, setup)
    return Evaluation(_payload(objective, objective.parts(None)))


def cross_table(
    tests: GivenTests,
    optima: Mapping[str, Material | FitResult],
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
) -> dict[str, dict[str, float | None]]:
    """Each objective under each optimum (the study's Table 4), and of a resting model, mm.

    Parameters
    ----------
    optima : mapping of name to Material or FitResult
        Usually the fit by each objective, whose effects are taken along.

    Returns
    -------
    dict
        A row of e, e_w and e_z for each optimum; None where it finds no equilibrium at the tests'
        pressures.
    """
    objective = _objective(tests, weight, average, setup)

    def row(optimum: Material | FitResult) -> dict[str, float | None]:
        found = optimum if isinstance(optimum, Material) else optimum.material
        effects = {} if isinstance(optimum, Material) else optimum.effects
        try:
            shapes = _shapes(objective, found, effects)
        except SolveError:
            # an optimum over fewer pressures need not reach those of this table
            return dict.fromkeys(OBJECTIVES)
        return objective.combined(objective.parts(shapes))

    with one_blas_thread():
        table = {name: row(optimum) for name, optimum in optima.items()}
    return table | {"undeformed": objective.combined(objective.parts(None))}


def _objective(
    tests: GivenTests,
    weight: float | Sequence[float] | None,
    average: str,
    setup: Setup | None,
) -> Objective:
    given = given_tests(tests)
    return Objective(given, "e_w", setup, weight=weight, average=average)


def _payload(objective: Objective, parts: Sequence[TestParts]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        **objective.combined(parts),
        "weight": objective.weight,
        "weights": objective.weights.tolist(),
        "unit": "mm",
        "tests": [asdict(p) for p in parts],
        "sources": describe_tests(objective.tests),
        "versions": versions(),
    }
