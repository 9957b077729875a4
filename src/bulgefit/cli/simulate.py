"""bulgefit simulate: which shapes does a membrane of known material take?"""

from __future__ import annotations

import argparse
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common
from bulgefit.cli._effects import (
    add_effect_arguments,
    given_ratios,
    held_by_hand,
    held_from,
    take_found_law,
    take_found_moduli,
)
from bulgefit.cli._mounting import Mounting, mounting_from
from bulgefit.cli.tests_in import files_read
from bulgefit.errors import InputError
from bulgefit.shown import after_value, plain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bulgefit.model.parameters import Material
    from bulgefit.model.simulation import Simulation

__all__ = ["HELP", "add_arguments", "run"]

HELP = "inflate a membrane of known material"

#: Values of one effect that are shown one by one.
_SHOWN = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Inflate a flat membrane that is clamped round its rim and show how high its apex (the\n"
        "node nearest the centre) rises. Moduli in MPa, pressures in bar, lengths in mm; x is\n"
        "warp (1), y is fill (2), z is the direction of inflation."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit simulate --E1 303 --E2 229 --G12 30 --nu12 0.24 --pressure 0.5,1,2,3\n"
        "  bulgefit simulate --E 250 --nu 0.24 --law svk --pressure 3 --json -\n"
        "  bulgefit simulate --E1 303 --E2 229 --G12 30 --pressure 1,3 --output path.pvd \\\n"
        "      --picture bulge.png\n\n"
        "A path.npz is itself a bulge test without noise, so the other verbs read it too."
    )
    parser.add_argument(
        "--pressure",
        required=True,
        metavar="BAR[,BAR...]",
        help="pressures in bar, above 0, in any order (1 bar = 0.1 MPa)",
    )
    _common.add_material_arguments(parser)
    group = parser.add_argument_group("specimen")
    group.add_argument(
        "--radius",
        type=float,
        metavar="MM",
        help="clamp radius in mm (default: what the --mesh reaches or the tests of --from had, "
        "else 100)",
    )
    group.add_argument(
        "--semi-axes",
        type=float,
        nargs=2,
        metavar=("A", "B"),
        help="semi-axes in mm, along x (warp) and y (fill), of an elliptic clamp, in the place of "
        "its radius",
    )
    group.add_argument(
        "--thickness",
        type=float,
        metavar="MM",
        help="thickness of the fabric in mm (default: what the tests of --from had, else 0.81)",
    )
    group.add_argument(
        "--angle",
        type=float,
        metavar="DEG",
        help="warp turned from x in degrees, counter-clockwise seen from +z (default: as in the "
        "tests of --from, else 0)",
    )
    add_effect_arguments(parser)
    _common.add_solver_arguments(parser, found=True)
    _common.add_mesh_error_argument(parser)
    _common.add_json_arguments(parser)
    parser.add_argument(
        "--output",
        metavar="FILE",
        help="write the shapes: .npz (arrays), or .pvd with one .vtu a pressure for ParaView "
        "(displacement, strain and stress)",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        help="picture of the shape at the last pressure given, coloured by dz, |dx| and |dy|",
    )


def run(args: argparse.Namespace) -> int:
    """Simulate, write and print."""
    pressures = _pressures(args.pressure)
    _check_outputs(args, len(pressures))
    ratios = given_ratios(args)
    take_found_law(args)
    take_found_moduli(args)
    material = _common.material_from(args)

    import numpy as np

    from bulgefit.fem.mesh import DEFAULT_REFINE
    from bulgefit.model.parameters import check_replaced
    from bulgefit.model.simulation import simulate

    held = _held(args)
    check_replaced(held, ratios)
    mounting = mounting_from(args)
    mesh, reach = None, mounting.radius
    if args.mesh is not None:
        mesh = _common.mesh_from(args, reach)
        reach = float(np.hypot(*mesh.nodes.T).max())
        if args.radius is not None and abs(reach - args.radius) > 0.01 * args.radius:
            raise InputError(
                f"--radius {args.radius:g}: {args.mesh} reaches {reach:.6g} mm from the centre; "
                "leave --radius out or scale the mesh"
            )
    _warn_of_sizes(args, material, reach, mounting.thickness)
    result = simulate(
        material,
        np.array(pressures) / 10.0,
        mesh=mesh,
        refine=DEFAULT_REFINE if args.refine is None else args.refine,
        correct_mesh=not args.keep_mesh_error,
        radius=mounting.radius,
        ellipticity=mounting.ellipticity,
        thickness=mounting.thickness,
        angle=mounting.angle,
        effects=held,
        **_common.solver_options(args),
    )
    _common.deliver(
        args,
        {**_payload(args, mounting, result, pressures), "effects": _values(held)},
        _table(mounting, result, pressures, held),
        partial(_write_shapes, args, mounting, result),
        partial(_draw, args, result, pressures[-1]),
    )
    return 0


