"""Does a path reach 3 bar, or say rightly why not? Random materials, fabrics, laws and meshes.

python benchmarks/robustness.py N [--seed S] [--workers W] [--log FILE] prints the table of
docs/verification.md. Set k of a seed is the same whatever N is; with a log, a line of JSON a set,
those that stand in it are not traced again. --sets 3,8 traces these alone; --times checks nothing
that comes out, which takes several times as long as the paths. Sets that took over 20 times the
median of their mesh are timed again when no others run, and so are sets about the median: what else
a machine does at a time adds to some more than to others. --study draws flat cloth of the Hencky
law within the published study's bounds, on the default mesh, and goes on beyond the loss of
ellipticity as fits do.

Each set is traced from 0.001 to 3 bar. What comes out is checked by other means than the path's
own: equilibria by their residual and by the balance of work, U(p2) - U(p1) = ∫ p dV along the path;
answers by what they state: a limit pressure by a path to just below it and by descent that finds no
shape above; a loss of ellipticity by a stable path to just below it, which does not go on above
when it is followed closely, unless over a snap, and a shape at its pressure, where the acoustic
tensor is not positive definite. Where a set mirrors in both axes, so must its stable shapes, where
they do not come from a quarter of the mesh anyhow.
"""

from __future__ import annotations

import argparse
import json
import os
import sys

