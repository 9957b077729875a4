"""From parameters to the five places: what specimen, clamp and load do they describe?"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.base import Effect
from bulgefit.effects.places import LEAST_SLIP, Clamping, Clock, Cloth, Load
from bulgefit.effects.registry import acting, effect_named, own_values, parameter_named
from bulgefit.errors import InputError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.geometry import SHAPE
from bulgefit.fem.membrane import Fabric
from bulgefit.fem.mesh import Mesh, corner_areas
from bulgefit.fem.quarter import along_axis

__all__ = [
    "CONSTANTS",
    "Description",
    "Values",
    "active_effects",
    "check_needs",
    "checked",
    "cloth_law",
    "describe",
    "gauss_points",
    "load_on",
    "null_values",
    "require_needs",
    "surface_of",
    "with_value",
]

Floats = NDArray[np.float64]
#: Parameters by name: E1, E2, G12 (MPa), nu12, and `effect.parameter`.
Values = Mapping[str, float]

#: What the stiffness matrix is made of, with half the step of a difference by each.
CONSTANTS = {"E1": 1e-2, "E2": 1e-2, "G12": 1e-3, "nu12": 1e-5}

#: An effect and its parameters' values by their own names.
Active = list[tuple[Effect, dict[str, float]]]


@dataclass(frozen=True, eq=False)
class Description:
    """A specimen in its clamp under its load.

    Attributes
    ----------
    stiffness : (4,) array, MPa
        D11, D22, D12, D33.
    angle : float, rad
        Of the warp from x.
    fabric : Fabric
    load : Load
    edge : (frames, rim, 3) array or None, mm
        Displacement of the rim's nodes in each frame; in the plane, where they slip, that of the
        springs' outer ends.
    eased : (frames,) array or None, mm per N/mm
        By how much more than the fabric's compliance the clamp gives in each frame.
    """

    stiffness: Floats
    angle: float
    fabric: Fabric
    load: Load
    edge: Floats | None
    eased: Floats | None = None

    @property
    def law_parameters(self) -> tuple[float, ...]:
        """What the kernels call q."""
        return self.fabric.law_parameters(self.stiffness)

    @property
    def is_plain(self) -> bool:
        """Whether the specimen is flat, even, held all round, and its warp along an axis.

        So that shapes mirror. And neither slack nor taut at rest: else paths do not begin as a flat
        membrane's do.
        """
        fabric = self.fabric
        uneven = fabric.surface is not None or fabric.thickness is not None or any(fabric.coupling)
        moves = not (fabric.compliance is None and self.edge is None and self.eased is None)
        return not (uneven or moves or any(fabric.slack)) and along_axis(self.angle)

    def in_frames(self, frames: NDArray[np.int64]) -> Description:
        """The same in some of its frames alone, where neither rim nor clamp has its own in each."""
        assert self.edge is None
        assert self.eased is None
        load = self.load
        return replace(self, load=Load(load.recorded[frames], None, load.balanced[frames]))

    def lies_as(self, other: Description) -> bool:
        """Whether all but the law's parameters and the load is as in another one."""
        here, there = self.fabric, other.fabric
        return (
            self.angle == other.angle
            and here.compliance == there.compliance
            and _same(here.surface, there.surface)
            and _same(here.thickness, there.thickness)
            and _same(self.edge, other.edge)
            and _same(self.eased, other.eased)
        )


def _same(a: Floats | None, b: Floats | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))


def checked(values: Iterable[str]) -> None:
    """Refuse names that are neither the material's constants nor an effect's; InputError."""
    for name in values:
        if name not in CONSTANTS:
            parameter_named(name)


def check_needs(values: Values, test: BulgeTest) -> None:
    """Refuse effects that are there and need what a test has not, so that they would do nothing.

    Raises
    ------
    InputError
    """
    for name, value in values.items():
        effect, dot, _ = name.partition(".")
        if dot and value != parameter_named(name).null:
            require_needs(effect_named(effect), test)


def require_needs(effect: Effect, test: BulgeTest) -> None:
    """Refuse a test that has not what an effect needs; InputError."""
    for need in effect.needs:
        if getattr(test, need) is None:
            raise InputError(f"{test.name}: {effect.id} needs the {need} of its frames")


def null_values(poisson_ratio: float) -> dict[str, float]:
    """Values at which effects are absent where that is what a test states, by name."""
    return dict.fromkeys(_stated(), poisson_ratio)


