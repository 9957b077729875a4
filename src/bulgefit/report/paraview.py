"""How does ParaView see a simulation? A .pvd that lists one .vtu a pressure."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from bulgefit.files import atomic_write_bytes, atomic_write_text, check_output

if TYPE_CHECKING:
    from bulgefit.model.simulation import Simulation

__all__ = ["piece_names", "write_paraview"]


def piece_names(path: str | os.PathLike[str], count: int) -> list[Path]:
    """The .vtu files beside NAME.pvd: NAME_0000.vtu, NAME_0001.vtu, ..."""
    pvd = Path(path)
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
    pieces = piece_names(path, len(simulation.pressure))
    for target in (path, *pieces):
        check_output(target, force)
    lines = []
    order = np.argsort(simulation.pressure, kind="stable")
    for i in order:
        grid = _grid(simulation, int(i))
        atomic_write_bytes(pieces[i], _encoded(grid), force)
        bar = f'timestep="{10 * simulation.pressure[i]:.10g}"'
        lines.append(f'    <DataSet {bar} part="0" file={quoteattr(pieces[i].name)}/>')
    atomic_write_text(
        path,
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(lines)
        + "\n  </Collection>\n</VTKFile>\n",
        force,
    )


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
