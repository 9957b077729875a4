"""
Several specimens of one cloth
==============================

Three discs of one cloth give three answers. Cross-validation says how well the moduli of two of
them predict the third.
"""

import numpy as np

import bulgefit

# %%
# Three made tests
# ----------------
# Specimens of one cloth differ by some per cent. These three are made by `bulgefit.predict`: the
# displacements that cameras would see of a given material, with noise.
rng = np.random.default_rng(6)
points = rng.uniform(-92.0, 92.0, (700, 3)) * [1.0, 1.0, 0.0]
points = points[np.hypot(points[:, 0], points[:, 1]) < 92.0]
pressure = np.linspace(0.02, 0.25, 8)  # MPa
noise = np.array([0.005, 0.005, 0.012])  # mm


def made(name, E1, E2, G12):
    """A test of a cloth with these moduli, MPa."""
    blank = np.zeros((len(pressure), len(points), 3))
    test = bulgefit.BulgeTest.from_arrays(points, blank, pressure, name=name)
    seen = bulgefit.predict(test, {"E1": E1, "E2": E2, "G12": G12}).displacement
    seen = seen + noise * rng.normal(size=blank.shape)
    return bulgefit.BulgeTest.from_arrays(points, seen, pressure, name=name)


cloth = {"A": (330.0, 240.0, 30.0), "B": (345.0, 232.0, 31.0), "C": (322.0, 251.0, 29.0)}
tests = [made(name, *moduli) for name, moduli in cloth.items()]

# %%
# Each alone
# ----------
each = [bulgefit.fit(test, starts=1) for test in tests]
for test, result in zip(tests, each, strict=True):
    values = result.material.values
    print(test.name, {name: round(values[name], 2) for name in ("E1", "E2", "G12")})
    for name, true in zip(("E1", "E2", "G12"), cloth[test.name], strict=True):
        assert abs(values[name] - true) < 0.01 * true

# %%
# Their intervals do not meet: it is the cloth that differs, and not the noise.
batch = bulgefit.batch_of(each)
print(batch.report())
spread = batch.plot()
assert batch.spreads["E1"].scatter > 5.0

# %%
# Together, and each predicted by the others
# ------------------------------------------
# One material for all: its misfit is far above the noise, which is the scatter of the cloth and no
# fault of a fit.
together = bulgefit.fit(tests, starts=1)
print(together.report())
assert together.quality.misfit_over_noise > 3.0

folds = bulgefit.crossval(tests, starts=1)
for fold in folds["folds"]:
    missed = fold["left_out_objectives"]["e_w"]
    print(f"{fold['left_out']}: e_w = {missed:.4f} mm by the others' material")
    # what the noise alone leaves is 0.009 mm
    assert missed > 0.015

left_out = folds.plot()