@cache
def _stated() -> tuple[str, ...]:
    """Parameters whose null is what a test states."""
    every = [(effect, p) for effect in acting().values() for p in effect.parameters]
    return tuple(f"{effect.id}.{p.name}" for effect, p in every if p.null is None)


def active_effects(values: Values, nulls: Values, freed: Iterable[str] = ()) -> Active:
    """Effects off their null, or with a parameter among `freed`, in the order they act."""
    wanted = {name.partition(".")[0] for name in freed}
    named = {name.partition(".")[0] for name in values}
    found: Active = []
    for effect in acting().values():
        if effect.id not in named and effect.id not in wanted:
            continue
        own = own_values(effect, values, nulls)
        null = own_values(effect, {}, nulls)
        if own != null or effect.id in wanted:
            found.append((effect, own))
    return found


def with_value(active: Active, name: str, value: float, nulls: Values) -> Active:
    """Active effects where one more parameter (`effect.parameter`) has another value.

    As `active_effects` of all values with that one changed, without looking at the others anew.
    """
    id_, _, parameter = name.partition(".")
    rank = {known: number for number, known in enumerate(acting())}
    effect = effect_named(id_)
    rest = [(other, own) for other, own in active if other is not effect]
    null = own_values(effect, {}, nulls)
    before = next((own for other, own in active if other is effect), null)
    own = {**before, parameter: value}
    if own == null:
        return rest
    place = sum(rank[other.id] < rank[id_] for other, _ in rest)
    return [*rest[:place], (effect, own), *rest[place:]]


def describe(
    mesh: Mesh,
    radius: float,
    recorded: Floats,
    clock: Clock | None,
    values: Values,
    active: Active,
    *,
    slips: bool = False,
    stretch: Floats | float = 1.0,
    warp: float | None = None,
    beside: Description | None = None,
    hooks: Iterable[str] = (),
) -> Description:
    """Fill shape, clamp, material and load by the hooks of the active effects.

    Parameters
    ----------
    recorded : (frames,) array, MPa
    clock : Clock or None
    values : mapping
        With E1, E2, G12 and nu12.
    active : list of (Effect, values)
    slips : bool
        Let the rim move by the least compliance where nothing else makes it: its derivative there
        is that of a clamp that begins to slip.
    stretch : float or (2,) array
        The clamp's semi-axes over its radius: effects act on the disc of which it is the image.
    warp : float, degree, optional
        Angle to x at which the warp was mounted; effects turn it further.
    beside : Description, optional
        By other values, which act by `hooks` alone: what these do not touch is as there.
    hooks : iterable of str

    Raises
    ------
    InputError
        Constants that are not admissible, or a clamp's opening that is bent too far.
    """
    changed = set(hooks)

    def kept(*hooks: str) -> Description | None:
        return beside if changed.isdisjoint(hooks) else None

    scale = radius * stretch
    load = there.load if (there := kept("load")) else load_on(recorded, clock, active)
    if there := kept("outline", "height"):
        surface = there.fabric.surface
    else:
        surface = surface_of(mesh.nodes / scale, active, scale)
        _require_unfolded(mesh, surface, active)
    if there := kept("load", "clamp"):
        edge, eased, compliance = there.edge, there.eased, there.fabric.compliance
    else:
        edge, eased, compliance = _clamped(mesh, load, clock, active, slips=slips)
    if there := kept("material"):
        fabric = replace(there.fabric, surface=surface, compliance=compliance)
        return replace(there, fabric=fabric, load=load, edge=edge, eased=eased)
    cloth = _cloth(values, active, gauss_points(mesh, scale), warp or 0.0)
    return Description(
        stiffness=orthotropic_stiffness(cloth.E1, cloth.E2, cloth.G12, cloth.nu12),
        angle=float(np.deg2rad(cloth.angle)),
        fabric=_fabric(cloth, surface, compliance),
        load=load,
        edge=edge,
        eased=eased,
    )


def load_on(recorded: Floats, clock: Clock | None, active: Active) -> Load:
    """Recorded, true and balanced pressures, and how much stiffness is left at each.

    Raises
    ------
    InputError
        None is left.
    """
    load = Load(recorded, clock, recorded)
    for effect, own in active:
        load = effect.load(own, load)
    if not (np.asarray(load.softening) > 0.0).all():
        raise InputError("the fabric's stiffness falls to nothing within the test")
    return load


