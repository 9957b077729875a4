"""
Without any model
=================

Strain, curvature and mean tension stand in the measured points and the pressure alone. They are
the first thing to look at, and what a model has to meet.
"""

from pathlib import Path

import numpy as np

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
test = bulgefit.read_test(home / "data" / "example_bulge.npz")
found = bulgefit.measure(test)
print(found)

# %%
# The apex
# --------
# What balances the pressure is the mean tension p/(k_xx + k_yy); how it is shared between warp and
# fill no shape can tell.
apex = bulgefit.plot_apex(found)

# %%
# Rings
# -----
# Between rings the balance along z gives the tension of the meridians, for any fabric.
rings = bulgefit.plot_rings(found)

# %%
# The material that the test was made with is met within the errors.
material = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
blank = np.zeros_like(test.blocks[0].displacement)
made = bulgefit.BulgeTest.from_arrays(
    test.blocks[0].reference,
    bulgefit.predict(test, material).displacement,
    test.pressure,
    radius=test.radius,
    thickness=test.thickness,
)
true = bulgefit.measure(made, window=found.window).apex
for index, name in enumerate(("warp", "fill")):
    strain, noise = found.apex.strain[-1, 0, index], found.apex.strain_noise[-1, 0, index]
    print(f"strain along {name}: {100 * strain:.3f} ± {100 * noise:.3f} %")
    assert abs(strain - true.strain[-1, 0, index]) < 5.0 * noise