os.environ.update(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path as File
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import KDTree

from bulgefit.errors import Cause, InputError, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import NewtonError, flat_guess, solve
from bulgefit.fem.laws.potential import KNOTS
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.trace import TOLERANCE, trace
from bulgefit.fem.volume_control import at_volume

RANGE = (1e-4, 0.3)  # MPa
THICKNESS = 0.81  # mm
LAWS = ("hencky", "svk", "yarn")
#: `disc`'s refinement, its cells along the middle; the default mesh has 4.
MESHES = (2, 3, 4)
#: Sets that are traced in each process before its own: of all laws, some of which lose ellipticity.
_WARM = 24
#: Times the median that no set should take.
_LONG = 20
#: Sets about the median that are timed beside those that take longer.
_ABOUT = 31
#: Pressures at which the work along a path is looked at, about: a few where it has many levels.
_POINTS = 90
#: mm: what balanced shapes may differ by from their mirror images. Corrections are below 1e-9 mm
#: and cloth may be a thousand times as loose across its folds as along them.
ALIKE = 1e-5


@dataclass(frozen=True)
class Case:
    """One random set; moduli in MPa, angle in degrees, heights in mm."""

    law: str
    moduli: tuple[float, float, float]
    nu12: float
    angle: float
    slack: tuple[float, float]
    heights: tuple[float, ...]
    compliance: float | None
    curve: tuple[tuple[float, ...], tuple[float, ...]] | None
    refine: int
    beyond: bool = False

    def membrane(self) -> Membrane:
        mesh = disc(100.0, self.refine)
        surface = None
        if any(self.heights):
            x, y = mesh.nodes.T / 100.0
            h0, hx, hy, c2, s2 = self.heights
            height = h0 + hx * x + hy * y + c2 * (x * x - y * y) + s2 * 2 * x * y
            surface = np.column_stack([mesh.nodes, (1 - x * x - y * y) * height])
        curve = None if self.curve is None else np.array(self.curve)
        fabric = Fabric(surface=surface, slack=self.slack, compliance=self.compliance, curve=curve)
        return Membrane(mesh, THICKNESS, self.law, angle=np.radians(self.angle), fabric=fabric)

    @property
    def mirrors(self) -> bool:
        """In both axes."""
        _, hx, hy, _, s2 = self.heights
        return not any((self.angle, hx, hy, s2))


def draw(seed: int, number: int) -> Case:
    """A set; a third each have slack, an initial shape, a slip, turned axes, a law of curves.

    Half of the initial shapes are paraboloids. Logarithms of a curve's slopes walk from one knot to
    the next, by 0.4 within 2 % of strain.
    """
    rng = np.random.default_rng((seed, number))
    e1, e2 = np.exp(rng.uniform(np.log(20.0), np.log(5000.0), 2))
    g12 = float(np.exp(rng.uniform(np.log(0.5), np.log(500.0))))
    has = rng.random(5) < 1 / 3
    slack, heights = rng.uniform(-0.02, 0.02, 2), rng.uniform(-10.0, 10.0, 5)
    heights[1:] *= rng.random() < 0.5
    steps = 0.4 * np.sqrt(np.diff(KNOTS) / 0.02) * rng.standard_normal((2, len(KNOTS) - 1))
    warp, fill = (tuple(row) for row in np.cumsum(steps, axis=1).tolist())
    return Case(
        law=str(rng.choice(LAWS)),
        moduli=(float(e1), float(e2), g12),
        nu12=float(rng.uniform(0.0, 0.45)),
        angle=float(rng.uniform(-90.0, 90.0)) if has[3] else 0.0,
        slack=(float(slack[0]), float(slack[1])) if has[0] else (0.0, 0.0),
        heights=tuple(heights.tolist()) if has[1] else (0.0,) * 5,
        compliance=float(rng.uniform(0.0, 0.1)) if has[2] else None,
        curve=((0.0, *warp), (0.0, *fill)) if has[4] else None,
        refine=int(rng.choice(MESHES)),
    )


def draw_study(seed: int, number: int) -> Case:
    """A set within the study's bounds, with its Poisson's ratio."""
    e1, e2, g12 = np.random.default_rng((seed, number)).uniform((100, 50, 2), (400, 300, 10))
    return Case(
        law="hencky", moduli=(float(e1), float(e2), float(g12)), nu12=0.24, angle=0.0,
        slack=(0.0, 0.0), heights=(0.0,) * 5, compliance=None, curve=None, refine=4, beyond=True,
    )  # fmt: skip


def stored(membrane: Membrane, shape: np.ndarray, stiffness: np.ndarray) -> tuple[float, float]:
    """Stored energy (N mm) and volume (mm³) at a shape."""
    energy, at_one = (
        membrane.state(shape, p, stiffness, tangent=False).potential for p in (0.0, 1.0)
    )
    return energy, energy - at_one


def faults(case: Case, membrane: Membrane, stiffness: np.ndarray, path: Path) -> list[str]:
    """What is wrong with a path that claims equilibria."""
    found = []
    # N: what 1e-8 mm take. Newton's last correction is some 1e-9 mm, the stiffness of a cell a few
    # times D t where its curve is steepest, and at a rim that slips there are the clamp's springs
    steepest = 1.0 if case.curve is None else float(np.exp(np.max(case.curve)))
    allowed = np.full_like(membrane.reference, 1e-8 * steepest * stiffness.max() * THICKNESS)
    if membrane.clamp is not None:
        allowed[membrane.clamp.rim, :2] += 1e-8 * np.abs(membrane.clamp.stiffness).sum(axis=2)
    for shape, p in zip(path.displacement, path.pressure, strict=True):
        state = membrane.state(shape, float(p), stiffness, tangent=False)
        if (np.abs(state.residual) > membrane.gather(allowed)).any():
            found.append("residual")
            break
    # beyond ellipticity nothing is claimed of what lies between levels
    if case.beyond:
        return found
    if not any(_balances(membrane, stiffness, path, solved=solved) for solved in (False, True)):
        found.append("work")
    if case.mirrors and path.stable.all() and _unlike(membrane, path) > ALIKE:
        found.append("symmetry")
    return found


def _unlike(membrane: Membrane, path: Path) -> float:
    """Greatest difference (mm) between the levels and their images in both mirrors."""
    nodes, tree = membrane.mesh.nodes, KDTree(membrane.mesh.nodes)
    apart = []
    for sign in np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]):
        image = tree.query(nodes * sign[:2])[1]
        apart.append(np.abs(path.displacement[:, image] * sign - path.displacement).max())
    return float(max(apart))


