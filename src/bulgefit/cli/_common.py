"""What do the verbs share? Options for material, solver and output, and how they are used."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from bulgefit.cli.streams import say
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from bulgefit.fem.mesh import Mesh
    from bulgefit.model.parameters import Material

__all__ = [
    "add_json_arguments",
    "add_material_arguments",
    "add_mesh_error_argument",
    "add_scheduler_argument",
    "add_solver_arguments",
    "add_workers_argument",
    "check_outputs",
    "deliver",
    "executor_from",
    "load_mesh",
    "material_from",
    "may_replace",
    "mesh_from",
    "named_values",
    "prints_json",
    "progress",
    "run_of",
    "solver_options",
    "step",
    "versions",
    "warn_of_moduli",
    "workers_from",
    "write_json",
]

#: Version of the JSON of verbs whose results tell no version of their own.
FORMAT = 1
#: nu12 where neither the command nor a test gives one: the published study's.
USUAL_POISSON_RATIO = 0.24
#: Law where neither the command nor what --from found gives one.
USUAL_LAW = "hencky"

_ORTHOTROPIC = {
    "E1": ("MPa", "modulus along warp (x)"),
    "E2": ("MPa", "modulus along fill (y)"),
    "G12": ("MPa", "shear modulus"),
    "nu12": ("RATIO", "contraction along fill under tension along warp, no unit"),
}
_ISOTROPIC = {
    "E": ("MPa", "isotropic modulus, instead of E1, E2 and G12"),
    "nu": ("RATIO", "isotropic Poisson's ratio, 0 <= nu < 0.5, no unit"),
    "G": ("MPa", "isotropic shear modulus; gives nu = E/2G - 1"),
}
#: Endings of measured tests, which a result never replaces.
_OF_TESTS = (".npz", ".npy", ".h5", ".hdf5", ".csv")
_WAYS = "--E1 --E2 --G12 [--nu12], or --E [--nu], or --E --G"


def add_material_arguments(
    parser: argparse.ArgumentParser, poisson_default: str = f"{USUAL_POISSON_RATIO:g}"
) -> None:
    """Add --E1 --E2 --G12 --nu12, --E --nu and --G."""
    group = parser.add_argument_group("material", f"moduli in MPa (1 GPa = 1000 MPa); give {_WAYS}")
    for name, (unit, meaning) in {**_ORTHOTROPIC, **_ISOTROPIC}.items():
        default = f" (default: {poisson_default})" if name.startswith("nu") else ""
        group.add_argument(f"--{name}", type=float, metavar=unit, help=meaning + default)


def material_from(args: argparse.Namespace, poisson_ratio: float = USUAL_POISSON_RATIO) -> Material:
    """The material that the options name.

    Parameters
    ----------
    args : Namespace
    poisson_ratio : float
        Taken where neither --nu12, --nu nor --G is given.

    Raises
    ------
    InputError
        Options are missing, do not go together, or are not admissible.
    """
    from bulgefit.model.parameters import material

    given = {
        name: getattr(args, name)
        for name in (*_ORTHOTROPIC, *_ISOTROPIC)
        if getattr(args, name) is not None
    }
    if not given:
        raise InputError(f"no material: give {_WAYS} (MPa)")
    ours, others = ([f"--{n}" for n in given if n in names] for names in (_ORTHOTROPIC, _ISOTROPIC))
    if ours and others:
        raise InputError(f"{ours[0]} and {others[0]} do not go together: give {_WAYS}")
    needed: tuple[str, ...]
    if ours:
        kind, needed, given = "orthotropic", ("E1", "E2", "G12"), {"nu12": poisson_ratio, **given}
    elif "G" in given:
        if "nu" in given:
            raise InputError("--nu and --G do not go together: G gives nu = E/2G - 1")
        kind, needed = "isotropic-EG", ("E", "G")
    else:
        kind, needed, given = "isotropic", ("E",), {"nu": poisson_ratio, **given}
    missing = [f"--{name}" for name in needed if name not in given]
    if missing:
        raise InputError(f"{' and '.join(missing)} missing: give {_WAYS} (MPa)")
    return material(kind, **given)


def add_law_argument(group: argparse._ArgumentGroup, *, found: bool = False) -> None:
    """Add --law.

    Parameters
    ----------
    found : bool
        Where --from may say it, it is None unless given.
    """
    group.add_argument(
        "--law",
        default=None if found else USUAL_LAW,
        metavar="LAW",
        help="stress linear in the logarithmic strain (hencky), in the Green-Lagrange strain (svk) "
        "or in the strains of the yarns and their angle (yarn), or the law of another package by "
        f"its name (default: {'that of --from, else ' if found else ''}{USUAL_LAW})",
    )


def add_mesh_error_argument(
    group: argparse._ActionsContainer, stays: str = "that of a --mesh stays"
) -> None:
    """Add --keep-mesh-error; `stays` says which errors are never taken off."""
    group.add_argument(
        "--keep-mesh-error",
        action="store_true",
        help="do not take the error of bulgefit's own mesh off (default: it is estimated from a "
        f"finer mesh and taken off; {stays})",
    )


def add_solver_arguments(parser: argparse.ArgumentParser, *, found: bool = False) -> None:
    """Add --law, --mesh, --refine, --no-relaxation and --linear-solver.

    Parameters
    ----------
    found : bool
        Whether --from may say the law.
    """
    group = parser.add_argument_group("solver")
    add_law_argument(group, found=found)
    group.add_argument(
        "--mesh",
        metavar="FILE.npz",
        help="mesh of Q4 cells: arrays nodes (n, 2) in mm and cells (m, 4) counted from 0 "
        "(default: bulgefit's own O-grid)",
    )
    group.add_argument(
        "--refine",
        type=int,
        metavar="N",
        help="size of bulgefit's own mesh, 57 N² cells (default: 4, 912 cells)",
    )
    group.add_argument(
        "--no-relaxation",
        dest="relaxation",
        action="store_false",
        help="let the fabric carry compression instead of wrinkling (default: it wrinkles)",
    )
    group.add_argument(
        "--linear-solver",
        metavar="NAME",
        help="force a linear solver by name (default: the fastest for the mesh's size)",
    )


def solver_options(args: argparse.Namespace) -> dict[str, Any]:
    """Keyword arguments `law`, `relaxation` and `linear_solver` that the options stand for."""
    return {
        "law": args.law,
        "relaxation": args.relaxation,
        "linear_solver": args.linear_solver,
    }


def mesh_from(args: argparse.Namespace, radius: float) -> Mesh:
    """The mesh of --mesh, or bulgefit's own for a clamp `radius` (mm)."""
    from bulgefit.fem.mesh import DEFAULT_REFINE, disc

    if args.mesh is None:
        return disc(radius, DEFAULT_REFINE if args.refine is None else args.refine)
    if args.refine is not None:
        raise InputError("--mesh and --refine do not go together: --refine is for bulgefit's mesh")
    return load_mesh(args.mesh)


