"""Which figures has a result? One name for all of them, by what the result is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTest, given_test
from bulgefit.dic.surface.measured import Measured
from bulgefit.errors import InputError
from bulgefit.fitting.answers import CrossValidation, Evaluation
from bulgefit.fitting.batch import Batch, batch_of
from bulgefit.fitting.bootstrap import Bootstrap
from bulgefit.fitting.result import FitResult
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.model.predict import Predicted, predict
from bulgefit.model.simulation import Simulation
from bulgefit.report._diagnosis_charts import plot_budget, plot_cosines
from bulgefit.report._diagnosis_fields import plot_component, plot_signatures
from bulgefit.report._diagnosis_maps import plot_modes, plot_where
from bulgefit.report._diagnosis_parts import COMPONENTS
from bulgefit.report.folds import plot_folds
from bulgefit.report.measured import plot_apex, plot_measured, plot_rings
from bulgefit.report.objectives import plot_objectives
from bulgefit.report.profiles import plot_profiles
from bulgefit.report.record import record_of
from bulgefit.report.refits import plot_refits
from bulgefit.report.residuals import plot_residuals
from bulgefit.report.shapes import plot_shapes
from bulgefit.report.spreads import plot_spreads
from bulgefit.report.trials import plot_reliability, plot_shares, plot_sizes
from bulgefit.trial.answer import TrialAnswer

__all__ = ["plot"]


class _Kind(NamedTuple):
    """How a figure is drawn, and what it takes beside `path` and `force`."""

    draw: Callable[..., Any]
    takes: tuple[str, ...] = ()


_Kinds = Mapping[str, _Kind]

#: Of measured beside modelled displacements.
_BESIDE = {"profiles": plot_profiles, "residuals": plot_residuals}


def plot(result: Any, kind: str | None = None, **how: Any) -> Any:
    """Draw a figure of a result; `result.plot(kind, ...)` is the same.

    ===================  ==========================================================================
    of                   kinds, the first by default
    ===================  ==========================================================================
    `read_test`          `profiles` as measured
    `fit`                `parameters` with their 95 % intervals; `profiles` and `residuals` of
                         `test=`, a test or its path, the fit's `index=` (0)
    `batch_of`           `parameters` of all specimens
    `bootstrap`          `parameters` of all refits
    `crossval`           `folds`
    `evaluate`           `objectives` and mean deviations, test by test
    `simulate`           `shapes`
    `predict`            `profiles`, `residuals`
    `measure`            `apex`, `rings`, beside a `model=` too; `fields` of `frame=` (the last)
    `diagnose`           `budget`, `cosines`; of `test=` (0): `where` (`after=True`), `modes`,
                         `signatures`, `dx`, `dy`, `dz`
    `run_trial`          `shares`, `sizes`, `reliability`
    ===================  ==========================================================================

    Parameters
    ----------
    result
        What one of these gave.
    kind : str, optional
    **how
        `path` to write the figure to, a .png, .pdf or .svg (by default nothing is written),
        `force=True` to replace a file that exists; others as above.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        The result has no such figure, or the file cannot be written.
    """
    kinds = _kinds_of(result)
    name = next(iter(kinds)) if kind is None else kind
    if name not in kinds:
        raise InputError(
            f"plot: {type(result).__name__} has no {name!r}; choose from {', '.join(kinds)}"
        )
    takes = ("path", "force", *kinds[name].takes)
    for option in how:
        if option not in takes:
            raise InputError(f"plot: {name} takes no {option}, but {', '.join(takes)}")
    figure = kinds[name].draw(**how)
    if figure is None:
        raise InputError(f"plot: {type(result).__name__} has nothing to draw for {name!r}")
    return figure


def _kinds_of(result: Any) -> _Kinds:
    for of, kinds in _RESULTS.items():
        if isinstance(result, of):
            return kinds(result)
    raise InputError(
        f"plot: {type(result).__name__} is no result that has figures; give that of "
        "read_test, fit, batch_of, bootstrap, crossval, evaluate, predict, simulate, measure, "
        "diagnose or run_trial"
    )


def _of_fit(result: FitResult) -> _Kinds:
    def beside(
        draw: Callable[..., Any], *, test: GivenTest | None = None, index: int = 0, **how: Any
    ) -> Any:
        if test is None:
            raise InputError("plot: a fit keeps no test; give the one that is to be drawn, test=")
        given, effects = given_test(test), result.effects_of(index)
        prediction = predict(given, result.material, effects=effects, setup=result.setup)
        return draw(given, prediction.blocks, label=f"{result.objective} fit", **how)

    return {
        "parameters": _Kind(partial(plot_spreads, batch_of([result]))),
        **{name: _Kind(partial(beside, draw), ("test", "index")) for name, draw in _BESIDE.items()},
    }


def _of_prediction(result: Predicted) -> _Kinds:
    return {
        name: _Kind(partial(draw, result.test, result.blocks)) for name, draw in _BESIDE.items()
    }


def _of_measured(result: Measured) -> _Kinds:
    return {
        "apex": _Kind(partial(plot_apex, result), ("model",)),
        "rings": _Kind(partial(plot_rings, result), ("model",)),
        "fields": _Kind(partial(plot_measured, result), ("frame", "label")),
    }


def _of_diagnosis(result: Diagnosis) -> _Kinds:
    def of_test(draw: Callable[..., Any], *, test: int = 0, **how: Any) -> Any:
        if test not in range(len(result.tests)):
            raise InputError(f"plot: no test {test!r}; give 0 to {len(result.tests) - 1}")
        return draw(result, test, **how)

    def where(*, after: bool = True, **how: Any) -> Any:
        return of_test(partial(plot_where, after=after), **how)

    each: dict[str, Callable[..., Any]] = {"modes": plot_modes, "signatures": plot_signatures}
    for number, name in enumerate(COMPONENTS):
        each[name] = partial(plot_component, component=number)
    return {
        "budget": _Kind(lambda **how: plot_budget(record_of(result), **how)),
        "cosines": _Kind(partial(plot_cosines, result)),
        "where": _Kind(where, ("test", "after")),
        **{name: _Kind(partial(of_test, draw), ("test",)) for name, draw in each.items()},
    }


_RESULTS: dict[type, Callable[[Any], _Kinds]] = {
    FitResult: _of_fit,
    Batch: lambda result: {"parameters": _Kind(partial(plot_spreads, result))},
    Bootstrap: lambda result: {"parameters": _Kind(partial(plot_refits, result))},
    Simulation: lambda result: {"shapes": _Kind(partial(plot_shapes, result))},
    BulgeTest: lambda result: {"profiles": _Kind(partial(plot_profiles, result))},
    Evaluation: lambda result: {"objectives": _Kind(partial(plot_objectives, result))},
    CrossValidation: lambda result: {"folds": _Kind(partial(plot_folds, result))},
    Predicted: _of_prediction,
    Measured: _of_measured,
    Diagnosis: _of_diagnosis,
    TrialAnswer: lambda result: {
        "shares": _Kind(partial(plot_shares, result)),
        "sizes": _Kind(partial(plot_sizes, result)),
        "reliability": _Kind(partial(plot_reliability, result)),
    },
}
