"""
Reading a diagnosis
===================

The clamp of this test slips, and the model does not know it. Where does it miss, and why?
"""

from pathlib import Path

import numpy as np

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
whole = bulgefit.read_test(home / "data" / "example_slip.npz")

# %%
# Every third point and every second frame is enough here.
(block,) = whole.blocks
test = bulgefit.BulgeTest.from_arrays(
    block.reference[::3],
    block.displacement[::2, ::3],
    whole.pressure[::2],
    name="slips",
    radius=whole.radius,
    thickness=whole.thickness,
)

# %%
# A fit alone
# -----------
# E1 and E2 look like moduli, some per cent off: the cloth was made with E1 = 352.1, E2 = 181.4 and
# G12 = 12.4 MPa. The first lines say that they are no result: G12 ends at its bound, the misfit is
# some twenty times the noise, and nearly all of it is structure. What causes it they do not say.
alone = bulgefit.fit(test, starts=1)
print(alone.report())
assert "at_bound" in {warning.code for warning in alone.quality.warnings}
assert alone.quality.misfit_over_noise > 10.0

# %%
# The diagnosis
# -------------
# All known effects are freed together under what is physically plausible, beside a field for each
# place of the test (cloth, clamp, shape, load, cameras), and dropped again one by one as long as
# the evidence rises. What is left is sure, or said not to be.
found = bulgefit.diagnose(test)
print(found.verdict)
for cause in found.causes:
    print(f"{cause.effect}: probability {cause.probability:.3f}")
    for name, parameter in cause.parameters.items():
        value, stderr, unit = (parameter[key] for key in ("value", "stderr", "unit"))
        print(f"   {name} {value:.4g} ± {stderr:.2g} {unit}")

assert found.verdict == "named"
assert [cause.effect for cause in found.causes] == ["clamp_slip"]

# %%
# Where the model without it misses, and what the cause takes off the gap: down to the noise.
where = found.plot("where", after=False)
budget = found.plot("budget")
gaps = found.gaps
assert gaps["baseline"]["e_w"] > 3.0 * gaps["noise_floor"]["e_w"]
assert gaps["explained"]["e_w"] < 1.1 * gaps["noise_floor"]["e_w"]

# %%
# A fit with the cause
# --------------------
# Now the moduli are those of the cloth.
result = bulgefit.fit(test, effects=["clamp_slip"], starts=1)
print(result.report())

truth = {"E1": 352.1, "E2": 181.4, "G12": 12.4}
for name, true in truth.items():
    low, high = result.uncertainty.interval95[name]
    assert abs(result.material.values[name] - true) < 2.0 * (high - low)
assert np.isclose(result.effects["clamp_slip.compliance"], 0.0321, rtol=0.02)
