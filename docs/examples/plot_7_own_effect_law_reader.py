"""
Your own effect, law and reader
===============================

What your lab has and bulgefit does not know comes from a package of your own: a class, an object
or a function, and one line that names it. :doc:`/own_package` explains the package that is used
here; ``pip install docs/own_package`` would install it, this script only puts it where Python
finds it.
"""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
package = home / "docs" / "own_package"

# %%
# What pip would write: the name, and the three lines that name what the package brings.
place = Path(tempfile.mkdtemp())
described = tomllib.loads((package / "pyproject.toml").read_text())["project"]
information = place / "bulge_lab-1.0.dist-info"
information.mkdir()
(information / "METADATA").write_text("Metadata-Version: 2.1\nName: bulge-lab\nVersion: 1.0\n")
brought = ""
for group, names in described["entry-points"].items():
    brought += f"[{group}]\n" + "".join(f"{name} = {where}\n" for name, where in names.items())
(information / "entry_points.txt").write_text(brought)
print(brought)

paths = [str(place), str(package), str(Path(bulgefit.__file__).parents[1])]
environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def command(*words):
    """What a verb of the command line prints."""
    done = subprocess.run(
        [sys.executable, "-m", "bulgefit", *map(str, words)],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


# %%
# The reader
# ----------
# A rig that writes JSON, here with a test whose chamber gets less pressure than the gauge says.
rng = np.random.default_rng(7)
points = rng.uniform(-92.0, 92.0, (250, 3)) * [1.0, 1.0, 0.0]
points = points[np.hypot(points[:, 0], points[:, 1]) < 92.0]
loss, bar = 0.03, 0.1
recorded = np.array([0.02, 0.05, 0.1, 0.15, 0.2])  # MPa
blank = np.zeros((len(recorded), len(points), 3))
inside = bulgefit.BulgeTest.from_arrays(points, blank, recorded * (1.0 - loss * recorded / bar))
seen = bulgefit.predict(inside, {"E1": 330.0, "E2": 240.0, "G12": 30.0}).displacement
seen = seen + rng.normal(0.0, 0.002, blank.shape)
file = place / "test.rig"
images = [{"mbar": 1e4 * p, "moved": u.tolist()} for p, u in zip(recorded, seen, strict=True)]
file.write_text(json.dumps({"clamp_mm": [100, 0.81], "points": points.tolist(), "images": images}))
print(command("info", file))

# %%
# The effect
# ----------
found = json.loads(
    command("fit", file, "--with", "hose_lag", "--starts", 1, "--json", "-", "--quiet")
)["parameters"]["hose_lag.loss"]
print(found)
assert abs(found["value"] - loss) < 4.0 * found["stderr"]

# %%
# The law
# -------
apex = {}
for law in ("svk", "fung"):
    words = "simulate --E 1.2 --nu 0.45 --pressure 0.05 --refine 2 --json - --quiet --law"
    apex[law] = json.loads(command(*words.split(), law))["apex_mm"][0]
print(apex, "mm")
assert apex["fung"] < apex["svk"]
