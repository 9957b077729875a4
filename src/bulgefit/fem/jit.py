"""How the kernels are compiled: at their first call, once per machine."""

from __future__ import annotations

from numba import njit

__all__ = ["compiled"]

#: Division by zero gives an infinity, as in numpy. Sums may be reordered and fused for speed;
#: NaN and infinity keep their meaning, since collapsed cells are told by them. The interpreter is
#: released, so that several searches run in threads of one process.
compiled = njit(
    cache=True,
    nogil=True,
    error_model="numpy",
    fastmath={"contract", "reassoc", "nsz", "arcp"},
)