def _balances(membrane: Membrane, stiffness: np.ndarray, path: Path, *, solved: bool) -> bool:
    """Whether the energy stored between the ends is p2 V2 - p1 V1 - ∫ V dp to a thousandth.

    With the volumes of the dense output; `solved`: of shapes that are balanced from what two levels
    say of their own way, from the dense output, which goes by others too, or from the upper level.
    """
    levels = np.cbrt(path.pressure)
    at, weight = np.polynomial.legendre.leggauss(max(6, _POINTS // len(levels)))
    work = 0.0
    for first, (low, high) in enumerate(pairwise(levels)):
        s = 0.5 * (low + high) + 0.5 * (high - low) * at
        ends = slice(first, first + 2)
        upper = path.displacement[first + 1]
        way = CubicHermiteSpline(levels[ends], path.displacement[ends], path.slope[ends])
        for k, shape in enumerate(path(s**3)):
            if solved:
                starts = (way(s[k]), shape, upper)
                found = _balanced(membrane, stiffness, float(s[k] ** 3), starts)
                if found is None:
                    return False
                shape = found
            work += 0.5 * (high - low) * weight[k] * membrane.volume(shape) * 3 * s[k] ** 2
    (u1, v1), (u2, v2) = (stored(membrane, path.displacement[k], stiffness) for k in (0, -1))
    complementary = path.pressure[-1] * v2 - path.pressure[0] * v1 - work
    return bool(abs(u2 - u1 - complementary) <= 1e-3 * abs(u2 - u1))


def _balanced(
    membrane: Membrane, stiffness: np.ndarray, p: float, starts: tuple[np.ndarray, ...]
) -> np.ndarray | None:
    """The shape that balances a pressure, from the first start that leads to one."""
    for start in starts:
        with suppress(NewtonError):
            return solve(membrane, start, p, stiffness, patient=True).displacement
    return None


def doubts(
    membrane: Membrane, stiffness: np.ndarray, error: SolveError, *, beyond: bool
) -> list[str]:
    """What speaks against an answer, by other paths than the one that gave it."""
    if error.cause is Cause.LIMIT_PRESSURE:
        try:
            range_ = _below(error, 0.999)
            below = trace(membrane, stiffness, range_, beyond_ellipticity=beyond)
        except SolveError:
            return ["no path to just below it"]
        try:
            solve(membrane, below.displacement[-1], 1.01 * error.reached, stiffness)
        except NewtonError:
            return []
        return ["an equilibrium above it"]
    if error.cause is Cause.LOSS_OF_ELLIPTICITY:
        return _doubts_of_loss(membrane, stiffness, error)
    return [error.reason]


def _doubts_of_loss(membrane: Membrane, stiffness: np.ndarray, error: SolveError) -> list[str]:
    """Is there a stable path to just below, and a shape that is not elliptic just above?

    Cloth that lies loosely may have no path up to where it is taut, and none at all where it has
    lost ellipticity at rest; then the shape at the pressure of the loss is looked at.
    """
    below = None
    if error.reached > 0.0:
        below = _path_below(membrane, stiffness, error)
        if below is None:
            return ["no path to just below it"]
        if not below.stable.all():
            return ["unstable below it"]
        if _goes_on(membrane, stiffness, below, error):
            return ["a stable path goes on above it"]
        # a branch that is close to its limit pressure, too, changes fast below it
        last = _balanced(membrane, stiffness, error.reached, (below.displacement[-1],))
        last = below.displacement[-1] if last is None else last
        if membrane.acoustic_margin(last, stiffness) < 0.0:
            return []
        if _lost_by_volume(membrane, stiffness, below.displacement[-1], error.pressure):
            return []
    above = None
    for p in (error.pressure, *(error.pressure * 10.0 ** np.arange(3, -1, -1))):
        # from the pressure itself, else led down to it, or as near as that goes, from where cloth
        # is taut
        guess = flat_guess(membrane, p, stiffness) if above is None else above
        found = _balanced(membrane, stiffness, p, (guess,))
        if found is None and above is not None:
            break
        above = found
        if above is not None and p == error.pressure:
            break
    if above is None or membrane.acoustic_margin(above, stiffness) >= 0.0:
        return ["elliptic beside it"]
    return []


def _path_below(membrane: Membrane, stiffness: np.ndarray, error: SolveError) -> Path | None:
    """A path to just below a loss; beside a singular tangent two find it within some thousandths.

    Of the whole membrane, and where its descent leaps into bands at the start, by its quarter.
    """
    for path in (trace, trace_by_quarter):
        with suppress(SolveError):
            return path(membrane, stiffness, _below(error, 0.99))
    return None


def _goes_on(membrane: Membrane, stiffness: np.ndarray, below: Path, error: SolveError) -> bool:
    """Whether the path is stable up to 1 % above, followed by 0.2 % at a time.

    And within 0.4 % by a tenth of that, since a longer step may leap over a snap. Two stable
    shapes may also lie on either side of a snap: then the upper one leads down to another shape
    than the lower one, or the branch between them, by its volume, is unstable.
    """
    last, low = float(below.pressure[-1]), below.displacement[-1]
    coarse = np.arange(0.992, 1.011, 0.002) * error.reached
    for p, shape in _followed(membrane, stiffness, below, coarse):
        if shape is None:
            return False
        # a snap further on says nothing of this loss
        beside = abs(p / error.reached - 1.0) < 0.003
        if beside and (
            _comes_down_apart(membrane, stiffness, low, shape, last)
            or _snaps(membrane, stiffness, low, shape, p)
        ):
            return False
        last, low = p, shape
    fine = np.concatenate([coarse[:2], np.arange(0.996, 1.004, 0.0002) * error.reached])
    return all(shape is not None for _, shape in _followed(membrane, stiffness, below, fine))


def _followed(
    membrane: Membrane, stiffness: np.ndarray, below: Path, pressures: np.ndarray
) -> Iterator[tuple[float, np.ndarray | None]]:
    """Stable shapes at rising pressures (MPa), each predicted from two before; None ends them."""
    ps = [0.998 * float(below.pressure[-1]), float(below.pressure[-1])]
    shapes = [below(ps[0])[0], below.displacement[-1]]
    for p in pressures.tolist():
        ahead = (p - ps[1]) / (ps[1] - ps[0])
        guess = shapes[1] + ahead * (shapes[1] - shapes[0])
        balance = None
        with suppress(NewtonError):
            balance = solve(membrane, guess, p, stiffness, follow=True)
        if balance is None or not balance.stable:
            yield p, None
            return
        yield p, balance.displacement
        ps, shapes = [ps[1], p], [shapes[1], balance.displacement]


def _comes_down_apart(
    membrane: Membrane, stiffness: np.ndarray, low: np.ndarray, high: np.ndarray, p: float
) -> bool:
    """Whether the branch of `high` has another shape than `low` at the pressure (MPa) of that.

    Of one branch both would balance within some 1e-9 mm; less than a path's tolerance is no snap
    that it would tell. Over a snap volume may turn back as pressure does, and lead nowhere.
    """
    with suppress(NewtonError):
        back = solve(membrane, high, p, stiffness, follow=True).displacement
        return bool(np.abs(back - low).max() > TOLERANCE)
    return False


def _snaps(
    membrane: Membrane, stiffness: np.ndarray, low: np.ndarray, high: np.ndarray, p: float
) -> bool:
    """Whether the branch between two shapes is unstable, and not elliptic, at one of 39 volumes."""
    first, last = membrane.volume(low), membrane.volume(high)
    shape = low
    for volume in np.linspace(first, last, 41)[1:-1]:
        with suppress(NewtonError):
            point = at_volume(membrane, stiffness, shape, p, float(volume))
            shape = point.displacement
            if not point.stable and membrane.acoustic_margin(shape, stiffness) < 0.0:
                return True
    return False


def _lost_by_volume(
    membrane: Membrane, stiffness: np.ndarray, shape: np.ndarray, pressure: float
) -> bool:
    """Whether a shape that is blown up turns unstable and not elliptic within 0.1 % of a pressure.

    Where bands make a limit pressure, nothing balances above it; more volume leads past it.
    """
    p, first = pressure, membrane.volume(shape)
    with suppress(NewtonError):
        for volume in first * 1.004 ** np.arange(1, 26):
            point = at_volume(membrane, stiffness, shape, p, float(volume))
            shape, p = point.displacement, point.pressure
            if not point.stable and membrane.acoustic_margin(shape, stiffness) < 0.0:
                return abs(p - pressure) <= 1e-3 * pressure
    return False


def _below(error: SolveError, share: float) -> tuple[float, float]:
    """Pressures (MPa) up to a share of the one that a path reached."""
    return min(RANGE[0], 0.5 * error.reached), share * error.reached


def outcome(case: Case, *, checked: bool = True) -> dict[str, Any]:
    """Trace a set and check what comes out."""
    try:
        stiffness = orthotropic_stiffness(*case.moduli, case.nu12)
    except InputError:
        return {"outcome": Cause.INADMISSIBLE.name, "seconds": 0.0, "faults": []}
    membrane = case.membrane()
    start = time.process_time()
    try:
        membrane.law_parameters(stiffness)
    except InputError:  # yarns that soften more than their contraction allows
        return {"outcome": Cause.INADMISSIBLE.name, "seconds": 0.0, "faults": []}
    try:
        path = trace_by_quarter(membrane, stiffness, RANGE, beyond_ellipticity=case.beyond)
    except SolveError as error:
        took = time.process_time() - start
        return {
            "outcome": error.cause.name, "seconds": took, "reached": 10 * error.reached,
            "faults": doubts(membrane, stiffness, error, beyond=case.beyond) if checked else [],
        }  # fmt: skip
    took = time.process_time() - start
    return {
        "outcome": "stable" if path.stable.all() else "unstable", "seconds": took,
        "levels": len(path.pressure), "error": path.error_estimate,
        "faults": faults(case, membrane, stiffness, path) if checked else [],
    }  # fmt: skip


def line(drawn: Callable[[int], Case], checked: bool, number: int) -> dict[str, Any]:
    """A line of the log."""
    case = drawn(number)
    try:
        found = outcome(case, checked=checked)
    except Exception as error:  # a fault of this set is no end of the others
        found = {"outcome": "CRASH", "seconds": 0.0, "faults": [repr(error)]}
    return {"set": number, **asdict(case), **found}


def warm() -> None:
    """Compile kernels, or load them: a set's time is that of its path."""
    for number in range(_WARM):
        outcome(draw(0, number), checked=False)


def table(found: list[dict[str, Any]], *, checked: bool) -> list[str]:
    """Counts of outcomes by law, and times, as lines of Markdown."""
    count = Counter((one["outcome"], one["law"]) for one in found)
    names = sorted({name for name, _ in count})
    lines = ["| outcome | " + " | ".join(LAWS) + " |", "|---|" + "---|" * len(LAWS)]
    lines += [f"| {n} | " + " | ".join(str(count[n, law]) for law in LAWS) + " |" for n in names]
    wrong = Counter(fault for one in found for fault in one["faults"])
    rough = sum(one.get("error", 0.0) > 1e-3 for one in found)
    lines += ["", f"Faults: {dict(wrong) or 'none'}." if checked else "Nothing was checked."]
    lines += [f"Dense output beyond its tolerance in {rough} paths."]
    for refine, middle in medians(found).items():
        times = np.array([f["seconds"] for f in found if f["seconds"] and f["refine"] == refine])
        lines.append(
            f"{refine} cells along the middle: median {middle:.3f} s, longest "
            f"{times.max():.2f} s, {int((times > _LONG * middle).sum())} of {len(times)} over "
            f"{_LONG} times the median."
        )
    return lines


def medians(found: list[dict[str, Any]]) -> dict[int, float]:
    """Of the times of what was traced, s, by mesh."""
    times = {
        refine: [f["seconds"] for f in found if f["seconds"] and f["refine"] == refine]
        for refine in MESHES
    }
    return {refine: float(np.median(some)) for refine, some in times.items() if some}


def timed_alone(drawn: Callable[[int], Case], found: list[dict[str, Any]]) -> list[str]:
    """Times of sets that took too long, over those of sets about the median, with none beside."""
    lines = []
    warm()
    for refine, middle in medians(found).items():
        some = [f for f in found if f["seconds"] and f["refine"] == refine]
        late = [f["set"] for f in some if f["seconds"] > _LONG * middle]
        if late:
            some.sort(key=lambda f: abs(f["seconds"] - middle))
            about = np.median([_seconds(drawn(f["set"])) for f in some[:_ABOUT]])
            times = {number: _seconds(drawn(number)) / about for number in late}
            shown = ", ".join(f"{time:.1f} (set {number})" for number, time in times.items())
            lines.append(f"{refine} cells along the middle, alone, over the median: {shown}.")
    return lines


def _seconds(case: Case) -> float:
    return float(outcome(case, checked=False)["seconds"])


def traced(
    drawn: Callable[[int], Case],
    numbers: list[int],
    workers: int,
    log: File | None,
    *,
    checked: bool,
) -> list[dict[str, Any]]:
    """The lines of these sets, from the log or traced now."""
    found = {}
    if log is not None and log.exists():
        # a run that was killed may have left a part of a line
        whole, _, _ = log.read_text().rpartition("\n")
        log.write_text(whole + "\n" if whole else "")
        found = {one["set"]: one for one in map(json.loads, whole.splitlines())}
    left = [number for number in numbers if number not in found]
    with get_context("spawn").Pool(workers, warm) as pool:
        for one in pool.imap_unordered(partial(line, drawn, checked), left):
            found[one["set"]] = one
            said = json.dumps(one)
            if log is not None:
                with log.open("a") as file:
                    file.write(said + "\n")
            if log is None or one["faults"]:
                print(said, file=sys.stderr, flush=True)
    return [found[number] for number in numbers]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--log", type=File)
    parser.add_argument("--sets", help="numbers of sets, by commas")
    parser.add_argument("--times", action="store_true", help="check nothing that comes out")
    parser.add_argument("--study", action="store_true", help="within the study's bounds, as fits")
    args = parser.parse_args()
    numbers = list(range(args.count)) if args.sets is None else list(map(int, args.sets.split(",")))
    drawn = partial(draw_study if args.study else draw, args.seed)
    found = traced(drawn, numbers, args.workers, args.log, checked=not args.times)
    print("\n".join(table(found, checked=not args.times) + timed_alone(drawn, found)))


if __name__ == "__main__":
    main()