def load_mesh(path: str) -> Mesh:
    """Read the arrays `nodes` and `cells` of an npz.

    Raises
    ------
    InputError
        The file is missing, is no npz, lacks the arrays, or they are no mesh.
    """
    import numpy as np

    from bulgefit.fem.mesh import Mesh

    try:
        # opened here, since np.load leaves a file open that is no archive
        with open(path, "rb") as file:
            archive = np.load(file, allow_pickle=False)
            if isinstance(archive, np.ndarray):
                raise InputError(f"{path}: is one array; a mesh is an npz with nodes and cells")
            with archive:
                missing = [key for key in ("nodes", "cells") if key not in archive.files]
                if missing:
                    found = ", ".join(archive.files) or "nothing"
                    raise InputError(
                        f"{path}: not a mesh, it has no {' and no '.join(missing)}; found {found}"
                    )
                nodes, cells = archive["nodes"], archive["cells"]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or 'not an npz'})") from error
    except (InputError, MemoryError):
        raise
    except Exception as error:  # a damaged header can raise nearly anything
        raise InputError(f"{path}: not an npz file with nodes and cells") from error
    for key, array in (("nodes", nodes), ("cells", cells)):
        held = getattr(array, "dtype", np.dtype(bytes))  # numpy gives out no arrays as bytes
        if held.kind not in ("iu" if key == "cells" else "fiu"):
            raise InputError(f"{path}: {key} holds {held}, not numbers of the right kind")
    try:
        return Mesh.from_arrays(nodes, cells)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def add_json_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --json FILE|- and --force."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "--json",
        metavar="FILE",
        help="write the result as JSON; - prints the JSON alone (default: a table)",
    )
    group.add_argument(
        "--force", action="store_true", help="replace files that exist (default: refuse)"
    )


def prints_json(args: argparse.Namespace) -> bool:
    """Whether stdout belongs to the JSON."""
    return bool(args.json == "-")


def check_outputs(
    args: argparse.Namespace, inputs: Iterable[Path], others: Iterable[str | Path] = ()
) -> None:
    """Refuse outputs that cannot be, before the work for them is done.

    Parameters
    ----------
    args : Namespace
        Of which --json is checked.
    inputs : iterable of paths
        The files that are read, and must not be replaced.
    others : iterable of paths
        Further outputs, whose names alone are checked: each must be another's.
    """
    from bulgefit.files import check_apart, check_output

    outputs = [*others]
    if args.json is not None and not prints_json(args):
        check_output(args.json, may_replace(args, args.json))
        outputs.append(args.json)
    check_apart(outputs, inputs)
    if args.json is not None and os.path.splitext(args.json)[1].lower() in _OF_TESTS:
        raise InputError(f"--json {args.json}: is named as a test is; name a file as x.json")


def may_replace(args: argparse.Namespace, output: str | Path) -> bool:
    """Whether an output that exists may be replaced: by --force, or by the run that goes on.

    Parameters
    ----------
    args : Namespace
    output : path
        As its option names it, a file or a folder.
    """
    return bool(args.force) or os.path.realpath(output) in getattr(args, "begun", ())


