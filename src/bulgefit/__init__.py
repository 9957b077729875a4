"""Material parameters of fabrics from bulge inflation tests filmed by 3D DIC.

Everything named here is public; importing the package loads nothing heavy, each name brings its
own module with it when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from bulgefit.errors import BulgefitError, InputError, SolveError
from bulgefit.shown import drawn_by

if TYPE_CHECKING:
    from bulgefit.dic.bulge_test import BulgeTest as BulgeTest
    from bulgefit.dic.readers import read_test as read_test
    from bulgefit.dic.surface.measured import Measured as Measured
    from bulgefit.dic.surface.measured import measure as measure
    from bulgefit.dic.writers import write_test as write_test
    from bulgefit.fem.mesh import Mesh as Mesh
    from bulgefit.fem.mesh import disc as disc
    from bulgefit.fitting.answers import CrossValidation as CrossValidation
    from bulgefit.fitting.answers import Evaluation as Evaluation
    from bulgefit.fitting.batch import Batch as Batch
    from bulgefit.fitting.batch import batch_of as batch_of
    from bulgefit.fitting.bootstrap import Bootstrap as Bootstrap
    from bulgefit.fitting.bootstrap import bootstrap as bootstrap
    from bulgefit.fitting.crossval import crossval as crossval
    from bulgefit.fitting.evaluate import evaluate as evaluate
    from bulgefit.fitting.fit import fit as fit
    from bulgefit.fitting.options import FitOptions as FitOptions
    from bulgefit.fitting.problem import Prior as Prior
    from bulgefit.fitting.result import FitResult as FitResult
    from bulgefit.gap.diagnose import diagnose as diagnose
    from bulgefit.gap.diagnosis import Diagnosis as Diagnosis
    from bulgefit.model.parameters import Material as Material
    from bulgefit.model.parameters import material as material
    from bulgefit.model.predict import Predicted as Predicted
    from bulgefit.model.predict import predict as predict
    from bulgefit.model.setup import Setup as Setup
    from bulgefit.model.simulation import Simulation as Simulation
    from bulgefit.model.simulation import simulate as simulate
    from bulgefit.report.fields import plot_fields as plot_fields
    from bulgefit.report.folds import plot_folds as plot_folds
    from bulgefit.report.measured import plot_apex as plot_apex
    from bulgefit.report.measured import plot_measured as plot_measured
    from bulgefit.report.measured import plot_rings as plot_rings
    from bulgefit.report.objectives import plot_objectives as plot_objectives
    from bulgefit.report.paraview import write_paraview as write_paraview
    from bulgefit.report.paraview import write_test_paraview as write_test_paraview
    from bulgefit.report.plot import plot as plot
    from bulgefit.report.profiles import plot_profiles as plot_profiles
    from bulgefit.report.refits import plot_refits as plot_refits
    from bulgefit.report.residuals import plot_residuals as plot_residuals
    from bulgefit.report.shapes import plot_shapes as plot_shapes
    from bulgefit.report.show import animate as animate
    from bulgefit.report.show import show as show
    from bulgefit.report.spreads import plot_spreads as plot_spreads
    from bulgefit.report.trials import plot_reliability as plot_reliability
    from bulgefit.report.trials import plot_shares as plot_shares
    from bulgefit.report.trials import plot_sizes as plot_sizes
    from bulgefit.trial.answer import TrialAnswer as TrialAnswer
    from bulgefit.trial.run import run_trial as run_trial

    __version__: str

#: Where each public name lives.
_HOMES = {
    "Batch": "bulgefit.fitting.batch",
    "Bootstrap": "bulgefit.fitting.bootstrap",
    "BulgeTest": "bulgefit.dic.bulge_test",
    "CrossValidation": "bulgefit.fitting.answers",
    "Diagnosis": "bulgefit.gap.diagnosis",
    "Evaluation": "bulgefit.fitting.answers",
    "FitResult": "bulgefit.fitting.result",
    "Material": "bulgefit.model.parameters",
    "Measured": "bulgefit.dic.surface.measured",
    "Mesh": "bulgefit.fem.mesh",
    "Predicted": "bulgefit.model.predict",
    "Simulation": "bulgefit.model.simulation",
    "TrialAnswer": "bulgefit.trial.answer",
    "animate": "bulgefit.report.show",
    "batch_of": "bulgefit.fitting.batch",
    "bootstrap": "bulgefit.fitting.bootstrap",
    "crossval": "bulgefit.fitting.crossval",
    "diagnose": "bulgefit.gap.diagnose",
    "disc": "bulgefit.fem.mesh",
    "evaluate": "bulgefit.fitting.evaluate",
    "fit": "bulgefit.fitting.fit",
    "material": "bulgefit.model.parameters",
    "FitOptions": "bulgefit.fitting.options",
    "Prior": "bulgefit.fitting.problem",
    "Setup": "bulgefit.model.setup",
    "predict": "bulgefit.model.predict",
    "measure": "bulgefit.dic.surface.measured",
    "plot": "bulgefit.report.plot",
    "plot_apex": "bulgefit.report.measured",
    "plot_fields": "bulgefit.report.fields",
    "plot_folds": "bulgefit.report.folds",
    "plot_measured": "bulgefit.report.measured",
    "plot_objectives": "bulgefit.report.objectives",
    "plot_profiles": "bulgefit.report.profiles",
    "plot_refits": "bulgefit.report.refits",
    "plot_reliability": "bulgefit.report.trials",
    "plot_residuals": "bulgefit.report.residuals",
    "plot_rings": "bulgefit.report.measured",
    "plot_shapes": "bulgefit.report.shapes",
    "plot_shares": "bulgefit.report.trials",
    "plot_sizes": "bulgefit.report.trials",
    "plot_spreads": "bulgefit.report.spreads",
    "read_test": "bulgefit.dic.readers",
    "run_trial": "bulgefit.trial.run",
    "show": "bulgefit.report.show",
    "simulate": "bulgefit.model.simulation",
    "write_paraview": "bulgefit.report.paraview",
    "write_test_paraview": "bulgefit.report.paraview",
    "write_test": "bulgefit.dic.writers",
}

__all__ = ["BulgefitError", "InputError", "SolveError", *_HOMES]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            found: Any = version("bulgefit")
        except PackageNotFoundError:  # run from its sources without being installed
            found = "0+not.installed"
    elif name in _HOMES:
        found = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def _draw(*given: Any, **how: Any) -> Any:
    return __getattr__("plot")(*given, **how)


drawn_by(_draw)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
