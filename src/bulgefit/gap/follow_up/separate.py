"""Which effects can this data tell apart? Angles between signatures, moduli projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.gap.effects import CATALOGUE
from bulgefit.gap.explanation import Known

__all__ = ["STIFFNESS", "Pair", "cosine_matrix", "indistinguishable"]

Floats = NDArray[np.float64]

#: Cosine from which a pair is reported.
ALIKE = 0.9
#: What an effect that no test can tell apart is paired with: the moduli together.
STIFFNESS = "stiffness"


@dataclass(frozen=True)
class Pair:
    """Two effects and the largest cosine between their signatures."""

    effects: tuple[str, str]
    cosine: float


def _projected(known: Known, keys: Sequence[Key]) -> Floats:
    """Normal matrix of `keys` with the moduli projected out.

    And with what specimens scatter by, which together may go against the moduli.
    """
    h = known.hessian
    base = [place for place, key in enumerate(known.keys) if key.effect not in CATALOGUE]
    index = [known.keys.index(k) for k in keys]
    whole = h[np.ix_(index, index)]
    across = h[np.ix_(base, index)]
    inner = np.linalg.pinv(h[np.ix_(base, base)], hermitian=True)
    return np.asarray(whole - across.T @ inner @ across)


def _first_groups(known: Known) -> dict[str, list[Key]]:
    """Effects with the keys of their smallest group that are known."""
    groups: dict[str, list[Key]] = {}
    for key in known.keys:
        if key.effect in CATALOGUE and key.name in CATALOGUE[key.effect].groups()[0]:
            groups.setdefault(key.effect, []).append(key)
    return groups


def cosine_matrix(known: Known) -> tuple[list[str], Floats]:
    """Effects, and the largest cosine between each two groups of signatures.

    The cosine of the smallest angle between the two spaces (Björck and Golub, 1973).
    """
    groups = _first_groups(known)
    names = list(groups)
    keys = [k for group in groups.values() for k in group]
    left = _projected(known, keys)
    roots, first = [], 0
    for group in groups.values():
        part = slice(first, first + len(group))
        roots.append((part, _inverse_root(left[part, part])))
        first += len(group)
    out = np.eye(len(names))
    for i, (pi, ri) in enumerate(roots):
        for j, (pj, rj) in enumerate(roots[:i]):
            found = np.linalg.svd(ri @ left[pi, pj] @ rj.T, compute_uv=False)
            out[i, j] = out[j, i] = min(float(found.max(initial=0.0)), 1.0)
    return names, out


def _inverse_root(matrix: Floats) -> Floats:
    """R with R M Rᵀ = 1 on the range of the matrix."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    kept = values > 1e-9
    return (vectors[:, kept] / np.sqrt(values[kept])).T * scale


def indistinguishable(known: Known) -> list[Pair]:
    """Pairs of effects that are alike, most alike first."""
    names, cosine = cosine_matrix(known)
    pairs = [
        Pair((names[j], names[i]), float(cosine[i, j]))
        for i in range(len(names))
        for j in range(i)
        if cosine[i, j] >= ALIKE
    ]
    return sorted(pairs, key=lambda p: -p.cosine)
