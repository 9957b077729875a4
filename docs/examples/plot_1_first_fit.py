"""
A first fit
===========

One test goes in, three moduli come out, each with what it is worth.
"""

from pathlib import Path

import bulgefit

# %%
# The test
# --------
# The example that comes with bulgefit was made with E1 = 330, E2 = 240 and G12 = 30 MPa and noise,
# so we know what has to come out. `read_test` takes your own files just as well: see the next
# example.
here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
test = bulgefit.read_test(home / "data" / "example_bulge.npz")
print(test)

# %%
# The fit
# -------
# Bounds and starts come from the test itself: the height of the apex gives E times thickness.
# `e_w` is the objective that found physical moduli in the published study: mean deviations of dx,
# dy and dz, with dz weighted down to the size of the other two.
result = bulgefit.fit(test, "e_w", starts=2)
print(result.report())

# %%
# What to read first
# ------------------
# The first lines say what the result is worth: a misfit at the size of the noise means that the
# model and the test agree as well as they can. The intervals contain the noise, what is left of
# the misfit, and the remainder of the mesh's error.
truth = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
for name, true in truth.items():
    low, high = result.uncertainty.interval95[name]
    print(f"{name}: {result.material.values[name]:.2f} MPa, 95 % from {low:.2f} to {high:.2f}")
    assert abs(result.material.values[name] - true) < 5e-3 * true

assert 0.9 < result.quality.misfit_over_noise < 1.1

# %%
# Where model and test stand
# --------------------------
# Measured profiles (markers) and what the fit makes of them (lines).
prediction = bulgefit.predict(test, result.material).blocks
profiles = bulgefit.plot_profiles(test, prediction)

# %%
# What is left, measured minus modelled, looks like noise.
residuals = bulgefit.plot_residuals(test, prediction)
