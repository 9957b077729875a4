"""The benchmark's case by CalculiX: python calculix_case.py CASE.npz -> one line of JSON.

M3D4 membranes, which CalculiX blows up into solids. Its `*ELASTIC` is Saint Venant-Kirchhoff under
NLGEOM. It cannot start from flat, so the mesh gets an imperfection of 0.1 mm.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

IMPERFECTION = 0.1  # mm


def deck(case: np.lib.npyio.NpzFile) -> str:
    """The input file: one step, automatic increments that stop at every level."""
    nodes, cells, levels = case["nodes"], case["cells"], case["levels"]
    e1, e2, g12, nu12 = case["constants"]
    radius2 = float(case["radius"]) ** 2
    apex = int(np.argmin((nodes**2).sum(axis=1))) + 1
    lines = ["*NODE, NSET=ALL"]
    for i, (x, y) in enumerate(nodes, start=1):
        z = IMPERFECTION * (1.0 - (x * x + y * y) / radius2)
        lines.append(f"{i}, {x:.12g}, {y:.12g}, {z:.12g}")
    lines.append("*ELEMENT, TYPE=M3D4, ELSET=FABRIC")
    lines += [f"{i}, " + ", ".join(str(n + 1) for n in c) for i, c in enumerate(cells, start=1)]
    lines.append("*NSET, NSET=RIM")
    lines += [f"{n + 1}," for n in case["rim"]]
    lines += [
        "*NSET, NSET=APEX",
        f"{apex},",
        "*BOUNDARY",
        "RIM, 1, 3",
        "*MATERIAL, NAME=CLOTH",
        "*ELASTIC, TYPE=ENGINEERING CONSTANTS",
        f"{e1:g}, {e2:g}, {e2:g}, {nu12:g}, 0., 0., {g12:g}, {g12:g},",
        f"{g12:g}, 293.",
        "*ORIENTATION, NAME=WARP",
        "1., 0., 0., 0., 1., 0.",
        "*MEMBRANE SECTION, ELSET=FABRIC, MATERIAL=CLOTH, ORIENTATION=WARP",
        f"{float(case['thickness']):g}",
    ]
    # increments stop at every level; the first ones, from nearly flat, have to be tiny
    times = [f"{level / levels[-1]:.12g}" for level in levels]
    lines += ["*TIME POINTS, NAME=LEVELS"]
    lines += [", ".join(times[i : i + 8]) + "," for i in range(0, len(times), 8)]
    lines += [
        f"*STEP, NLGEOM, INC={20 * len(levels)}",
        "*STATIC",
        f"1e-7, 1., 1e-12, {1.001 * float(levels[1] - levels[0]) / float(levels[-1]):.12g}",
        "*DLOAD",
        f"FABRIC, P1, {float(levels[-1]):.12g}",
        "*NODE PRINT, NSET=APEX, TIME POINTS=LEVELS",
        "U",
        "*END STEP",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the deck, run ccx, read the apex of the last level."""
    program = sys.argv[2] if len(sys.argv) > 2 else "ccx"
    version = subprocess.run([program, "-v"], capture_output=True, text=True).stdout.split()[-1]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bulge.inp").write_text(deck(np.load(sys.argv[1])))
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run(
            [program, "bulge"], cwd=folder, env=dict(os.environ), capture_output=True, text=True
        )
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = end.ru_utime - start.ru_utime + end.ru_stime - start.ru_stime
        if run.returncode:
            sys.exit(f"ccx stopped: {run.stdout[-300:]}")
        found = (Path(folder) / "bulge.dat").read_text()
    rows = re.findall(r"^\s+\d+((?:\s+[-+.\dE]+){3})\s*$", found, re.M)
    wanted = len(np.load(sys.argv[1])["levels"])
    if len(rows) != wanted:
        sys.exit(f"ccx solved {len(rows)} of {wanted} levels")
    answer = {
        "version": f"CalculiX {version}",
        "seconds": seconds,
        "iterations": len(re.findall(r"^\s*iteration\s+\d+", run.stdout, re.M)),
        "apex_mm": float(rows[-1].split()[2]) + IMPERFECTION,
    }
    print(json.dumps(answer))


main()
