"""bulgefit measure: what does the measurement say of the fabric without any model?"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from bulgefit.cli import _common
from bulgefit.cli._model import add_model_arguments, has_model, predicted_from
from bulgefit.cli.tests_in import add_reader_arguments, add_test_argument, files_read, tests_from
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic.surface.measured import Measured
    from bulgefit.dic.surface.tables import Table

__all__ = ["HELP", "add_arguments", "run"]

HELP = "strain, curvature and stress as measured, without a model or beside one"

_TABLES = ("apex", "rings", "fields", "rim")
_FIGURES = ("apex", "rings", "fields")
#: Of what is told of a model beside the measurement.
_MODEL = "model_"
#: Lines of the printed table.
_LINES = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Strain (Hencky) and curvature of a bulge test from the measured points alone, by least\n"
        "squares over windows of them, and what balances the pressure: the mean tension\n"
        "p/(k_xx + k_yy) and stress at each place, and meridian and hoop tension around rings.\n"
        "Every number has its standard error by the noise of the test. Strain has no unit,\n"
        "curvature 1/mm, tension N/mm, stress MPa, pressure bar. With a material the same is told\n"
        "of its model, at the same points by the same windows."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit measure test.npz\n"
        "  bulgefit measure test.npz --window 20 --csv tables --plots figures\n"
        "  bulgefit measure test.npz --json -\n"
        "  bulgefit measure test.npz --from gap.json --plots figures"
    )
    add_test_argument(parser)
    parser.add_argument(
        "--window",
        type=float,
        metavar="MM",
        help="radius of the windows (default: the one with the smallest expected error)",
    )
    add_model_arguments(parser)
    add_reader_arguments(parser)
    _common.add_json_arguments(parser)
    parser.add_argument(
        "--csv",
        metavar="FOLDER",
        help=f"write {', '.join(f'{name}.csv' for name in _TABLES)} into this folder (made if "
        "needed)",
    )
    parser.add_argument(
        "--plots",
        metavar="FOLDER",
        help=f"draw {', '.join(f'{name}.png' for name in _FIGURES)} into this folder (made if "
        "needed)",
    )


def run(args: argparse.Namespace) -> int:
    """Measure, write, draw and print."""
    files = _files(args)
    _common.check_outputs(args, files_read([args.test, args.from_file, args.pressure]), files)
    (test,) = tests_from(argparse.Namespace(**{**vars(args), "tests": [args.test]}))

    from bulgefit.dic.surface.measured import measure

    found = measure(test, window=args.window)
    predicted = predicted_from(args, test)
    model = None if predicted is None else measure(predicted.as_test(), window=found.window)
    payload = {
        **found.to_dict(),
        **({} if model is None else {"model": _lists(_of_model(model))}),
        "source": test.source,
        "checksum": test.checksum,
        "versions": _common.versions(),
    }
    works = [partial(_write, args, found, model)] if files else []
    _common.deliver(args, payload, _table(found, model), *works)
    return 0


def _files(args: argparse.Namespace) -> list[Path]:
    """What --csv and --plots write; refused where it cannot be."""
    from bulgefit.files import check_folder, check_output

    files = []
    tables, figures = list(_TABLES), list(_FIGURES)
    if has_model(args):
        tables += [_MODEL + name for name in _TABLES]
        figures.append(f"{_MODEL}fields")
    for folder, names, suffix in ((args.csv, tables, "csv"), (args.plots, figures, "png")):
        if folder is None:
            continue
        check_folder(folder)
        named = [Path(folder) / f"{name}.{suffix}" for name in names]
        if Path(folder).is_dir():
            for path in named:
                check_output(path, args.force)
        files += named
    return files


def _write(args: argparse.Namespace, found: Measured, model: Measured | None) -> None:
    from bulgefit.files import atomic_write_text
    from bulgefit.report.measured import plot_apex, plot_measured, plot_rings

    if args.csv is not None:
        folder = _made(args.csv)
        tables = dict(found.tables())
        if model is not None:
            tables |= {_MODEL + name: table for name, table in _of_model(model).items()}
        for name, table in tables.items():
            rows = [",".join(table)]
            rows += [",".join(f"{v:.9g}" for v in row) for row in zip(*table.values(), strict=True)]
            text = "\n".join(rows) + "\n"
            atomic_write_text(folder / f"{name}.csv", text, args.force)
        _common.progress(args, f"wrote the tables of {found.name} into {folder}")
    if args.plots is not None:
        folder = _made(args.plots)
        plot_apex(found, folder / "apex.png", model=model, force=args.force)
        plot_rings(found, folder / "rings.png", model=model, force=args.force)
        plot_measured(found, folder / "fields.png", force=args.force)
        if model is not None:
            path = folder / f"{_MODEL}fields.png"
            plot_measured(model, path, label="model", force=args.force)
        _common.progress(args, f"drew {', '.join(_FIGURES)} into {folder}")


def _of_model(model: Measured) -> dict[str, Table]:
    """Its tables, without errors by a noise that it has not."""
    return {
        name: {column: values for column, values in table.items() if "_noise" not in column}
        for name, table in model.tables().items()
    }


def _lists(tables: dict[str, Table]) -> dict[str, dict[str, list[float]]]:
    """For JSON; fields stand in files alone, as those of the measurement do."""
    return {
        name: {column: values.tolist() for column, values in table.items()}
        for name, table in tables.items()
        if name != "fields"
    }


def _made(name: str) -> Path:
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    return folder


def _table(found: Measured, model: Measured | None) -> str:
    frames = len(found.pressure)
    some = f" ({_LINES} of {frames} frames; all in --csv)" if frames > _LINES else ""
    lines = [_noise(found), f"at the apex{some}:", *_apex(found)]
    if model is not None:
        lines += ["at the apex of the model, by the same windows:", *_apex(model, sure=False)]
    lines += [*_rings(found, int(found.pressure.argmax())), *_rim(found)]
    lines.append(
        "tension at the apex is the mean p/(k_xx + k_yy); how it differs between warp and fill is\n"
        "not told by the shape, but by a fit"
    )
    return "\n".join(lines)


def _apex(found: Measured, *, sure: bool = True) -> list[str]:
    """By pressure; a model is not unsure by any noise."""
    import numpy as np

    apex = found.apex
    lines = [
        f"{'bar':>8}{'strain xx':>20}{'strain yy':>20}{'radius, mm':>18}{'tension, N/mm':>20}"
        f"{'stress, MPa':>18}"
    ]
    order = np.argsort(found.pressure, kind="stable")
    shown = order[np.unique(np.linspace(0, len(order) - 1, _LINES).astype(int))]
    for i in shown:
        cells = [
            (apex.strain[i, 0, 0], apex.strain_noise[i, 0, 0], 5, 20),
            (apex.strain[i, 0, 1], apex.strain_noise[i, 0, 1], 5, 20),
        ]
        if found.pressure[i] <= 0.0:  # nothing is inflated: neither dome nor tension is told
            cells += [(np.nan, np.inf, 1, width) for width in (18, 20, 18)]
        else:
            radius = 2.0 / (apex.curvature[i, 0, 0] + apex.curvature[i, 0, 1])
            of_radius = radius * apex.tension_noise[i, 0] / apex.tension[i, 0]
            cells += [
                (radius, of_radius, 1, 18),
                (apex.tension[i, 0], apex.tension_noise[i, 0], 3, 20),
                (apex.stress[i, 0], apex.stress_noise[i, 0], 2, 18),
            ]
        told = (
            f"{_pair(value, error if sure else np.inf, digits):>{width}}"
            for value, error, digits, width in cells
        )
        lines.append(f"{10 * found.pressure[i]:>8.4g}" + "".join(told))
    return lines


def _noise(found: Measured) -> str:
    if found.noise is None:
        return f"{found.name}: windows of radius {found.window:.3g} mm; the noise is not known"
    sigma = ", ".join(f"{value:.2g}" for value in found.noise.sigma)
    return (
        f"{found.name}: windows of radius {found.window:.3g} mm; noise of dx, dy, dz {sigma} mm "
        f"by {found.noise.source}; ± is one standard error by that noise"
    )


def _rings(found: Measured, frame: int) -> list[str]:
    rings = found.rings
    lines = [f"around rings at {10 * found.pressure[frame]:.4g} bar (meridian, hoop):"]
    lines.append(f"{'radius, mm':>12}{'tension, N/mm':>22}{'':>20}{'strain':>20}")
    for i, radius in enumerate(rings.radius):
        pairs = zip(rings.tension[frame, i], rings.tension_noise[frame, i], strict=True)
        tension = "".join(f"{_pair(*pair, 3):>21}" for pair in pairs)
        pairs = zip(rings.strain[frame, i], rings.strain_noise[frame, i], strict=True)
        lines.append(f"{radius:>12.4g}" + tension + "".join(f"{_pair(*p, 5):>21}" for p in pairs))
    return lines if len(rings.radius) else []


def _rim(found: Measured) -> list[str]:
    import numpy as np

    if found.rim_rotation is None or found.rim_shift is None:
        return ["rim: too few points to tell its motion"]
    turn = np.rad2deg(np.nanmax(np.linalg.norm(found.rim_rotation, axis=1)))
    shift = np.nanmax(np.linalg.norm(found.rim_shift, axis=1))
    return [f"rim: turns by up to {turn:.3g} degrees and shifts by up to {shift:.3g} mm"]


def _pair(value: float, error: float, digits: int) -> str:
    if not abs(value) < float("inf"):
        return "-"
    sure = f" ± {error:.{digits}f}" if error < float("inf") else ""
    return f"{value:.{digits}f}{sure}"
