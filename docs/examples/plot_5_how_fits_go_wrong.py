"""
Four ways a fit goes wrong
==========================

A fit always returns numbers. Here the same test is spoilt in four ways that happen in labs, and
the first lines of each report say what happened. A fifth looks as bad and does no harm.
"""

from pathlib import Path

import numpy as np

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
test = bulgefit.read_test(home / "data" / "example_bulge.npz")
(block,) = test.blocks


def spoilt(
    name, reference=block.reference, displacement=block.displacement, pressure=test.pressure
):
    """The test with other arrays."""
    return bulgefit.BulgeTest.from_arrays(
        reference, displacement, pressure, name=name, radius=100.0, thickness=0.81
    )


def first_lines(test, bounds=None):
    """Codes of what looks wrong, and what a report says before its first modulus."""
    result = bulgefit.fit(test, starts=1, bounds=bounds)
    print(result.report().split("e_w =")[0])
    return {warning.code for warning in result.quality.warnings}, result


# %%
# Axes
# ----
# dx and dy changed places, the positions did not: an export whose columns were named by hand.
# No material moves like this: the fit runs into its bounds, and says that they are no result.
bounds = {"E1": (100, 1000), "E2": (100, 1000), "G12": (10, 200)}  # MPa
codes, _ = first_lines(spoilt("swapped", displacement=block.displacement[:, :, [1, 0, 2]]), bounds)
assert {"dx_dy_swapped", "at_bound"} <= codes

# %%
# Units
# -----
# The gauge counted in psi, the table was taken for bar: every modulus comes out 14.5 times too
# large, and the fit is as good as ever. Only what is known of fabrics tells.
codes, result = first_lines(spoilt("psi", pressure=test.pressure * 14.5))
print(result.material.values)
assert codes & {"pressure_size", "stiffness", "modulus"}
assert result.quality.misfit_over_noise < 1.1

# %%
# A dead gauge
# ------------
# From the middle of the test on the gauge kept its last value: the fabric goes on rising.
stuck = np.minimum(test.pressure, test.pressure[7])
codes, result = first_lines(spoilt("stuck", pressure=stuck))
assert "pressure_stuck" in codes
assert result.quality.misfit_over_noise > 10.0

# %%
# Not identifiable
# ----------------
# Three points about the apex hardly tell E1 from E2: the fabric is stretched along both yarns, and
# what one modulus lacks the other makes up for. Neither is known to better than some ten per cent.
near = np.argsort(np.hypot(block.reference[:, 0], block.reference[:, 1]))[:3]
codes, result = first_lines(
    spoilt("apex", reference=block.reference[near], displacement=block.displacement[:, near])
)
print(result.report())
assert "inseparable" in codes
for name in ("E1", "E2"):
    assert result.uncertainty.stderr[name] > 0.05 * result.material.values[name]

# %%
# No harm: half the field lost
# ----------------------------
# The right half was in the shade. Nothing is wrong with that: the moduli stay right, their
# intervals get wider.
seen = np.where(block.reference[:, :1] < 0.0, block.displacement, np.nan)
codes, result = first_lines(spoilt("half", displacement=seen))
whole = bulgefit.fit(test, starts=1)
for name, true in {"E1": 330.0, "E2": 240.0, "G12": 30.0}.items():
    error = result.uncertainty.stderr[name]
    print(f"{name}: {result.material.values[name]:.2f} ± {error:.2g} MPa")
    assert abs(result.material.values[name] - true) < 4.0 * error
    assert error > whole.uncertainty.stderr[name]
