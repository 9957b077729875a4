"""
Pictures of fields
==================

The measured surface in true scale, coloured by what was measured or by what is left; headless, as
on a server.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bulgefit

home = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "data").is_dir())
test = bulgefit.read_test(home / "data" / "example_slip.npz")


def framed(image):
    """A picture of `bulgefit.show`, without axes."""
    figure, panel = plt.subplots(figsize=(image.shape[1] / 150, image.shape[0] / 150))
    panel.imshow(image)
    panel.set_axis_off()
    figure.tight_layout(pad=0.0)


# %%
# Heights at the highest pressure
# -------------------------------
image = bulgefit.show(test)
framed(image)
assert image.ndim == 3
assert np.ptp(image) > 100

# %%
# Measured beside modelled
# ------------------------
# The clamp of this test slips, and the model knows of none: dx is missed towards the rim.
material = {"E1": 352.1, "E2": 181.4, "G12": 12.4}
prediction = bulgefit.predict(test, material).blocks
framed(bulgefit.show(test, field="dx", prediction=prediction))
