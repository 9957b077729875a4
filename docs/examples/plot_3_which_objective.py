"""
Which objective
===============

The height of the apex alone is met by many materials. Small displacements in the plane of the
cloth tell them apart.
"""

from pathlib import Path

import bulgefit

here = Path.cwd()
home = next(f for f in [here, *here.parents] if (f / "data" / "example_bulge.npz").is_file())
test = bulgefit.read_test(home / "data" / "example_bulge.npz")

# %%
# The same test by four objectives. `e_z` sees the apex only, `e` all points with dz as large as it
# is, `e_w` with dz weighted down to the size of dx and dy, `likelihood` each component in units of
# its noise.
found = {}
for objective in ("e_z", "e", "e_w", "likelihood"):
    found[objective] = bulgefit.fit(test, objective, starts=2)

print(f"{'objective':12}{'E1':>22}{'E2':>22}{'G12':>22}   (true: 330, 240, 30 MPa)")
for objective, result in found.items():
    cells = []
    for name in ("E1", "E2", "G12"):
        error = result.uncertainty.stderr[name]
        cells.append(
            f"{result.material.values[name]:.2f} ± " + ("?" if error is None else f"{error:.2g}")
        )
    print(f"{objective:12}" + "".join(f"{cell:>22}" for cell in cells))

# %%
# The apex of one test does not determine three moduli, and the fit says so in its first lines.
print(found["e_z"].report())

for objective in ("e", "e_w", "likelihood"):
    values = found[objective].material.values
    assert abs(values["E1"] - 330.0) < 0.5
    assert abs(values["E2"] - 240.0) < 0.5
    assert abs(values["G12"] - 30.0) < 0.5
