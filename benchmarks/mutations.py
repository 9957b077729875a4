"""Does a test fail where a kernel, a law, an effect, the noise or the evidence is wrong?

    python benchmarks/mutations.py [--only 0:20] [--results mutations.json]

A copy of the sources is broken in one place after another, by a sign, a factor, an index or a unit,
and the tests that should notice are run in it. What none of them notices survives, and the command
leaves with status 1. The tests are run in the unbroken copy before: what fails there tells nothing.
Results are kept in a file, so that slices add up and only what survived is tried again; `--table`
prints all of it for docs/verification.md.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
COPIED = ("src", "tests", "data", "docs", "benchmarks", "pyproject.toml")
#: A test that takes longer hangs: a mutant that never ends is caught as well.
TIME_LIMIT = 600.0


@dataclass(frozen=True)
class Mutant:
    """One thing that is wrong.

    Attributes
    ----------
    file : str
        Below src/bulgefit.
    old, new : str
        `old` stands in the file once.
    tests : str
        What pytest is told, below tests.
    """

    file: str
    old: str
    new: str
    tests: str


SIGNS = "effects/test_effects_signs.py"
TRIAL = "trial/test_trial_effects.py"
NOISE = "gap/test_gap_noise.py"
EVIDENCE = "gap/test_gap_evidence.py"
LEVEL = "gap/test_gap_level.py"
SIMULATE = "cli/test_cli_simulate.py"
CREASES = "gap/test_gap_creases.py gap/test_gap_weighing.py"
LAWS = "fem/test_laws.py"
WEIGHING = "gap/test_gap_weighing.py"
FITS = "fitting/test_inverse_fit.py"
FACE = "model/test_model_face.py"
WARP = "model/test_model_warp.py"
COARSE = "model/test_model_coarse.py"
WINDOW = "model/test_model_window.py"
CONSISTENCY = "fem/test_consistency.py"
OBJECTIVE = "fitting/test_inverse_objective.py"
NEWS = "fitting/test_bad_news.py"
FEW = "fitting/test_fitting_few_values.py"
TOLD = "cli/test_cli_told.py"
ALIGN = "dic/test_dic_align.py"
HELD_OUT = "gap/test_gap_diagnose.py::test_what_only_the_kept_out_specimen_has_is_found"

MUTANTS = (
    # effects
    Mutant("effects/clamp_lobes.py", '+ own["s3"] *', '- own["s3"] *', SIGNS),
    Mutant("effects/clamp_shape.py", "grown * (1.0 - oval)", "grown * (1.0 + oval)", SIGNS),
    Mutant("effects/initial_shape.py", '["s2"] * 2 * x', '["s2"] * x', SIGNS),
    Mutant("effects/initial_shape.py", '["hx"] * x + ', '["hx"] * y + ', SIGNS),
    Mutant("effects/initial_shape.py", "(1.0 - square) * inside", "inside", SIGNS),
    Mutant("effects/clamp_slip.py", '0.0) + own["compl', '0.0) + 2.0 * own["compl', SIGNS),
    Mutant("effects/prestrain.py", 'y + own["slack_y"]', 'y - own["slack_y"]', SIGNS),
    Mutant("effects/rim_lift.py", "angle - np.deg2rad", "angle + np.deg2rad", SIGNS),
    Mutant("effects/places.py", "(-shape * bar) / shape if", "(-shape * bar) if", SIGNS),
    Mutant("effects/places.py", "np.log10(1.0 +", "np.log(1.0 +", f"{SIGNS} {TRIAL}"),
    Mutant("effects/places.py", "np.sort(self.schedule)", "np.sort(self.time)", SIGNS),
    Mutant(
        "model/description.py",
        "gives * softening - compliance",
        "gives / softening - compliance",
        "effects/test_effects_fields.py",
    ),
    Mutant("effects/creep.py", '(1.0 - own["rate"]', '(1.0 + own["rate"]', f"{SIGNS} {TRIAL}"),
    Mutant("effects/poisson_ratio.py", 'nu12=own["nu12"]', 'nu12=0.5 * own["nu12"]', SIGNS),
    Mutant("effects/specimen_factor.py", 'E2=own["fill"]', 'E2=own["warp"]', SIGNS),
    Mutant("effects/stiffness_gradient.py", "1.0 + cloth", "1.0 - cloth", SIGNS),
    Mutant("effects/pressure_offset.py", "applied - _BAR", "applied + _BAR", SIGNS),
    Mutant("effects/pressure_offset.py", '_BAR * own["', 'own["', SIGNS),
    Mutant("effects/pressure_gain.py", "/ (1.0 + own", "* (1.0 + own", SIGNS),
    Mutant("effects/fixture_motion.py", "scene.pressure / _BAR", "scene.pressure", SIGNS),
    Mutant(
        "effects/registration.py",
        'return own["x0"], own["y0"]',
        'return own["y0"], own["x0"]',
        SIGNS,
    ),
    Mutant("effects/rigid_motion.py", "np.tile(shift", "np.tile(-shift", SIGNS),
    Mutant("effects/dic_scale.py", "return seen / (", "return seen * (", SIGNS),
    Mutant(
        "effects/depth_scale.py",
        '[1.0, 1.0, 1.0 + own["scale_z"]]',
        '[1.0, 1.0 + own["scale_z"], 1.0]',
        SIGNS,
    ),
    Mutant("effects/surface_offset.py", 'return own["share"]', 'return -own["share"]', SIGNS),
    Mutant("model/face.py", "now.normal - rest.normal", "now.normal + rest.normal", FACE),
    Mutant("model/face.py", "rest.normal - self._beside", "rest.normal + self._beside", FACE),
    Mutant(
        "model/face.py",
        "np.cross(self.normal, self.a) / self.area",
        "np.cross(self.a, self.normal) / self.area",
        FACE,
    ),
    Mutant(
        "model/virtual_test.py",
        "share * self.test.thickness",
        "0.5 * share * self.test.thickness",
        SIGNS,
    ),
    Mutant("trial/window.py", "total += above *", "total -= above *", TRIAL),
    Mutant("effects/lens_distortion.py", "square / radius**2", "square / radius", SIGNS),
    Mutant("effects/reference_state.py", "moved - flattened", "moved + flattened", SIGNS),
    Mutant("effects/frame_misalignment.py", "as_matrix().T", "as_matrix()", SIGNS),
    Mutant("effects/axis_misalignment.py", "cloth.angle + own", "cloth.angle - own", SIGNS),
    Mutant("model/description.py", "points, angle=warp)", "points, angle=-warp)", WARP),
    Mutant("fem/quarter.py", "angle=membrane.angle, fixed=kind", "angle=0.0, fixed=kind", WARP),
    Mutant(
        "dic/bulge_test.py",
        "self.warp_angle + angle",
        "self.warp_angle - angle",
        "dic/test_dic_warp.py",
    ),
    # what cameras see, units, elastic constants, the mesh's error
    Mutant("model/camera.py", "out, _turn(scene).swapaxes(1, 2))", "out, _turn(scene))", SIGNS),
    Mutant(
        "model/camera.py",
        "standing = np.column_stack([places.position, reference[:, 2]])",
        "standing = np.column_stack([places.position, 0 * reference[:, 2]])",
        f"{SIGNS} {TRIAL}",
    ),
    Mutant(
        "model/richardson.py",
        "* ratio / (ratio - 1.0)",
        "/ (ratio - 1.0)",
        "fitting/test_quality.py",
    ),
    Mutant(
        "fem/elasticity.py",
        "nu12 * e2 * shrink, g12",
        "nu12 * e1 * shrink, g12",
        "model/test_model_parameters.py",
    ),
    Mutant(
        "fem/elasticity.py",
        "(1.0 - nu12**2 * e2 / e1)",
        "(1.0 - nu12**2 * e1 / e2)",
        "model/test_model_parameters.py",
    ),
    Mutant("dic/units.py", "/ 25.4**2", "/ 25.4", "dic/test_dic_suspicions.py"),
    Mutant("dic/units.py", '"mbar": 1e-4', '"mbar": 1e-5', "dic/formats/test_formats_pressures.py"),
    Mutant(
        "dic/suspicions/sizes.py",
        "1 - min(poisson_ratio",
        "1 + min(poisson_ratio",
        "dic/test_dic_suspicions.py",
    ),
    # fits
    Mutant(
        "dic/suspicions/sizes.py", "radius / 2 / strain", "radius / strain", "fitting/test_guess.py"
    ),
    Mutant("fitting/l1.py", "return -(self.scale * pull)", "return (self.scale * pull)", OBJECTIVE),
    Mutant("fitting/l1.py", "0.5 * left**2 if", "left**2 if", OBJECTIVE),
    Mutant(
        "fitting/objective.py",
        "0.5 * (largest[0] + largest[1])",
        "(largest[0] + largest[1])",
        OBJECTIVE,
    ),
    Mutant(
        "fitting/scores.py",
        "np.sqrt(2.0 / np.pi)",
        "np.sqrt(np.pi / 2.0)",
        "fitting/test_uncertainty.py",
    ),
    Mutant("fitting/scores.py", "max(1.4826 *", "max(1.0 *", "fitting/test_uncertainty.py"),
    Mutant("fitting/scores.py", "2.0 - 2.0 * apart", "1.0 - apart", "fitting/test_scores.py"),
    Mutant("fitting/uncertainty.py", "(vectors[:, ~seen] ** 2)", "(vectors[:, seen] ** 2)", NEWS),
    Mutant(
        "fitting/problem.py",
        "- prior.mean) / prior.deviation**2 *",
        "- prior.mean) / prior.deviation *",
        "fitting/test_options.py",
    ),
    Mutant(
        "fitting/quality.py",
        "1.0 - 1.0 / max(misfit",
        "1.0 / max(misfit",
        "fitting/test_quality.py",
    ),
    Mutant(
        "fitting/quality.py",
        "return True, max(abs(value - null), width)",
        "return True, min(abs(value - null), width)",
        "fitting/test_quality.py",
    ),
    Mutant("fitting/optima.py", "0.5 * (z + end)", "end", NEWS),
    # noise
    Mutant(
        "dic/noise.py",
        "left / np.sqrt(1.0 + weights @ weights)",
        "left",
        f"{NOISE} fitting/test_quality.py",
    ),
    Mutant(
        "dic/noise.py",
        "left = np.sqrt(np.maximum(1.0 - projector[:, 0], 0.05))",
        "left = np.maximum(1.0 - projector[:, 0], 0.05)",
        NOISE,
    ),
    Mutant("dic/noise.py", "1.0 + density * area", "1.0 + 2.0 * density * area", NOISE),
    Mutant("dic/noise.py", "(1, 2.0 * np.pi), (2, np.pi)", "(1, np.pi), (2, np.pi)", NOISE),
    Mutant(
        "dic/noise.py",
        "times * (noise.inflation - alone)",
        "(noise.inflation - alone)",
        NOISE,
    ),
    Mutant(
        "dic/noise.py",
        "np.nanmean(field, axis=1, keepdims=True)",
        "np.nanmean(field, axis=0, keepdims=True)",
        NOISE,
    ),
    Mutant("dic/noise.py", "share * frames + (1.0 - share)", "share + (1.0 - share)", NOISE),
    # evidence
    Mutant(
        "gap/evidence/laplace.py",
        "log_det + 2.0 * np.log(width)",
        "log_det - 2.0 * np.log(width)",
        EVIDENCE,
    ),
    Mutant("gap/evidence/laplace.py", "value - slope @ step", "value + slope @ step", EVIDENCE),
    Mutant(
        "gap/evidence/laplace.py",
        ".sum() - np.log(scale).sum()",
        ".sum() + np.log(scale).sum()",
        EVIDENCE,
    ),
    Mutant(
        "gap/evidence/laplace.py",
        "here.square - 2.0 * change",
        "here.square + 2.0 * change",
        EVIDENCE,
    ),
    Mutant(
        "gap/evidence/laplace.py",
        "gradient - away / width",
        "gradient - away",
        EVIDENCE,
    ),
    Mutant("gap/evidence/laplace.py", "- 2.0 * inside", "+ 2.0 * inside", EVIDENCE),
    Mutant("gap/evidence/search.py", "+ REACH - volume", "- REACH - volume", EVIDENCE),
    Mutant("gap/evidence/laplace.py", "held & (pull > 0.0)", "held & (pull < 0.0)", EVIDENCE),
    Mutant("gap/evidence/orthant.py", "0.5 * push**2 / rest", "push**2 / rest", EVIDENCE),
    Mutant("gap/evidence/orthant.py", "(1.0 - 6.0 / z**2)", "(1.0 + 6.0 / z**2)", EVIDENCE),
    Mutant("gap/evidence/probability.py", "np.exp(-0.5 * (np", "np.exp(-1.0 * (np", EVIDENCE),
    Mutant("gap/evidence/creases.py", "1.0 + q + q**2 / 3.0", "1.0 + q + q**2", CREASES),
    Mutant("gap/evidence/creases.py", "float(np.log1p(var", "float(0.5 * np.log1p(var", CREASES),
    Mutant("gap/evidence/creases.py", "(load**degree)", "(load**0)", CREASES),
    # laws and kernels
    Mutant("fem/membrane.py", "(0.5 * _SPENT * left", "(_SPENT * left", "fem/test_uniaxial.py"),
    Mutant("fem/relaxation.py", "held * n2 * n2", "held * n1 * n1", CONSISTENCY),
    Mutant("fem/relaxation.py", "range(150)", "range(12)", CONSISTENCY),
    Mutant("fem/relaxation.py", " + 1e-15 * abs(energy)", "", CONSISTENCY),
    Mutant(
        "fem/tracing/levels.py",
        "self.elliptic and balance.leapt and not",
        "self.elliptic and balance.leapt and",
        "fem/test_path.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "not near and not tracer.is_elliptic(here",
        "not near and tracer.is_elliptic(here",
        "fem/test_path.py",
    ),
    Mutant(
        "fem/tracing/levels.py", ", potentials, np.inf", ", potentials, -np.inf", "fem/test_path.py"
    ),
    Mutant("fem/tracing/between.py", "np.argmax(errors)", "np.argmin(errors)", "fem/test_path.py"),
    Mutant(
        "fem/tracing/levels.py", "rest - share * bend", "rest + share * bend", "fem/test_path.py"
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "if tracer.is_sound(near)",
        "if not tracer.is_sound(near)",
        "fem/test_path.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "> BRACKET * size",
        "> 500.0 * BRACKET * size",
        "fem/test_path.py",
    ),
    Mutant(
        "fem/tracing/sound.py",
        "if ended and not tracer",
        "if ended and tracer",
        "fem/test_robustness.py",
    ),
    Mutant("gap/follow_up/holdout.py", "argsort(-recorded", "argsort(recorded", HELD_OUT),
    Mutant(
        "gap/evidence/coordinates.py", "{**self.known, **own}", "own", "gap/test_gap_weighing.py"
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "if reached >= end:",
        "if reached < end:",
        "fem/test_robustness.py",
    ),
    Mutant(
        "effects/fields/slip_field.py",
        "1: range(13)",
        "1: range(3)",
        "effects/test_effects_fields.py",
    ),
    Mutant("fem/equilibrium.py", "RUN_AWAY = 10.0", "RUN_AWAY = 1e30", "fem/test_path.py"),
    Mutant(
        "fem/tracing/settle.py",
        "if isinstance(error",
        "if not isinstance(error",
        "fem/test_path.py",
    ),
    Mutant("fem/equilibrium.py", "2.0 * np.maximum(-m", "np.maximum(-m", "fem/test_path.py"),
    Mutant("fem/membrane.py", ".sum()) / 3.0", ".sum()) / 2.0", "fem/test_path.py"),
    Mutant("fem/laws/hencky.py", "- 3.0 * g_s) / (2.0 * s)", "- 2.0 * g_s) / (2.0 * s)", LAWS),
    Mutant(
        "fem/laws/hencky.py", "2 * m * h / det2, 2 * m * k", "-2 * m * h / det2, 2 * m * k", LAWS
    ),
    Mutant("fem/laws/svk.py", "1.0 + 2.0 * q[4], 1.0", "1.0 + q[4], 1.0", f"{LAWS} {CONSISTENCY}"),
    Mutant("fem/laws/yarn.py", "h33 * g2 * b - t3", "h33 * g2 * b + t3", LAWS),
    Mutant("fem/laws/potential.py", "q[1] + 2.0 * q[7] * p2", "q[1] + q[7] * p2", LAWS),
    Mutant(
        "fem/laws/potential.py", "t1, h1 = t1 + curved_1, h1", "t1, h1 = t1 - curved_1, h1", LAWS
    ),
    Mutant(
        "fem/cells.py",
        "f1 * stress[2, c] + f2 * stress[1, c]",
        "f1 * stress[2, c] + f2 * stress[0, c]",
        CONSISTENCY,
    ),
    Mutant(
        "fem/cells.py", "blocks[block, 2, 1, c] += x", "blocks[block, 2, 1, c] -= x", CONSISTENCY
    ),
    Mutant(
        "fem/cells.py",
        "at[9, c] * e22 + at[6, c] * e12",
        "at[9, c] * e22 + at[5, c] * e12",
        CONSISTENCY,
    ),
    Mutant(
        "fem/kernels.py",
        "work(lift, corners, count) / 3.0",
        "work(lift, corners, count) / 2.0",
        CONSISTENCY,
    ),
    Mutant(
        "fem/membrane.py",
        "named * np.expm1(curve)",
        "moduli[:, None] * np.expm1(curve)",
        LAWS,
    ),
    Mutant("model/opening.py", "curvature = 2.0 * twice", "curvature = 1.0 * twice", WINDOW),
    Mutant(
        "model/window.py",
        "on_disc = self.radius * opening.unit(np.concatenate(places)[order])",
        "on_disc = np.concatenate(places)[order]",
        WINDOW,
    ),
    Mutant(
        "trial/window.py",
        "weights = reach[..., None] * shares * distance",
        "weights = reach[..., None] * shares",
        "trial/test_trial_made.py",
    ),
    Mutant(
        "gap/evidence/misfit.py",
        "more * self.spread[min(octave, last)]",
        "self.spread[min(octave, last)]",
        "gap/test_gap_misfit.py",
    ),
    Mutant(
        "gap/evidence/temper.py",
        "residual - share * mesh",
        "residual + share * mesh",
        "gap/test_gap_weighing.py",
    ),
    Mutant(
        "gap/evidence/problem.py", "if part < parts[form]]", "if part <= parts[form]]", EVIDENCE
    ),
    Mutant(
        "effects/fields/stiffness_field.py",
        "np.moveaxis(_bumps(points), -1, 0), strict",
        "-np.moveaxis(_bumps(points), -1, 0), strict",
        "effects/test_effects_fields.py",
    ),
    Mutant(
        "fem/quarter.py",
        "return bool(kept.all()) and",
        "return True or",
        "fem/test_quarter.py",
    ),
    Mutant("gap/evidence/hidden.py", "x[old] -= alike", "x[old] += alike", EVIDENCE),
    Mutant(
        "gap/evidence/closely.py", "_awake(layout, around, model, less.model)", "model", EVIDENCE
    ),
    Mutant("gap/evidence/improve.py", " or _uncovered(search, fit, around)", "", EVIDENCE),
    Mutant("gap/evidence/improve.py", "replace(search, fits={}).fit", "search.fit", EVIDENCE),
    Mutant("gap/evidence/closely.py", "(name in turning or not fore", "(not fore", EVIDENCE),
    Mutant("gap/evidence/closely.py", "turning or not foreseen", "turning", EVIDENCE),
    Mutant("gap/evidence/descend.py", "share = promised / last", "share = 1.0", EVIDENCE),
    Mutant(
        "gap/evidence/descend.py",
        "hopeless, seen = int(until.doubted), 1",
        "hopeless, seen = 0, 1",
        EVIDENCE,
    ),
    Mutant("gap/evidence/sides.py", "max(slope, 0.0) ** 2", "min(slope, 0.0) ** 2", EVIDENCE),
    Mutant("gap/evidence/descend.py", "if taken > least", "if taken > np.inf", EVIDENCE),
    Mutant(
        "gap/evidence/descend.py",
        "< (1.0 + _HELD) * SHARE",
        "> (1.0 + _HELD) * SHARE",
        EVIDENCE,
    ),
    Mutant("gap/evidence/brink.py", "(far[worst] - 1.0) / eased", "far[worst] / eased", EVIDENCE),
    Mutant(
        "model/softening.py",
        "direct = of_forces @ own / (2.0 * step)",
        "direct = of_forces @ own / step",
        WEIGHING,
    ),
    Mutant("model/softening.py", "up - 2.0 * here + down", "up - here", WEIGHING),
    Mutant(
        "model/frame.py",
        "if loose or membrane",
        "if True or membrane",
        WEIGHING,
    ),
    Mutant("gap/evidence/weighing.py", "near, strictly=True", "near", "gap/test_gap_weighing.py"),
    Mutant("gap/bands.py", "np.inf) * growth", "np.inf)", "gap/test_gap_noise.py"),
    Mutant("gap/evidence/shares.py", "others if len(others)", "[] if len(others)", EVIDENCE),
    Mutant("fem/membrane.py", "end, named[:, -1])", "named[:, -1], named[:, -1])", LAWS),
    Mutant("fem/equilibrium.py", "search.rate = np.inf", "search.rate = 0.0", "fem/test_path.py"),
    Mutant(
        "gap/evidence/amplitude.py",
        "scaled = layout.scaled(",
        "scaled = (lambda _: layout)(",
        EVIDENCE,
    ),
    Mutant("gap/evidence/problem.py", "width=factor * self.width", "width=self.width", EVIDENCE),
    Mutant("gap/attempt.py", "best.score - self.score)", "best.score + self.score)", CREASES),
    Mutant(
        "gap/level.py", "own[fit.columns.index(m)] = 1.0", "own[fit.columns.index(m)] = 2.0", LEVEL
    ),
    Mutant("gap/level.py", "@ own)), self.error)", "@ own)), 0.0)", LEVEL),
    Mutant(
        "effects/fields/stiffness_field.py",
        "reshape(-1, 2)) - _means()",
        "reshape(-1, 2)) + _means()",
        "effects/test_effects_fields.py",
    ),
    Mutant(
        "effects/fields/stiffness_field.py",
        "/ (2.0 * np.sqrt(number))",
        "/ np.sqrt(number)",
        "effects/test_effects_fields.py",
    ),
    Mutant("effects/fixture_motion.py", 'own["shape"])', "0.0)", SIGNS),
    Mutant("gap/evidence/improve.py", "len(owners) == 1", "len(owners) >= 1", EVIDENCE),
    Mutant(
        "gap/evidence/improve.py", "best.setdefault(owners.pop()", "best.setdefault(0", EVIDENCE
    ),
    Mutant("gap/evidence/weighing.py", "own /= np.sqrt(d.inflation)", "own /= 1.0", WEIGHING),
    Mutant("gap/normal.py", "parts[0] / d.inflation", "parts[0]", WEIGHING),
    Mutant("gap/data.py", "(1.0 - self.persistent) * apart,", "apart,", WEIGHING),
    Mutant(
        "gap/data.py",
        "self.mixture * (noise.inflation - persists)",
        "self.mixture * noise.inflation",
        "gap/test_gap_noise.py",
    ),
    Mutant("gap/bands.py", "field - basis @ found", "field", "gap/test_gap_noise.py"),
    Mutant("dic/noise.py", "ordered[half:] * ordered[:-half]", "ordered * ordered", NOISE),
    Mutant(
        "effects/places.py", "self._decades(np.ptp(self.schedule))", "self.decades.max()", SIGNS
    ),
    Mutant(
        "gap/follow_up/holdout.py",
        "(level if key in MODULI else 1.0)",
        "1.0",
        "gap/test_gap_diagnose.py::test_what_one_test_says_of_its_rig_is_known_of_another",
    ),
    Mutant("gap/evidence/outcome.py", ".hessian / weighing.excess", ".hessian", WEIGHING),
    Mutant("gap/prepare.py", "shapes.wrinkled > 0.0", "shapes.wrinkled > 0.5", WEIGHING),
    Mutant("gap/prepare.py", "measured & ~strays", "data.used & ~strays", "gap/test_gap_noise.py"),
    Mutant("gap/evidence/misfit.py", "/ louder", "/ 1.0", "gap/test_gap_misfit.py"),
    Mutant(
        "gap/evidence/misfit.py",
        "return max(float(np.linalg.eigvalsh(spread)[-1]) for spread in self.spread)",
        "return float(np.linalg.eigvalsh(self.spread[0])[-1])",
        "gap/test_gap_misfit.py",
    ),
    Mutant(
        "gap/residual/structure.py",
        "data.share[:, None] * part)",
        "part)",
        "gap/test_gap_trace.py",
    ),
    Mutant(
        "gap/follow_up/advise.py",
        "flat @ flat.T / d.inflation",
        "flat @ flat.T",
        "gap/test_gap_family.py",
    ),
    Mutant("effects/places.py", "if shape != 0.0", "if shape > 0.0", SIGNS),
    Mutant(
        "fem/tracing/by_volume.py",
        "before, after, 2.0 * tracer.tolerance)",
        "before, after, 1e3 * tracer.tolerance)",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "0.0 < 2.0 * speeds[0] < speeds[1]",
        "0.0 < 200.0 * speeds[0] < speeds[1]",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "< 2.0 * LEAST_GROWTH * abs",
        "< 0.0 * LEAST_GROWTH * abs",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/ends.py",
        "max()) > tracer.tolerance",
        "max()) < 0.0",
        "fem/test_robustness.py",
    ),
    Mutant(
        "model/balancing.py",
        "and np.array_equal(self.guess, guess)",
        "or np.array_equal(self.guess, guess)",
        "model/test_model_neighbours.py",
    ),
    Mutant(
        "gap/evidence/ways.py",
        "len(best.model) - 1, keep=name)",
        "len(best.model) - 1)",
        "gap/test_gap_evidence.py",
    ),
    Mutant(
        "fitting/problem.py",
        "self._weight_of_priors(value) * self.pull",
        "0.0 * self.pull",
        "fitting/test_priors.py",
    ),
    Mutant("fitting/problem.py", "exponent = 0.5 *", "exponent = 1.0 *", "fitting/test_options.py"),
    Mutant("fitting/minimise.py", "rounding * self.typical", "rounding * self.base", FITS),
    Mutant(
        "fitting/crossval.py",
        "or effect_named(key.effect).shared",
        "or effect_named(key.effect)",
        FITS,
    ),
    Mutant("fitting/bootstrap.py", "base.on_all_data()", "base", "fitting/test_bootstrap.py"),
    Mutant(
        "fem/tracing/by_volume.py",
        "if s > beyond or steps == PATIENTLY:",
        "if s > beyond:",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fitting/fit.py",
        "if np.array_equal(z, before):",
        "if not np.array_equal(z, before):",
        "fitting/test_inverse_fit.py",
    ),
    Mutant(
        "gap/evidence/descend.py",
        "2.0 * slope @ step - step @ matrix @ step), 0.0)",
        "slope @ step - step @ matrix @ step), 0.0)",
        "gap/test_gap_evidence.py",
    ),
    Mutant("model/window.py", "_STRIPS, _ALONG = 8, 4", "_STRIPS, _ALONG = 5, 4", WINDOW),
    Mutant(
        "effects/places.py",
        "out[..., 0] -= self.along",
        "out[..., 0] += self.along",
        "effects/test_effects_fields.py",
    ),
    Mutant(
        "dic/cut_bins.py",
        "known & beside.all(axis=2)",
        "known & beside.any(axis=2)",
        "dic/test_dic_cut_bins.py",
    ),
    Mutant(
        "dic/cut_bins.py",
        "np.array([3.0, -3.0, 1.0])",
        "np.array([3.0, -2.0, 1.0])",
        "dic/test_dic_cut_bins.py",
    ),
    Mutant(
        "gap/found_fields.py",
        "variance += (0.5 * (",
        "variance += (1.0 * (",
        "gap/test_gap_found_fields.py",
    ),
    Mutant(
        "gap/evidence/outcome.py",
        "data.sigma**2 * data.of_frames_mean(",
        "data.sigma * data.of_frames_mean(",
        "gap/test_gap_found_fields.py",
    ),
    Mutant(
        "gap/residual/measure.py",
        "without = _by_derivatives if fit.converged else _by_shapes",
        "without = _by_derivatives",
        "gap/test_gap_measure.py",
    ),
    Mutant(
        "gap/evidence/sides.py",
        "at, range(8))]",
        "at, range(0, 8, 2))]",
        EVIDENCE,
    ),
    Mutant(
        "report/page/field_charts.py",
        "< _TOLD * stderr] = 0",
        "> _TOLD * stderr] = 0",
        "report/test_report_unnamed.py",
    ),
    Mutant(
        "gap/evidence/improve.py",
        "promise(search, found) < fit.score",
        "found.here.square <= fit.here.square",
        EVIDENCE,
    ),
    Mutant("gap/evidence/improve.py", " if new <= m]", "]", EVIDENCE),
    Mutant(
        "trial/right.py",
        ' and of[1] == cause.get("specimen")',
        "",
        "trial/test_trial_scoring.py",
    ),
    Mutant("fitting/sides.py", "_TURNS = (0.25, 0.5, 0.75)", "_TURNS = (0.05, 0.95)", FEW),
    Mutant("fitting/objective.py", "tuple(new or old for", "tuple(old for", FEW),
    Mutant("fitting/scores.py", "[self._size :]", "", FEW),
    Mutant("fitting/uncertainty.py", "max(min(ends), _least(problem.keys[j]))", "min(ends)", FEW),
    Mutant("fitting/bootstrap.py", 'np.argsort(pressure, kind="stable")[ranks]', "ranks", FEW),
    Mutant("model/description.py", "value != parameter_named(", "value == parameter_named(", FEW),
    Mutant("model/balancing.py", "loads <= _CANCELLED *", "loads <= 0.0 *", FEW),
    Mutant("dic/formats/csv_folder.py", "values[:, i] *= factor", "values[:, i] /= factor", TOLD),
    Mutant("dic/align.py", "rim.centre) <= rim.centre_error", "rim.centre) < 0.0", ALIGN),
    Mutant(
        "gap/residual/structure.py",
        "np.diag(data.drawn_anew / values",
        "np.diag(data.inflation / values",
        "gap/test_gap_trace.py",
    ),
    Mutant(
        "gap/evidence/temper.py",
        "(seen**2).sum()) / d.inflation",
        "(seen**2).sum()) / d.drawn_anew",
        "gap/test_gap_weighing.py",
    ),
    Mutant(
        "dic/noise.py",
        "np.sqrt(seen / (seen - 1.0))",
        "np.sqrt(seen / seen)",
        "dic/test_dic_at_rest.py",
    ),
    Mutant(
        "dic/noise.py",
        "(seen - 1).sum(axis=0).min() < _LEAST_VALUES",
        "(seen - 1).sum(axis=0).min() < 0",
        "dic/test_dic_at_rest.py",
    ),
    Mutant(
        "dic/given.py",
        "return each_once(distinctly",
        "return (distinctly",
        "dic/test_dic_copies.py",
    ),
    Mutant("fitting/guess.py", "_AT_CLAMP = 0.95", "_AT_CLAMP = 0.5", "fitting/test_guess.py"),
    Mutant(
        "dic/suspicions/apex.py", "np.where(near, 1 - part, 1.0)", "1.0", "fitting/test_guess.py"
    ),
    Mutant("cli/_mounting.py", "(a - b) / (a + b)", "(b - a) / (a + b)", SIMULATE),
    Mutant("cli/_mounting.py", "for test in tests or [{}]]", "for test in [{}]]", SIMULATE),
    Mutant(
        "fitting/uncertainty.py",
        "_steepness(part.change + part.jacobian @ step, part.curvature)",
        "part.curvature",
        "fitting/test_uncertainty.py",
    ),
    Mutant(
        "fem/tracing/levels.py",
        "for k in range(1, _LOOKS))",
        "for k in range(1, 1))",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/equilibrium.py",
        "if self.convex:",
        "if False:",
        "fem/test_robustness.py",
    ),
    Mutant("fem/relaxation.py", "-snn * abs(snn) / cnn", "snn * abs(snn) / cnn", CONSISTENCY),
    Mutant(
        "fem/relaxation.py",
        "math.sqrt(max(short, 0.0))",
        "math.sqrt(max(-short, 0.0))",
        CONSISTENCY,
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "(near and _is_short(here, point.volume))",
        "(near and False)",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "apart < LEAST_GROWTH * size",
        "apart < 100.0 * LEAST_GROWTH * size",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "if leaps and kinks and not folds",
        "if leaps and not folds",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/ellipticity.py",
        "if lowest < enough:",
        "if lowest > enough:",
        "fem/test_ellipticity.py",
    ),
    Mutant("fem/banded.py", "= column[j - k, k]", "= column[j, k]", CONSISTENCY),
    Mutant(
        "fem/tracing/levels.py",
        "return folds and not self.is_elliptic(below",
        "return folds and self.is_elliptic(below",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/sound.py",
        "return top, _shape_between(",
        "return s, _shape_between(",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/equilibrium.py",
        "_norm(state) <= 4.0 * stress",
        "_norm(state) <= 0.0 * stress",
        "fem/test_robustness.py",
    ),
    Mutant(
        "fem/tracing/by_volume.py",
        "and rises and _is_like(here, middle) and _is_like(middle, point)",
        "and rises",
        "fem/test_robustness.py",
    ),
    Mutant("fem/path.py", "out[inside] = self.errors", "out[inside] = 0.0 * self.errors", COARSE),
    Mutant("model/coarse.py", "derivative[name][frame] = rate[0]", "pass", COARSE),
    Mutant(
        "model/balancing.py",
        "derivative[:, frame] = self.quarter.whole(rates)",
        "derivative[:, frame] = np.abs(self.quarter.whole(rates))",
        COARSE,
    ),
    Mutant(
        "model/frame.py",
        "for start in starts:",
        "for start in starts[:1]:",
        "model/test_model_neighbours.py",
    ),
    Mutant(
        "fem/tracing/levels.py",
        "exact=self.sensitivities or convex",
        "exact=self.sensitivities",
        "fem/test_robustness.py",
    ),
    Mutant(
        "model/richardson.py",
        "left < whole",
        "left > whole",
        "model/test_model_mesh_error.py",
    ),
    Mutant(
        "fem/relaxation.py",
        "-slope <= rounding and abs(end)",
        "-slope <= 0.0 * rounding and abs(end)",
        "fem/test_robustness.py",
    ),
    Mutant("fem/trace.py", "not banded or tracer", "banded or tracer", "fem/test_robustness.py"),
    Mutant("fem/tracing/levels.py", "_LOOKS * off <=", "_LOOKS * off >=", "fem/test_robustness.py"),
    Mutant(
        "fem/tracing/between.py",
        " and tracer.work <= affordable",
        "",
        "fem/test_robustness.py",
    ),
    Mutant("fem/tracing/settle.py", "_CLOSELY = 1e-3", "_CLOSELY = 1.0", "fem/test_path.py"),
    Mutant("fem/tracing/settle.py", "_LEAP = 0.5", "_LEAP = 5.0", "fem/test_path.py"),
    Mutant("fem/trace.py", "_LIGHT = 1e-3", "_LIGHT = 1e3", "fem/test_path.py"),
    Mutant(
        "model/description.py",
        "mesh.cells) > 0.0).all()",
        "mesh.cells) > 0.0).any()",
        "effects/test_effects_values.py",
    ),
)


def check() -> None:
    """Leave where a mutant is none, since its file has changed."""
    for mutant in MUTANTS:
        text = (HERE / "src" / "bulgefit" / mutant.file).read_text()
        if text.count(mutant.old) != 1:
            sys.exit(f"{mutant.file}: {mutant.old!r} stands there {text.count(mutant.old)} times")


@contextmanager
def broken(path: Path, mutant: Mutant) -> Iterator[None]:
    """The file with what is wrong in it; afterwards as it was, for caches of what is compiled."""
    text, times = path.read_text(), path.stat()
    path.write_text(text.replace(mutant.old, mutant.new))
    try:
        yield
    finally:
        path.write_text(text)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def failing(copy: Path, tests: str) -> str:
    """The first test that fails; empty where all pass."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    command += [f"tests/{name}" for name in tests.split()]
    environment = {**os.environ, "PYTHONPATH": str(copy / "src")}
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True,
            timeout=TIME_LIMIT, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "no end"
    if done.returncode == 0:
        return ""
    found = re.search(r"^(?:FAILED|ERROR) (?:tests/)?(\S+)", done.stdout, re.MULTILINE)
    if found is None or done.returncode != 1:
        sys.exit(f"{tests}: pytest ended with {done.returncode}\n{done.stdout}{done.stderr}")
    return found.group(1)