def _held(args: argparse.Namespace) -> dict[str, float]:
    """Effects of the shape; others are refused where --hold sets them, and told of --from."""
    held, by_hand = held_from(args), held_by_hand(args)
    hidden = {name: why for name in held if (why := _why_hidden(name))}
    if told := _by_reason({name: why for name, why in hidden.items() if name in by_hand}):
        raise InputError(f"--hold: a simulation shows nothing of {told}; leave that out")
    if told := _by_reason(hidden):
        _common.progress(
            args, f"note: --from {args.from_file}: a simulation shows nothing of {told}"
        )
    return {name: value for name, value in held.items() if name not in hidden}


def _why_hidden(name: str) -> str:
    """Why an effect's parameter changes no shape of a simulation, else ""."""
    from bulgefit.effects.parameter import Key
    from bulgefit.effects.registry import effect_named

    effect = effect_named(Key.read(name).effect)
    if effect.place == "camera":
        return "what cameras do changes no shape"
    return f"it has no {' and no '.join(effect.needs)}" if effect.needs else ""


def _by_reason(hidden: Mapping[str, str]) -> str:
    """Parameters, in words, with why they are hidden."""
    reasons = dict.fromkeys(hidden.values())
    return " and ".join(
        f"{', '.join(name for name in hidden if hidden[name] == why)} ({why})" for why in reasons
    )


def _warn_of_sizes(
    args: argparse.Namespace, material: Material, radius: float, thickness: float
) -> None:
    """Of what `info` would not believe of a test: units that were taken for others."""
    from bulgefit.dic.check import check_lengths
    from bulgefit.dic.suspicions.sizes import about_thickness

    try:
        check_lengths(radius, thickness, "specimen")
    except InputError as error:  # which a simulation can do without
        _common.progress(args, f"warning: {error}")
    for one in about_thickness(radius, thickness):
        _common.progress(args, f"warning: {one.text}; {one.remedy}")
    _common.warn_of_moduli(args, material, thickness)


def _pressures(text: str) -> list[float]:
    pressures = []
    for item in text.split(","):
        try:
            value = float(item)
        except ValueError:
            raise InputError(
                f"--pressure: {item.strip()!r} is no number; give bar, such as 0.5,1,2"
            ) from None
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"--pressure: {item.strip()} is not a pressure above 0 bar")
        pressures.append(value)
    return pressures


def _check_outputs(args: argparse.Namespace, count: int) -> None:
    """Refuse outputs before anything is computed."""
    from bulgefit.files import check_output

    outputs: list[str | Path] = []
    if args.output is not None:
        suffix = Path(args.output).suffix.lower()
        if suffix not in (".npz", ".pvd"):
            raise InputError(f"--output {args.output}: give a name that ends in .npz or .pvd")
        outputs.append(args.output)
        if suffix == ".pvd":
            from bulgefit.report.paraview import piece_names

            outputs += piece_names(args.output, count)
    if args.picture is not None:
        if Path(args.picture).suffix.lower() != ".png":
            raise InputError(f"--picture {args.picture}: give a name that ends in .png")
        outputs.append(args.picture)
    for path in outputs:
        check_output(path, args.force)
    _common.check_outputs(args, files_read([args.mesh, args.from_file]), outputs)


def _write_shapes(args: argparse.Namespace, mounting: Mounting, result: Simulation) -> None:
    if args.output is None:
        return
    if Path(args.output).suffix.lower() == ".npz":
        _write_arrays(args, mounting, result)
    else:
        from bulgefit.report.paraview import write_paraview

        write_paraview(result, args.output, force=args.force)


def _draw(args: argparse.Namespace, result: Simulation, pressure: float) -> None:
    """The shape at the last pressure given (bar)."""
    if args.picture is None:
        return
    from bulgefit.report.fields import plot_fields

    plot_fields(
        result.membrane.reference,
        result.mesh.cells,
        result.displacement[-1],
        args.picture,
        title=f"{pressure:g} bar, {_described(result)}",
        force=args.force,
    )


def _mounted(mounting: Mounting, result: Simulation) -> dict[str, Any]:
    """Radius, ellipticity and the warp's angle, as a bulge test keeps them."""
    import numpy as np

    warp = {"warp_angle": np.float64(mounting.angle)} if mounting.angle else {}
    if mounting.semi_axes is None:
        return {"radius": np.float64(result.membrane.radius), **warp}
    oval = np.float64(mounting.ellipticity)
    return {"radius": np.float64(mounting.radius), "ellipticity": oval, **warp}


def _write_arrays(args: argparse.Namespace, mounting: Mounting, result: Simulation) -> None:
    import io

    import numpy as np

    from bulgefit.files import atomic_write_bytes

    buffer = io.BytesIO()
    np.savez(
        buffer,
        allow_pickle=False,
        pressure=result.pressure,
        nodes=result.mesh.nodes,
        cells=result.mesh.cells,
        reference=result.membrane.reference,
        displacement=result.displacement,
        **_mounted(mounting, result),
        thickness=np.float64(result.membrane.thickness),
        poisson_ratio=np.float64(result.material.constants()["nu12"]),
    )
    atomic_write_bytes(args.output, buffer.getvalue(), args.force)