def surface_of(unit: Floats, active: Active, scale: Floats | float) -> Floats | None:
    """Stress-free positions (n, 3) mm of nodes at (n, 2) of the unit disc; None: flat and round."""
    outline, height, bent = unit, np.zeros(len(unit)), False
    for effect, own in active:
        if effect.uses("outline", "height"):
            bent = True
            outline = effect.outline(own, outline)
            height = height + effect.height(own, unit)
    return np.column_stack([outline * scale, height]) if bent else None


def _require_unfolded(mesh: Mesh, surface: Floats | None, active: Active) -> None:
    """Refuse outlines that turn cells over or leave them no area; InputError."""
    if surface is not None and not (corner_areas(surface[:, :2], mesh.cells) > 0.0).all():
        bent = ", ".join(effect.id for effect, _ in active if effect.uses("outline"))
        raise InputError(f"the clamp's opening folds over itself: let {bent} be smaller")


def _clamped(
    mesh: Mesh, load: Load, clock: Clock | None, active: Active, *, slips: bool
) -> tuple[Floats | None, Floats | None, float | None]:
    """Displacement of the rim's nodes, what the clamp gives more by frame, and its compliance."""
    rim = mesh.nodes[mesh.rim]
    clamping = Clamping(np.arctan2(rim[:, 1], rim[:, 0]), load.applied, clock=clock)
    for effect, own in active:
        clamping = effect.clamp(own, clamping)
    compliance = clamping.compliance
    if compliance is not None or clamping.eased is not None or slips:
        compliance = max(compliance or 0.0, LEAST_SLIP)
    return clamping.edge, _eased(clamping.eased, compliance, load.softening), compliance


def _eased(
    eased: Floats | None, compliance: float | None, softening: Floats | float
) -> Floats | None:
    """What a clamp gives more by frame (mm per N/mm), told by the traction of a fresh fabric.

    One whose stiffness fell to a share c balances p as the fresh one does p/c, under 1/c times the
    traction that there is (`Load.softening`). What gives by the traction is told c times as much.
    """
    if compliance is None or np.all(softening == 1.0):
        return eased
    gives = compliance + (0.0 if eased is None else eased)
    return np.asarray(gives * softening - compliance)


def cloth_law(values: Values, nulls: Values) -> tuple[Floats, Fabric]:
    """Stiffness (4,) MPa and curves of the cloth itself, without what a specimen has of its own.

    Parameters
    ----------
    values : mapping
        With E1, E2, G12 and nu12.
    nulls : mapping
        See `null_values`.

    Raises
    ------
    InputError
        Constants that are not admissible.
    """
    shared = [(effect, own) for effect, own in active_effects(values, nulls) if effect.shared]
    cloth = _cloth(values, shared, np.zeros((1, 4, 2)))
    stiffness = orthotropic_stiffness(cloth.E1, cloth.E2, cloth.G12, cloth.nu12)
    return stiffness, _fabric(cloth, None, None)


def _cloth(values: Values, active: Active, points: Floats, warp: float = 0.0) -> Cloth:
    """The material's place at points (m, 4, 2) of the unit disc, its warp mounted at an angle."""
    e1, e2, g12, nu12 = (values[name] for name in CONSTANTS)
    cloth = Cloth(e1, e2, g12, nu12, points, angle=warp)
    for effect, own in active:
        cloth = effect.material(own, cloth)
    return cloth


def _fabric(cloth: Cloth, surface: Floats | None, compliance: float | None) -> Fabric:
    return Fabric(
        surface=surface,
        thickness=cloth.thickness,
        slack=cloth.slack,
        gain=(cloth.gain[0] * cloth.E1, cloth.gain[1] * cloth.E2),
        bend=(cloth.bend[0] * cloth.E1, cloth.bend[1] * cloth.E2),
        knee=cloth.knee,
        curve=cloth.curve,
        coupling=(
            cloth.coupling[0] * math.sqrt(cloth.E1 * cloth.G12),
            cloth.coupling[1] * math.sqrt(cloth.E2 * cloth.G12),
        ),
        compliance=compliance,
    )


def gauss_points(mesh: Mesh, scale: Floats | float) -> Floats:
    """(m, 4, 2) on the unit disc, of which the mesh is the image by a scale, mm."""
    return _gauss_points(mesh) / scale


@lru_cache(maxsize=8)
def _gauss_points(mesh: Mesh) -> Floats:
    """(m, 4, 2) mm."""
    return np.einsum("ga,max->mgx", SHAPE, mesh.nodes[mesh.cells])
