"""
Your own export
===============

What a DIC system exports is read as it is: which system wrote it is seen in the content. Here a
folder of comma-separated files is written as one would be, read, looked at, mended and fitted.
"""

import tempfile
from pathlib import Path

import numpy as np

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
made = bulgefit.read_test(home / "data" / "example_bulge.npz")
(block,) = made.blocks

# %%
# A folder of one file a frame
# ----------------------------
# Positions and displacements in mm, a row for each point. This camera counted y downwards, which
# happens often: the file says nothing of it.
folder = Path(tempfile.mkdtemp()) / "export"
folder.mkdir()
for frame, displacement in enumerate(block.displacement):
    table = np.hstack([block.reference, displacement]) * [1, -1, 1, 1, -1, 1]
    np.savetxt(
        folder / f"frame_{frame:02d}.csv",
        table[np.isfinite(table).all(axis=1)],
        delimiter=",",
        header="x,y,z,dx,dy,dz",
        comments="",
        fmt="%.5f",
    )
names = [f"frame_{frame:02d}.csv" for frame in range(len(made.pressure))]
rows = [f"{name},{10 * p:.4f}" for name, p in zip(names, made.pressure, strict=True)]
(folder / "pressure.csv").write_text("\n".join(["file,pressure_bar", *rows]) + "\n")

# %%
# Read
# ----
# A file rarely says what the clamp was: radius and thickness are yours to give.
test = bulgefit.read_test(folder, radius=100.0, thickness=0.81)
print(len(test.pressure), "frames from", 10 * test.pressure[0], "to", 10 * test.pressure[-1], "bar")
assert np.allclose(test.pressure, made.pressure, atol=1e-5)

# %%
# Fit
# ---
# A fabric whose warp and fill lie along x and y does not mind a mirrored axis, so the moduli are
# the same; with a turned warp they would not be. Positions and displacements are mirrored alike, so
# `bulgefit convert export test.npz --radius 100 --thickness 0.81 --flip y,dy` mends the file.
result = bulgefit.fit(test, starts=1)
print(result.report())
assert abs(result.material.values["E1"] - 330.0) < 1.0
assert abs(result.material.values["E2"] - 240.0) < 1.0