def table(results: dict[str, str]) -> str:
    """Of all mutants with a result, for docs/verification.md."""
    lines = ["| in | instead of | stands | caught by |", "|---|---|---|---|"]
    for mutant in MUTANTS:
        if (caught := results.get(_key(mutant))) is not None:
            by = f"`{caught.rpartition('/')[2]}`" if caught else "**nothing**"
            lines.append(f"| `{mutant.file}` | `{mutant.old}` | `{mutant.new}` | {by} |")
    return "\n".join(lines)


def _key(mutant: Mutant) -> str:
    return f"{mutant.file}: {mutant.old} -> {mutant.new}"


def main() -> int:
    """Break, test and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=":", metavar="FROM:TO", help="a slice of the mutants")
    parser.add_argument("--results", type=Path, default=Path("mutations.json"))
    parser.add_argument("--table", action="store_true", help="print what was found so far")
    args = parser.parse_args()
    results = json.loads(args.results.read_text()) if args.results.exists() else {}
    if args.table:
        print(table(results))
        return 0
    check()
    first, last = (int(end) if end else None for end in args.only.split(":"))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            one = HERE / name
            (shutil.copytree if one.is_dir() else shutil.copy2)(one, copy / name)
        chosen = MUTANTS[first:last]
        todo = sorted(
            (mutant for mutant in chosen if not results.get(_key(mutant))),
            key=lambda mutant: mutant.tests,
        )
        for tests, group in groupby(todo, key=lambda mutant: mutant.tests):
            if failed := failing(copy, tests):
                sys.exit(f"{failed} fails where nothing is wrong")
            for mutant in group:
                began = time.perf_counter()
                with broken(copy / "src" / "bulgefit" / mutant.file, mutant):
                    results[_key(mutant)] = caught = failing(copy, tests)
                args.results.write_text(json.dumps(results, indent=1))
                seconds = time.perf_counter() - began
                print(f"{caught or 'SURVIVES'}: {_key(mutant)} ({seconds:.0f} s)", flush=True)
    here = [results[_key(mutant)] for mutant in chosen]
    print(f"{sum(map(bool, here))} of {len(here)} mutants are caught")
    return 0 if all(here) else 1


if __name__ == "__main__":
    sys.exit(main())
