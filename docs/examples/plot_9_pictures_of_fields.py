"""
Pictures of fields
==================

The measured surface in true scale, coloured by what was measured or by what is left; headless, as
on a server.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyvista

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
test = bulgefit.read_test(home / "data" / "example_slip.npz")

# %%
# Heights at the highest pressure
# -------------------------------
image = bulgefit.show(test)
assert image.shape == (640, 720, 3)

# %%
# Measured beside modelled
# ------------------------
# The clamp of this test slips, and the model knows of none: dx is missed towards the rim.
material = {"E1": 352.1, "E2": 181.4, "G12": 12.4}
prediction = bulgefit.predict(test, material).blocks
beside = bulgefit.show(test, field="dx", prediction=prediction)
(block,) = test.blocks
missed = np.abs(block.displacement[-1, :, 0] - prediction[0][-1, :, 0])
radius = np.hypot(block.reference[:, 0], block.reference[:, 1])
assert np.nanmean(missed[radius > 80.0]) > 5.0 * np.nanmean(missed[radius < 20.0])

# %%
# In ParaView, or in PyVista
# --------------------------
# Test, model and what is left go to files, a time step a pressure, that either of them reads. Here
# it is what the model misses of all three components, fortyfold.
with TemporaryDirectory() as folder:
    bulgefit.write_test_paraview(test, f"{folder}/slip.pvd", prediction=prediction)
    reader = pyvista.get_reader(f"{folder}/slip.pvd")
    reader.set_active_time_value(reader.time_values[-1])
    (grid,) = reader.read()
assert np.isclose(reader.time_values[-1], 10.0 * test.pressure[-1])  # bar
surface = grid.warp_by_vector("displacement_mm")
arrows = surface.glyph(orient="residual_mm", scale="residual_mm", factor=40.0, tolerance=0.03)

plotter = pyvista.Plotter(off_screen=True, window_size=(720, 480))
plotter.add_mesh(surface, color="lightgrey")
plotter.add_mesh(arrows, color="chocolate")
plotter.add_mesh(surface.extract_feature_edges(), color="dimgrey")
plotter.camera.zoom(1.4)
plotter.show()
