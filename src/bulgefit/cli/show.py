"""bulgefit show: what does the bulge look like, measured and modelled?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common
from bulgefit.cli._model import add_model_arguments, predicted_from
from bulgefit.cli.tests_in import add_reader_arguments, add_test_argument, files_read, tests_from
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest

__all__ = ["HELP", "add_arguments", "run"]

HELP = "picture, animation or ParaView files of a test, beside a model"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Draw the deformed surface of a bulge test in true scale, coloured by any field: a\n"
        "picture (.png), an animation of the inflation (.gif, .mp4), or files for ParaView (.pvd\n"
        "with one .vtu a frame). With a material the model stands beside the measurement in the\n"
        "same colours, and measured minus modelled, with colours about 0. No display is needed.\n"
        'An .mp4 needs pip install "bulgefit[movie]".'
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit show test.npz bulge.png --field strain_xx\n"
        "  bulgefit show test.npz bulge.gif\n"
        "  bulgefit show test.npz bulge.png --field dx --E1 303 --E2 229 --G12 30\n"
        "  bulgefit show test.npz bulge.pvd --from gap.json"
    )
    add_test_argument(parser)
    parser.add_argument("output", metavar="OUT", help="file to write: .png, .gif, .mp4 or .pvd")
    parser.add_argument(
        "--field",
        default="dz",
        metavar="NAME",
        help="dx, dy, dz, strain_xx, strain_yy, strain_xy, curvature_xx, curvature_yy, "
        "curvature_xy, tension or stress, and with a material residual_ before any of them "
        "(default: dz); a .pvd holds all",
    )
    parser.add_argument(
        "--frame",
        type=int,
        metavar="N",
        help="frame of a .png, counted from 0 (default: that of the highest pressure)",
    )
    parser.add_argument(
        "--window",
        type=float,
        metavar="MM",
        help="radius of the windows of strain, curvature, tension and stress (default: as bulgefit "
        "measure chooses it)",
    )
    add_model_arguments(parser)
    add_reader_arguments(parser)
    parser.add_argument(
        "--force", action="store_true", help="replace files that exist (default: refuse)"
    )


def run(args: argparse.Namespace) -> int:
    """Read, model where asked for, and draw."""
    suffix = Path(args.output).suffix.lower()
    if suffix not in (".png", ".gif", ".mp4", ".pvd"):
        raise InputError(f"{args.output}: give a name that ends in .png, .gif, .mp4 or .pvd")
    if args.frame is not None and suffix != ".png":
        raise InputError(f"--frame {args.frame}: is for a .png; a {suffix} holds all frames")
    from bulgefit.files import check_apart, check_output

    if suffix in (".png", ".pvd"):
        check_output(args.output, args.force)
    else:
        from bulgefit.report.films import check_film

        check_film(args.output, args.force)
    check_apart([args.output], files_read([args.test, args.from_file, args.pressure]))
    (test,) = tests_from(argparse.Namespace(**{**vars(args), "tests": [args.test]}))
    common: dict[str, Any] = {"window": args.window, "force": args.force}
    predicted = predicted_from(args, test)
    prediction = None if predicted is None else predicted.blocks
    _draw(args, suffix, test, common | {"prediction": prediction})
    _common.progress(args, f"wrote {args.output}")
    return 0


def _draw(args: argparse.Namespace, suffix: str, test: BulgeTest, common: dict[str, Any]) -> None:
    if suffix == ".pvd":
        from bulgefit.report.paraview import write_test_paraview

        write_test_paraview(test, args.output, **common)
        return
    from bulgefit.report.show import animate, show

    if suffix == ".png":
        show(test, args.output, field=args.field, frame=args.frame, **common)
    else:
        animate(test, args.output, field=args.field, **common)