def deliver(
    args: argparse.Namespace, payload: Mapping[str, Any], text: str, *works: Callable[[], None]
) -> None:
    """Write --json FILE, do the other works, and print; what fails keeps back none of the rest.

    Parameters
    ----------
    payload : mapping
        The result for scripts, as `write_json` takes it.
    text : str
        The result to read, printed unless --json - asks for the payload there.
    works : callables
        They write further files. Printing comes last, since a pipe that is closed ends all. Whoever
        was told to end while more was computed has no time left for them.
    """
    if hasattr(args, "words"):  # a command line, and no part of one
        payload = {"format": FORMAT, **payload, "run": run_of(args)}
    if isinstance(sys.exc_info()[1], KeyboardInterrupt):
        works = ()
    with ExitStack() as rest:  # what is put first is done last
        if hasattr(args, "shown"):
            args.shown.end()
        if prints_json(args):
            rest.callback(write_json, payload, "-")
        else:
            rest.callback(print, text)
        for work in reversed(works):
            rest.callback(work)
        if args.json is not None and not prints_json(args):
            write_json(payload, args.json, may_replace(args, args.json))


def write_json(payload: Mapping[str, Any], target: str, force: bool = False) -> None:
    """Write a result as JSON; NaN becomes null.

    Parameters
    ----------
    payload : mapping
        May hold NumPy numbers and arrays.
    target : str
        A file, which appears whole or not at all; `-` is stdout.
    force : bool
        Whether a file that exists may be replaced.
    """
    # in ASCII, which every terminal and every file knows
    text = json.dumps(_plain(payload), indent=2, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        from bulgefit.files import atomic_write_text

        atomic_write_text(target, text, force)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays
        return _plain(value.tolist())
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def run_of(args: argparse.Namespace) -> dict[str, Any]:
    """How a result was made: command, date, versions, and how tests were read.

    The command is that of a shell; relative paths in it are from the folder it ran in.
    """
    import shlex

    from bulgefit.cli.tests_in import reading_of

    return {
        "command": shlex.join(["bulgefit", *args.words]),
        "date": args.began,
        "versions": versions(),
        "reading": reading_of(args),
    }


def named_values(material: Material) -> dict[str, dict[str, Any]]:
    """Parameters with their units, as every result shows them."""
    from bulgefit.model.parameters import parameters_of

    return {
        p.name: {"value": material.values[p.name], "unit": p.unit}
        for p in parameters_of(material.kind)
    }


def progress(args: argparse.Namespace, message: str) -> None:
    """Say on stderr what is going on, unless --quiet."""
    if not getattr(args, "quiet", False):
        say(f"{message}\n")


def warn_of_moduli(args: argparse.Namespace, material: Material, thickness: float) -> None:
    """Of moduli that no cloth of this thickness (mm) has, so that they may be in another unit."""
    from bulgefit.dic.suspicions.sizes import about_moduli

    moduli = {name: value for name, value in material.values.items() if name.startswith("E")}
    for one in about_moduli(thickness, moduli):
        progress(args, f"warning: {one.text}; {one.remedy}")


def add_workers_argument(parser: argparse.ArgumentParser) -> None:
    """Add --workers N."""
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="work on N processor cores at once (default: all that this process may use); the "
        "result does not depend on it",
    )


def workers_from(args: argparse.Namespace) -> int:
    """Number of workers."""
    if args.workers is None:
        usable = getattr(os, "sched_getaffinity", None)
        return len(usable(0)) if usable else os.cpu_count() or 1
    if args.workers < 1:
        raise InputError(f"--workers {args.workers}: give 1 or more")
    return int(args.workers)


def add_scheduler_argument(parser: argparse.ArgumentParser) -> None:
    """Add --scheduler ADDRESS, beside --workers."""
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="work on the workers of this Dask scheduler instead, which have the same versions "
        "installed; needs bulgefit[cluster] (default: this machine)",
    )


@contextmanager
def executor_from(args: argparse.Namespace, *, processes: bool = False) -> Iterator[Executor]:
    """The executor that --workers and --scheduler name, until the block ends.

    What it has done is shown meanwhile, unless --quiet.

    Parameters
    ----------
    processes : bool
        Processes instead of threads, where --workers of this machine do the work.

    Raises
    ------
    InputError
        Both were given, or no scheduler answers.
    """
    from bulgefit.cli.progress import Progress
    from bulgefit.parallel.spread import counted
    from bulgefit.parallel.workers import open_executor

    if args.scheduler is not None and args.workers is not None:
        raise InputError("--workers and --scheduler do not go together: a cluster has its own")
    workers = workers_from(args)
    with (
        open_executor(workers, args.scheduler, processes=processes) as executor,
        Progress(quiet=args.quiet) as args.shown,
        counted(args.shown.count),
    ):
        yield executor


def step(args: argparse.Namespace, what: str) -> None:
    """Show what is tried now by the executor of `executor_from`, unless --quiet."""
    args.shown.say(what)


def versions() -> dict[str, str]:
    """Versions of bulgefit, Python and what the numbers depend on."""
    import platform
    from importlib.metadata import version

    import bulgefit

    found = {"bulgefit": bulgefit.__version__, "python": platform.python_version()}
    return {**found, **{name: version(name) for name in ("numpy", "scipy", "numba")}}