def _payload(
    args: argparse.Namespace, mounting: Mounting, result: Simulation, pressures: list[float]
) -> dict[str, Any]:
    mesh = result.mesh
    return {
        "pressure_bar": pressures,
        "apex_mm": result.apex,
        "factorisations": result.factorisations,
        "seconds": round(result.seconds, 6),
        "stable": result.stable,
        "elliptic": result.elliptic,
        "wrinkled_points": result.wrinkled,
        "error_estimate_mm": result.error,
        "mesh_corrected": result.mesh_corrected,
        "mesh_error_taken_off_mm": result.mesh_error_taken_off,
        "mesh_error_mm": result.mesh_error,
        "material": result.material.kind,
        "parameters": _common.named_values(result.material),
        "law": result.membrane.law,
        "relaxation": result.membrane.relaxation,
        **(
            {"radius_mm": result.membrane.radius}
            if mounting.semi_axes is None
            else {"semi_axes_mm": mounting.semi_axes}
        ),
        "thickness_mm": result.membrane.thickness,
        "angle_degree": mounting.angle,
        "mesh": {
            "source": args.mesh or "bulgefit's O-grid",
            "nodes": len(mesh.nodes),
            "cells": len(mesh.cells),
            "gauss_points": 4 * len(mesh.cells),
            "apex_node": mesh.apex,
        },
        "units": {
            "pressure_bar": "bar",
            "apex_mm": "mm",
            "error_estimate_mm": "mm",
            "mesh_error_taken_off_mm": "mm",
            "mesh_error_mm": "mm",
            "seconds": "s",
            "radius_mm" if mounting.semi_axes is None else "semi_axes_mm": "mm",
            "thickness_mm": "mm",
            "angle_degree": "degree",
        },
        "versions": _common.versions(),
    }


def _described(result: Simulation) -> str:
    parts = []
    for name, item in _common.named_values(result.material).items():
        parts.append(f"{name} = {item['value']:g}{after_value(item['unit'])}")
    return f"{result.membrane.law}, {', '.join(parts)}"


def _values(held: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Values of effects' parameters with their units."""
    from bulgefit.effects.registry import parameter_named

    return {
        name: {"value": value, "unit": parameter_named(name).unit} for name, value in held.items()
    }


def _with(held: Mapping[str, float]) -> list[str]:
    """A line for each effect that acts; of one with many values, such as a field, their number."""
    of: dict[str, list[str]] = {}
    for name, item in _values(held).items():
        effect, _, parameter = name.partition(".")
        text = f"{parameter} = {item['value']:g}{after_value(item['unit'])}"
        of.setdefault(effect, []).append(text)
    return [
        f"with {effect}: {', '.join(values) if len(values) <= _SHOWN else f'{len(values)} values'}"
        for effect, values in of.items()
    ]


def _table(
    mounting: Mounting, result: Simulation, pressures: list[float], held: Mapping[str, float]
) -> str:
    mesh, points = result.mesh, 4 * len(result.mesh.cells)
    clamp = f"radius {result.membrane.radius:g} mm"
    if mounting.semi_axes is not None:
        clamp = "semi-axes {:g}, {:g} mm".format(*mounting.semi_axes)
    lines = [
        _described(result),
        *_with(held),
        f"{len(mesh.nodes)} nodes, {len(mesh.cells)} cells, {clamp}, "
        f"thickness {result.membrane.thickness:g} mm",
        f"{'pressure':>10}  {'apex':>10}  {'wrinkled':>8}",
        f"{'bar':>10}  {'mm':>10}  {'%':>8}",
    ]
    lines += [
        f"{p:>10.6g}  {apex:>10.5f}  {100 * w / points:>8.3g}"
        for p, apex, w in zip(pressures, result.apex, result.wrinkled, strict=True)
    ]
    lines.append(f"{result.factorisations} factorisations, {result.seconds:.2f} s")
    if result.error > result.tolerance:
        off = plain(1000 * result.error, 2)
        lines.append(
            f"shapes may be off by {off} µm: where the path has a singular point no balanced one "
            "was found near by"
        )
    if result.mesh_error_taken_off is not None:
        taken, error = plain(1000 * result.mesh_error_taken_off, 2), result.mesh_error
        left = "what is left is not known" if error is None else f"{plain(1000 * error, 2)} µm left"
        lines.append(f"mesh: up to {taken} µm of its error taken off, {left}")
    if result.mesh_corrected is not None and not result.mesh_corrected.all():
        kept = [p for p, done in zip(pressures, result.mesh_corrected, strict=True) if not done]
        lines.append(
            f"mesh: its error stays in at {len(kept)} of {len(pressures)} pressures, the lowest of "
            f"them {min(kept):g} bar:\nother meshes have no such shape there"
        )
    if not result.elliptic.all():
        lost = [p for p, kept in zip(pressures, result.elliptic, strict=True) if not kept]
        lines.append(
            f"the law is not elliptic at {len(lost)} of {len(pressures)} pressures, the lowest of "
            f"them {min(lost):g} bar:\nbands of shear may form there, and shapes depend on the mesh"
        )
    if not result.stable:
        lines.append(
            "on this path the tangent is not positive definite somewhere: not all shapes are stable"
        )
    return "\n".join(lines)
