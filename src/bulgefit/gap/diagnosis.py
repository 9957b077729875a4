"""Diagnose the gap between the virtual and the measured test."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import dataframe
from bulgefit.dic.given import GivenTests, given_tests
from bulgefit.dic.suspicions import alarms
from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import acting, fields
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.problem import Prior
from bulgefit.fitting.result import describe_tests, versions
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI, SHEAR, chosen_effects
from bulgefit.gap.evidence.coordinates import effect_of, is_field, specimen_of
from bulgefit.gap.explain import START, explain
from bulgefit.gap.explanation import Explanation, FoundField, Step
from bulgefit.gap.follow_up.advise import Advice, advise
from bulgefit.gap.follow_up.holdout import HeldOutTest, judge_held_out
from bulgefit.gap.follow_up.separate import STIFFNESS, Pair, indistinguishable
from bulgefit.gap.implied_reference import ImpliedReference, implied_references
from bulgefit.gap.keys import at_edge
from bulgefit.gap.law_table import LawTable, law_table
from bulgefit.gap.prepare import (
    Prepared,
    drop_outliers,
    judge_mesh,
    prepare,
    renew_noise,
    settle,
)
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual.locate import Growth, Mode, azimuthal_modes
from bulgefit.gap.residual.measure import Gap, fitted_gap, held_out_gap, noise_gap, weight_of
from bulgefit.gap.scatter import Scatter, modulus_errors, of_the_cloth, scatter_of
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.parallel.workers import open_executor
from bulgefit.shown import Drawn

__all__ = ["Cause", "Diagnosis", "Verdict", "diagnose"]

#: Version of the JSON.
FORMAT = 2


class Verdict(StrEnum):
    """What a diagnosis comes to."""

    #: Nothing need be added.
    NONE = "none"
    #: The causes are sure.
    NAMED = "named"
    #: Sets of causes.
    AMBIGUOUS = "ambiguous"
    #: Causes are sure, and something else is left.
    PARTIAL = "partial"
    #: Nothing is sure.
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Cause:
    """An effect that was named, wholly or in part.

    Attributes
    ----------
    effect : str
    specimen : int or None
        Whose cause it is, where several are judged together; None for what they share.
    probability : float
        From the evidence of all models that were weighed.
    alternatives : tuple of str
        Effects that this data cannot tell from it.
    parameters : dict of name to {"value", "stderr", "unit", "pull"}
        The pull is the distance from the null in prior widths.
    at_bound : bool
        A parameter sits at the edge of its plausible range.
    share_of_gap : float or None
        What would be left without it, of the baseline's held-out misfit beyond the noise; None
        where the fit without it finds no equilibrium.
    heldout_reduction : float or None
        Part of the held-out misfit without it that it takes away; None as above.
    bias_if_omitted : dict
        Relative error of each modulus when the effect is left out and all else refitted; empty
        where that finds no equilibrium.
    bias_held : bool
        That of G12 is larger still: without the effect the fit asks for a softer one, by which
        frames would lose stability.
    partial : bool
        True where the effects found do not explain the gap.
    """

    effect: str
    specimen: int | None
    probability: float
    alternatives: tuple[str, ...]
    parameters: dict[str, dict[str, Any]]
    at_bound: bool
    share_of_gap: float | None
    heldout_reduction: float | None
    bias_if_omitted: dict[str, float]
    bias_held: bool
    partial: bool


@dataclass(eq=False)
class Diagnosis(Drawn):
    """What a diagnosis found; `to_dict` is its JSON.

    Attributes
    ----------
    verdict : Verdict
    causes : list of Cause
    prepared : list of Prepared
    explanation : Explanation
    gaps : dict
        "baseline", "explained", "heldout_baseline", "heldout_explained", "noise_floor".
    modes : list of Mode
        Of the baseline's residual.
    pairs : list of Pair
    advice : list of Advice
    law : LawTable
        Of the cloth.
    scatter : dict of modulus to Scatter
        Of E1 and E2 over specimens; empty for one.
    implied : list of ImpliedReference
        Heights before inflation, test by test.
    skipped : dict of effect to why
    holdout : HeldOutTest or None
        How a specimen that was kept out is met.
    """

    verdict: Verdict
    causes: list[Cause]
    prepared: list[Prepared]
    explanation: Explanation
    gaps: dict[str, Gap]
    modes: list[Mode]
    pairs: list[Pair]
    advice: list[Advice]
    law: LawTable
    scatter: dict[str, Scatter]
    implied: list[ImpliedReference]
    skipped: dict[str, str]
    tests: list[BulgeTest]
    seed: int
    seconds: float
    holdout: HeldOutTest | None = None
    warnings: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        names = ", ".join(test.name for test in self.tests)
        causes = "; ".join(f"{c.effect} {c.probability:.3g}" for c in self.causes) or "no causes"
        return f"Diagnosis of {names}: {self.verdict} ({causes})"

    def to_dataframe(self) -> Any:
        """A row a parameter: the moduli with the causes, and each cause's own.

        Names are as a fit has them, `effect.parameter@i` of test i; `probability` is that of the
        cause. Needs `bulgefit[pandas]`.
        """
        rows = {name: {**found, "probability": None} for name, found in
                _moduli(self.explanation.final).items()}  # fmt: skip
        for cause in self.causes:
            for name, found in cause.parameters.items():
                rows[f"{cause.effect}.{name}"] = {**found, "probability": cause.probability}
        columns = ("value", "stderr", "unit", "probability")
        return dataframe({c: [row[c] for row in rows.values()] for c in columns}, index=list(rows))

    def to_dict(self) -> dict[str, Any]:
        """The diagnosis as JSON types."""
        start, rest = self.explanation.start, self.explanation.remainder
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "causes": [_cause_dict(c) for c in self.causes],
            "fields": [_field_dict(self, f) for f in self.explanation.fields],
            "gap": {
                "baseline": self.gaps["baseline"],
                "explained": self.gaps["explained"],
                "heldout": {
                    "baseline": self.gaps["heldout_baseline"],
                    "explained": self.gaps["heldout_explained"],
                },
                "noise_floor": self.gaps["noise_floor"],
                "discretisation_mm": self._mesh_error(),
                "discretisation_corrected_mm": float(
                    max(p.discretisation.max() for p in self.prepared)
                ),
            },
            "where": [_cell_dict(c) for c in start.cells if abs(c.significance) > 3.0][:40],
            "modes": [_mode_dict(m) for m in self.modes if m.growth is not Growth.NONE],
            "parameters": {
                "baseline": _moduli(self.explanation.baseline),
                "corrected": {
                    **_moduli(self.explanation.final),
                    **({"secant": self.law.secants()} if self.law.bent else {}),
                },
            },
            "law": self.law.to_dict(),
            "scatter": _scatter_dict(self.scatter),
            "specimens": _specimens(self),
            "implied_reference": [i.to_dict() for i in self.implied],
            "indistinguishable": [
                {"effects": list(p.effects), "cosine": p.cosine} for p in self.pairs
            ],
            "advice": [
                {
                    "measurement": a.measurement,
                    "separation": a.separation,
                    "between": list(a.between),
                }
                for a in self.advice
            ],
            "remainder": {
                "significant": rest.significant,
                "where": [_cell_dict(c) for c in rest.cells if abs(c.significance) > 3.0][:20]
                if rest.significant
                else [],
            },
            "tried": [_step_dict(s) for s in self.explanation.steps],
            "others": self.explanation.others,
            **({} if self.holdout is None else {"holdout": self.holdout.to_dict()}),
            "skipped": self.skipped,
            "warnings": self.warnings,
            "alarms": [
                f"{test.name}: {alarm.text}; {alarm.remedy}"
                for test in self.tests
                for alarm in alarms(test)
            ],
            "noise": [
                {
                    "test": p.data.specimen.test.name,
                    "sigma_mm": p.noise.sigma.tolist(),
                    "correlation_length_mm": p.noise.correlation_length,
                    "effective_points_per_point": 1.0 / p.noise.inflation,
                    "effective_frames_per_frame": 1.0 / p.data.mixture,
                    "source": p.noise.source,
                }
                for p in self.prepared
            ],
            "meta": {
                "versions": versions(),
                "seed": self.seed,
                "checksums": {t["name"]: t["sha256"] for t in describe_tests(self.tests)},
                "seconds": self.seconds,
            },
        }

    def _mesh_error(self) -> float | None:
        """Largest component (mm) of what is left of the mesh's error; None where not known."""
        found = [p.mesh_error for p in self.prepared if p.mesh_error is not None]
        return float(np.max(found)) if len(found) == len(self.prepared) else None


