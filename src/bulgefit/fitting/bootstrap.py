"""How sure is a fit? Fitted again to frames drawn with replacement, many times.

The noise of DIC is correlated from point to point, but hardly from frame to frame, and what a
model misses changes slowly with pressure. So whole frames are drawn, in runs of neighbours. The
spread of the refits shows what noise and such misfit do to the parameters; it does not show a
bias that every frame shares.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import Rows, Tabled
from bulgefit.dic.given import GivenTests, given_tests
from bulgefit.effects.parameter import Parameter
from bulgefit.errors import InputError, UnsolvedError
from bulgefit.fitting.fit import weighed
from bulgefit.fitting.minimise import GAUSS_NEWTON, Limits
from bulgefit.fitting.multistart import descents
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.result import FitResult
from bulgefit.shown import Drawn, after_value

__all__ = ["Bootstrap", "bootstrap"]

Floats = NDArray[np.floating]

#: Draws after which a test is said to have too few frames with anything to compare.
_DRAWS = 100


@dataclass(frozen=True, eq=False)
class Bootstrap(Drawn, Tabled):
    """Parameters of the refits.

    As a table: a row a refit, with its free parameters.

    Attributes
    ----------
    free : tuple of Parameter
    values : (refits, free) array
        In the parameters' units; those of refits without an equilibrium are left out.
    failures : int
        Refits without an equilibrium.
    level : float
        Of the intervals, such as 0.95.
    block, seed : int
        Neighbouring frames drawn together, and the seed of the draws.
    """

    free: tuple[Parameter, ...]
    values: Floats
    failures: int
    level: float
    block: int
    seed: int

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Percentile interval of each free parameter."""
        tails = [0.5 * (1 - self.level), 0.5 * (1 + self.level)]
        low, high = np.quantile(self.values, tails, axis=0)
        return {p.name: (float(low[i]), float(high[i])) for i, p in enumerate(self.free)}

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        spread = np.std(self.values, axis=0, ddof=1 if len(self.values) > 1 else 0)
        return {
            "replicates": len(self.values) + self.failures,
            "failures": self.failures,
            "level": self.level,
            "block": self.block,
            "seed": self.seed,
            "parameters": {
                p.name: {
                    "interval": list(self.intervals[p.name]),
                    "standard_deviation": float(spread[i]),
                    "unit": p.unit,
                    "values": self.values[:, i].tolist(),
                }
                for i, p in enumerate(self.free)
            },
        }

    def _rows(self) -> Rows:
        table = {p.name: self.values[:, i] for i, p in enumerate(self.free)}
        return Rows("refit", table, units={p.name: p.unit for p in self.free})

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """The intervals to read."""
        lines = [
            f"{100 * self.level:g} % intervals of {len(self.values)} refits to frames drawn in "
            f"runs of {self.block}" + (f"; {self.failures} failed" if self.failures else "")
        ]
        for p in self.free:
            low, high = self.intervals[p.name]
            lines.append(f"  {p.name:<5}{low:>12.6g} to {high:.6g}{after_value(p.unit)}")
        return "\n".join(lines)


def bootstrap(
    found: FitResult,
    tests: GivenTests,
    *,
    replicates: int = 200,
    block: int | None = None,
    level: float = 0.95,
    seed: int = 0,
    method: str = GAUSS_NEWTON,
    limits: Limits | None = None,
    executor: Executor | None = None,
    workers: int = 1,
) -> Bootstrap:
    """Refit to frames drawn with replacement, each time from the optimum that was found.

    Parameters
    ----------
    found : FitResult
        Its objective, weights, bounds and setup are used.
    tests : BulgeTest, path, or sequence of them
        Those of the fit; frames are drawn within each.
    replicates : int
    block : int, optional
        Neighbouring frames drawn together; default: the cube root of the number of frames.
    level : float
        Of the intervals.
    seed : int
        The same seed gives the same result for any number of workers.
    method, limits
        As `fit` takes them.
    executor, workers
        As `fit` takes them.

    Raises
    ------
    InputError
        Numbers out of range, or tests with too few frames.
    UnsolvedError
        No refit found an equilibrium.
    """
    given = given_tests(tests)
    for name, number in (("replicates", replicates), ("block", block or 1), ("seed", seed)):
        if not isinstance(number, Integral):
            raise InputError(f"bootstrap: {name} is a whole number, got {number!r}")
    length, seed = _block_length(given, block), int(seed)
    if replicates < 1:
        raise InputError(f"bootstrap: give 1 or more replicates, got {replicates}")
    if not isinstance(level, Real) or not 0.0 < level < 1.0:
        raise InputError(f"bootstrap: the level lies between 0 and 1, got {level!r}")
    refits = _Refits(_problem(found, given), seed, length)
    start = refits.base.coordinates({**found.material.values, **found.effects})
    results = descents(
        refits,
        [(i, start) for i in range(replicates)],
        method=method,
        limits=limits,
        executor=executor,
        workers=workers,
    )
    values = [list(d.best.values.values()) for d in results if np.isfinite(d.best.value)]
    if not values:
        raise UnsolvedError(f"bootstrap: no refit found an equilibrium: {results[0].reason}")
    failures = len(results) - len(values)
    return Bootstrap(found.free, np.array(values), failures, float(level), length, seed)


class _Refits:
    """The problem of each replicate, made when it is asked for: they share all but weights."""

    def __init__(self, base: Problem, seed: int, block: int) -> None:
        # a fixed sample of the points would add an error of its own, the same in every refit
        self.base, self.seed, self.block = base.on_all_data(), seed, block

    def __getitem__(self, index: int) -> Problem:
        rng = np.random.default_rng([self.seed, index])
        objective = self.base.objective
        for _ in range(_DRAWS):
            times = [_drawn(test.pressure, self.block, rng) for test in objective.tests]
            repeated = objective.repeated(times)
            if repeated is not None:
                return self.base.with_objective(repeated)
        raise InputError("bootstrap: next to no frame has anything that the objective compares")


def _drawn(pressure: Floats, block: int, rng: np.random.Generator) -> Floats:
    """How often each frame is drawn: runs of neighbours in pressure.

    The last is followed by the first, so that all are drawn alike (Politis and Romano, 1992).
    """
    frames = len(pressure)
    first = rng.integers(frames, size=-(-frames // block))
    ranks = (first[:, None] + np.arange(block)).ravel()[:frames] % frames
    drawn = np.argsort(pressure, kind="stable")[ranks]
    return np.bincount(drawn, minlength=frames).astype(float)


def _block_length(tests: Sequence[BulgeTest], block: int | None) -> int:
    fewest = min(test.n_frames for test in tests)
    if fewest < 2:
        raise InputError("bootstrap: every test needs two frames or more")
    length = round(fewest ** (1 / 3)) if block is None else int(block)
    if not 1 <= length < fewest:
        raise InputError(
            f"bootstrap: runs of {length} frames; give 1 or more, and fewer than the {fewest} "
            "frames of the shortest test"
        )
    return length


def _problem(found: FitResult, tests: Sequence[BulgeTest]) -> Problem:
    """The problem that was solved, with the mesh's error taken off as it is at its optimum."""
    bounds = {**found.options.bounds, **{p.name: (p.lower, p.upper) for p in found.free}}
    problem = replace(found.options, bounds=bounds, weight=found.weights).problem(tests)
    z = problem.coordinates({**found.material.values, **found.effects})
    if problem.objective.setup.corrects_mesh:
        problem.objective.correct_mesh(problem.shapes(z))
    weighed(problem, z)
    return problem
