"""How does ParaView see a simulation, or a test? A .pvd that lists one .vtu a pressure."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.given import GivenTest, given_test
from bulgefit.errors import needed
from bulgefit.files import as_path, atomic_write_bytes, atomic_write_text, check_output
from bulgefit.model.simulation import Simulation
from bulgefit.report.cloud import FIELDS, Cloud

__all__ = ["piece_names", "write_paraview", "write_test_paraview"]


#: Points of the least surface.
_FEWEST_POINTS = 4


def piece_names(path: str | os.PathLike[str], count: int) -> list[Path]:
    """The .vtu files beside NAME.pvd: NAME_0000.vtu, NAME_0001.vtu, ..."""
    pvd = as_path(path)
    return [pvd.with_name(f"{pvd.stem}_{i:04d}.vtu") for i in range(count)]


def write_paraview(
    simulation: Simulation, path: str | os.PathLike[str], *, force: bool = False
) -> None:
    """Write the shapes of a simulation for ParaView; its time is the pressure in bar.

    Points carry `displacement` (mm; the points themselves are not moved, use Warp By Vector);
    cells carry what `Simulation.cell_fields` gives. The .pvd is written last, so where it stands
    all its pieces do.

    Parameters
    ----------
    simulation : Simulation
    path : path
        NAME.pvd.
    force : bool
        Whether files that exist may be replaced.
    """
    needed(simulation, Simulation, "what bulgefit.simulate gives")
    order = np.argsort(simulation.pressure, kind="stable").tolist()
    _write(path, simulation.pressure, order, lambda i: _grid(simulation, i), force)


def write_test_paraview(
    test: GivenTest,
    path: str | os.PathLike[str],
    *,
    prediction: Sequence[NDArray[np.floating]] | None = None,
    window: float | None = None,
    force: bool = False,
) -> None:
    """Write a test, a model of it and their difference for ParaView; its time is the pressure, bar.

    Points carry `displacement_mm` (the points themselves are not moved, use Warp By Vector) and
    strain, curvature, tension and stress as `measure` tells them, with their units in their names
    (NaN where they are not told); with a prediction also `modelled_mm` and `residual_mm`, measured
    minus modelled.

    Parameters
    ----------
    test : BulgeTest or path
        Frames whose points make no surface are left out.
    path : path
        NAME.pvd; the .vtu files NAME_0000.vtu, ... stand beside it.
    prediction : sequence of (k, n, 3) arrays, mm, optional
        One array for every block of the test.
    window : float, mm, optional
        By default as `measure` chooses it.
    force : bool
        Whether files that exist may be replaced.

    Raises
    ------
    InputError
        A prediction of another test, or files that cannot be written.
    """
    test = given_test(test)
    cloud = Cloud(test, None if prediction is None else tuple(prediction), window)
    order = np.argsort(test.pressure, kind="stable").tolist()
    shown = [i for i in order if len(cloud.part(i)[0]) >= _FEWEST_POINTS]
    _write(path, test.pressure, shown, lambda i: _test_grid(cloud, i), force)


def _write(
    path: str | os.PathLike[str],
    pressure: NDArray[np.floating],
    order: Sequence[int],
    grid_of: Callable[[int], Any],
    force: bool,
) -> None:
    pieces = piece_names(path, len(pressure))
    for target in (path, *pieces):
        check_output(target, force)
    lines = []
    for i in order:
        atomic_write_bytes(pieces[i], _encoded(grid_of(i)), force)
        bar = f'timestep="{10 * pressure[i]:.10g}"'
        lines.append(f'    <DataSet {bar} part="0" file={quoteattr(pieces[i].name)}/>')
    atomic_write_text(
        path,
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(lines)
        + "\n  </Collection>\n</VTKFile>\n",
        force,
    )


def _test_grid(cloud: Cloud, frame: int) -> Any:
    import pyvista

    reference, moved, model = cloud.part(frame)
    triangles = cloud.triangles(frame)
    cells = np.hstack([np.full((len(triangles), 1), 3), triangles])
    types = np.full(len(triangles), pyvista.CellType.TRIANGLE, dtype=np.uint8)
    grid = pyvista.UnstructuredGrid(cells.ravel(), types, reference)
    grid.point_data["displacement_mm"] = moved
    if model is not None:
        grid.point_data["modelled_mm"] = model
        grid.point_data["residual_mm"] = moved - model
    for name, unit in FIELDS.items():
        if not name.startswith("d"):
            named = name if unit == "1" else f"{name}_{unit.replace('/', '_per_')}"
            grid.point_data[named.replace("_1_per", "_per")] = cloud.value(name, frame)
    return grid


def _grid(simulation: Simulation, index: int) -> Any:
    import pyvista

    mesh = simulation.mesh
    count = len(mesh.cells)
    cells = np.hstack([np.full((count, 1), 4), mesh.cells])
    types = np.full(count, pyvista.CellType.QUAD, dtype=np.uint8)
    grid = pyvista.UnstructuredGrid(cells.ravel(), types, simulation.membrane.reference)
    grid.point_data["displacement"] = simulation.displacement[index]
    for name, values in simulation.cell_fields(index).items():
        unit = "_MPa" if name.startswith("stress") else ""
        grid.cell_data[name + unit] = values
    return grid


def _encoded(grid: Any) -> bytes:
    """The .vtu in memory, so that a full disk is our error and not a line VTK prints."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.WriteToOutputStringOn()
    writer.SetDataModeToBinary()
    writer.Write()
    return str(writer.GetOutputString()).encode()