def diagnose(
    tests: GivenTests,
    *,
    holdout: BulgeTest | None = None,
    effects: Iterable[str] | None = None,
    law: str = "hencky",
    thorough: bool = False,
    same_rig: bool = False,
    priors: Mapping[str, Prior] | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    workers: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Where the model misses, which unmodelled effect causes it, and how far the gap shrinks.

    Parameters
    ----------
    tests : BulgeTest, path, or sequence of them
        Several are specimens of one cloth and judged together: they share its law, about which each
        has factors of its own along warp and fill; all other effects are each test's own.
    holdout : BulgeTest, optional
        A specimen that takes no part: what specimens share comes from the others, its own
        parameters are fitted on every second frame, and it is judged on the rest.
    effects : iterable of str, optional
        Candidates; default: the whole catalogue.
    law : {"hencky", "svk"}
    thorough : bool
        Search by every way, also where the first leaves nothing but noise.
    same_rig : bool
        Several tests share what belongs to clamp and cameras: the clamp's shape, lens and scales.
    priors : mapping of name to Prior, optional
        What is believed of E1, E2 and G12 (MPa); default: a decade either way.
    seed : int
        Kept for the record; the search draws nothing at random.
    executor : concurrent.futures.Executor, optional
        Refits candidates side by side: processes, or `Client.get_executor()` of Dask; the result
        does not depend on it. The measured data reach each process once.
    workers : int
        Threads that balance frames side by side, here and in each process of an executor; where
        no executor is given, also threads that refit candidates.
    say : callable
        Told what is tried.

    Raises
    ------
    InputError
        A test with too few points or frames to judge, or without one of the components; unknown
        effects; tests that state different Poisson ratios; priors of other parameters, or that are
        none.
    SolveError
        The baseline finds no equilibrium.
    """
    began = time.perf_counter()
    given = given_tests(tests)
    if not given:
        raise InputError("no bulge test was given")
    wanted = chosen_effects(effects)
    lacking = {
        e.id: f"the test has no {need}"
        for e in wanted
        for need in e.needs
        if any(getattr(t, need) is None for t in given)
    }
    candidates = [e for e in wanted if e.id not in lacking]
    skipped = lacking
    _same_ratio(given)
    believed = _believed(priors or {})
    own = open_executor(workers) if executor is None else nullcontext(executor)
    with one_blas_thread(), own as pool:
        prepared = [prepare(test, law, workers) for test in given]
        kept_out = None if holdout is None else prepare(holdout, law, workers)
        data = [p.data for p in prepared]
        say("baseline: the moduli alone")
        baseline = _baseline(prepared)
        found = explain(
            prepared,
            candidates,
            baseline,
            pool,
            say,
            thorough=thorough,
            same_rig=same_rig,
            priors=believed,
        )
        baseline = found.baseline
        say("held-out gap")
        for one, prediction in zip(prepared, found.final.predictions, strict=True):
            judge_mesh(one, prediction.shapes)
        weight = weight_of(data)
        gaps = {
            "baseline": fitted_gap(data, baseline, weight),
            "explained": fitted_gap(data, found.final, weight),
            "heldout_baseline": held_out_gap(data, baseline, weight),
            "heldout_explained": held_out_gap(data, found.final, weight),
            "noise_floor": noise_gap(data, weight),
        }
        pairs = indistinguishable(found.known)
        pairs[:0] = [Pair((e.id, STIFFNESS), 1.0) for e in candidates if e.never_separable]
        causes = _causes(found)
        advice = advise(data, found)
        met, unmet = None, list[str]()
        if kept_out is not None:
            say("held-out test")
            try:
                met = judge_held_out(kept_out, found, weight)
            except SolveError as error:
                unmet = [f"the held-out test could not be met with what was found: {error}"]
            unmet += _lacked(kept_out, found)
    return Diagnosis(
        verdict=_verdict(found),
        causes=causes,
        prepared=prepared,
        explanation=found,
        gaps=gaps,
        modes=azimuthal_modes(data, baseline),
        pairs=pairs,
        advice=advice,
        law=law_table(data, found.final),
        scatter=scatter_of(found.final),
        implied=implied_references(data, found.final),
        skipped=skipped,
        tests=given,
        seed=seed,
        seconds=time.perf_counter() - began,
        holdout=met,
        warnings=[
            *_left_out([*prepared, *([kept_out] if kept_out else [])]),
            *_left_of_the_mesh(prepared),
            *_held(found),
            *unmet,
        ],
    )


def _same_ratio(tests: Sequence[BulgeTest]) -> None:
    """Specimens judged together share the material, of which each test states Poisson's ratio."""
    ratios = sorted({t.poisson_ratio for t in tests})
    if len(ratios) > 1:
        raise InputError(
            f"the tests state different Poisson ratios ({', '.join(f'{r:g}' for r in ratios)}), "
            "but specimens judged together share the material: diagnose them one by one, or state "
            "one ratio in their files"
        )


def _believed(priors: Mapping[str, Prior]) -> dict[str, tuple[float, float]]:
    """Centre and standard deviation (MPa) of moduli; InputError for what is no prior of one."""
    known = [m.name for m in MODULI]
    for name, prior in priors.items():
        if name not in known:
            raise InputError(
                f"prior: {name} is none of {', '.join(known)}; in a diagnosis effects have priors "
                "of physical size about their null (docs/diagnosis.md)"
            )
        if not (0.0 < prior.mean < np.inf and 0.0 < prior.deviation < np.inf):
            raise InputError(f"prior of {name}: give a value and a deviation above 0 MPa")
    return {name: (prior.mean, prior.deviation) for name, prior in priors.items()}


def _lacked(kept_out: Prepared, found: Explanation) -> list[str]:
    """Shared effects that a held-out test was met without, since it lacks what they need."""
    effects = [CATALOGUE[effect_of(group)] for group in found.groups if not is_field(group)]
    return [
        f"the held-out test has no {need}: it was met without {effect.id}"
        for effect in effects
        for need in effect.needs
        if getattr(kept_out.data.specimen.test, need) is None
    ]


def _baseline(prepared: Sequence[Prepared]) -> Regression:
    """Moduli alone; then the mesh's error is taken off and outliers left out, and again."""
    data = [p.data for p in prepared]
    rough = regress([_few_frames(d) for d in data], MODULI, START)
    first = regress(data, MODULI, rough.values)
    for p, prediction in zip(prepared, first.predictions, strict=True):
        renew_noise(p, prediction.displacement)
        drop_outliers(p, prediction.displacement)
    return settle(prepared, first)


def _few_frames(data: Data) -> Data:
    """Every fourth frame: enough to bring the moduli near their place."""
    order = np.argsort(data.specimen.recorded, kind="stable")
    frames = np.sort(order[::-4])
    test = data.specimen.test.select(frames=frames)
    whole = data.specimen
    specimen = whole.of(test)
    return Data(specimen, data.sigma, data.used[frames], data.inflation)


def _verdict(found: Explanation) -> Verdict:
    causes = [e for group, e in found.evidence.items() if not is_field(group)]
    if not found.complete:
        return Verdict.PARTIAL if any(e.sure for e in causes) else Verdict.UNKNOWN
    if not causes:
        return Verdict.NONE
    return Verdict.NAMED if all(e.sure for e in causes) else Verdict.AMBIGUOUS


def _causes(found: Explanation) -> list[Cause]:
    """What has a name in the final model, what is worth most first."""
    excess = max(found.baseline.held_out() - found.final.floor, 1e-9)
    return [_cause(found, group, excess) for group in found.groups if not is_field(group)]


def _cause(found: Explanation, group: str, excess: float) -> Cause:
    evidence = found.evidence[group]
    effect = CATALOGUE[effect_of(group)]
    errors = found.final.standard_errors()
    parameters, at_bound = {}, False
    for key in found.groups[group]:
        value = found.final.values[key]
        at_bound |= at_edge(key, value)
        parameters[_own_name(key)] = {
            "value": float(value),
            "stderr": float(errors[key]),
            "unit": effect.parameter(key.parameter).unit,
            "pull": evidence.pulls[key],
        }
    share, reduction, bias = None, None, {}
    if (without := evidence.without) is not None:
        left = without.held_out()
        gained = left - found.final.held_out()
        share = float(np.clip(gained / excess, 0.0, 1.0))
        reduction = float(gained / left)
        alone, full = of_the_cloth(without.values), of_the_cloth(found.final.values)
        bias = {m.name: alone[m] / full[m] - 1.0 for m in MODULI}
    return Cause(
        effect=effect.id,
        specimen=specimen_of(group),
        probability=evidence.probability,
        alternatives=tuple(effect_of(rival) for rival in evidence.rivals),
        parameters=parameters,
        at_bound=at_bound,
        share_of_gap=share,
        heldout_reduction=reduction,
        bias_if_omitted=bias,
        bias_held=without is not None and without.held,
        partial=not found.complete,
    )


def _own_name(key: Key) -> str:
    """The parameter's name, and whose it is, as the JSON has them beside the effect's."""
    return key.parameter if key.specimen is None else f"{key.parameter}@{key.specimen}"


def _left_out(prepared: Sequence[Prepared]) -> list[str]:
    """Frames and points that were not judged."""
    out = []
    for p in prepared:
        name = p.data.specimen.test.name
        if p.rough_from is not None:
            out.append(
                f"{name}: frames from {p.rough_from:.3g} bar on were left out: the fabric deforms "
                "in bands there (soft shear), which no mesh-independent model follows"
            )
        doubted = int((p.data.share < 1.0).sum())
        if doubted:
            out.append(
                f"{name}: in {doubted} frame{'s' if doubted > 1 else ''} part of the fabric is "
                "slack and wrinkles; what no model follows there counts as noise"
            )
        if p.data.mixture > 1.0:
            frames = len(p.data.used)
            out.append(
                f"{name}: its {frames} frames are linear mixtures of "
                f"{round(frames / p.data.mixture)} and count as so many; interpolation between "
                "frames that are far apart is off, which may look like a cause at light pressure"
            )
        if p.strays:
            out.append(
                f"{name}: {p.strays} of {p.data.used.any(axis=2).sum() + p.strays} points of all "
                "frames depart far from those around them and were left out"
            )
    return out


def _left_of_the_mesh(prepared: Sequence[Prepared]) -> list[str]:
    """Where the mesh's error is not known, or not below a third of the noise."""
    out = []
    for p in prepared:
        name = p.data.specimen.test.name
        if p.mesh_error is None:
            out.append(f"{name}: the mesh's error could not be estimated; small gaps may be its")
        elif (p.mesh_error > p.noise.sigma / 3.0).any():
            sizes = ", ".join(f"{1000 * e:.1f}" for e in p.mesh_error)
            out.append(
                f"{name}: the mesh's error could not be brought below a third of the noise; about "
                f"{sizes} µm of dx, dy, dz are left of it, and small gaps may be its"
            )
    return out


def _held(found: Explanation) -> list[str]:
    """Which of the reported fits ask for a softer shear than the fabric can have."""
    fits = {"the moduli alone": found.baseline, "the causes": found.final}
    return [
        f"with {name}, G12 is an upper limit: the fit asks for a softer one, by which the fabric "
        "would lose its stability; its standard error says nothing"
        for name, fit in fits.items()
        if fit.held
    ]


def _moduli(fit: Regression) -> dict[str, dict[str, Any]]:
    """Of the cloth, where there are several specimens."""
    values, errors = of_the_cloth(fit.values), modulus_errors(fit)
    return {
        m.name: {
            "value": float(values[m]),
            "stderr": float(errors[m]),
            "unit": "MPa",
            "held": fit.held and m == SHEAR,
        }
        for m in MODULI
    }


def _scatter_dict(found: Mapping[str, Scatter]) -> dict[str, Any] | None:
    """Of E1 and E2; None for one specimen."""
    if not found:
        return None
    values = {modulus: s.value for modulus, s in found.items()}
    return {**values, "stderr": {modulus: s.stderr for modulus, s in found.items()}}


def _specimens(found: Diagnosis) -> list[dict[str, Any]]:
    """What each specimen has of its own; nothing for one."""
    if not found.scatter:
        return []
    return [
        {
            "test": p.data.specimen.test.name,
            "factors": {
                modulus: dict(zip(("value", "stderr"), s.factors[index], strict=True))
                for modulus, s in found.scatter.items()
            },
            "effects": [c.effect for c in found.causes if c.specimen == index],
        }
        for index, p in enumerate(found.prepared)
    ]


def _cause_dict(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "place": CATALOGUE[cause.effect].place,
        "specimen": cause.specimen,
        "probability": cause.probability,
        "alternatives": list(cause.alternatives),
        "parameters": cause.parameters,
        "at_bound": cause.at_bound,
        "share_of_gap": cause.share_of_gap,
        "heldout_reduction": cause.heldout_reduction,
        "bias_if_omitted": cause.bias_if_omitted,
        "bias_held": cause.bias_held,
        "partial": cause.partial,
        "meaning": CATALOGUE[cause.effect].meaning,
    }


def _cell_dict(cell: Any) -> dict[str, Any]:
    return {
        "test": cell.test,
        "component": cell.component,
        "region": cell.region,
        "pressure_band_bar": list(cell.band),
        "mean_mm": cell.mean,
        "share": cell.share,
        "significance": cell.significance,
    }


def _mode_dict(mode: Mode) -> dict[str, Any]:
    return {
        "test": mode.test,
        "component": mode.component,
        "order": mode.order,
        "growth": mode.growth,
        "largest_mm": float(np.abs(mode.amplitude).max()),
        "noise_mm": mode.noise,
    }


def _field_dict(found: Diagnosis, field: FoundField) -> dict[str, Any]:
    evidence = found.explanation.evidence[field.group]
    kind = fields()[effect_of(field.group)]
    largest, where = field.sampled.largest
    before, final = found.explanation.baseline, found.explanation.final
    share = None
    if (without := evidence.without) is not None:
        excess = max(before.held_out() - final.floor, 1e-9)
        share = float(np.clip((without.held_out() - final.held_out()) / excess, 0.0, 1.0))
    return {
        "place": kind.place,
        "field": kind.id,
        "specimen": specimen_of(field.group),
        "probability": evidence.probability,
        "alternatives": sorted({acting()[effect_of(r)].place for r in evidence.rivals}),
        "quantity": kind.quantity,
        "rms": field.sampled.rms,
        "unit": kind.unit,
        "where": where,
        "largest": largest,
        "share_of_gap": share,
    }


def _step_dict(step: Step) -> dict[str, Any]:
    return {
        "heldout_before": step.before.held_out(),
        "taken": step.group,
        "candidates": [
            {
                "effect": step.group,
                "parameters": len(step.after.keys) - len(step.before.keys),
                "heldout": step.after.held_out(),
            }
        ],
    }
