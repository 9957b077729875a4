"""Which laws are there? Our own, and those of other packages.

A package adds a law by an entry point of the group `bulgefit.laws` that leads to a `Law`:

    [project.entry-points."bulgefit.laws"]
    fung = "my_package.fung:FUNG"
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points

from bulgefit.errors import InputError
from bulgefit.fem.laws.hencky import HENCKY
from bulgefit.fem.laws.law import Law
from bulgefit.fem.laws.svk import SVK
from bulgefit.fem.laws.yarn import YARN

__all__ = ["GROUP", "LAWS"]

GROUP = "bulgefit.laws"

_OWN = {law.name: law for law in (HENCKY, SVK, YARN)}


class _Laws(Mapping[str, Law]):
    """Laws by name. Other packages are asked only where our own do not do."""

    def __getitem__(self, name: str) -> Law:
        return _OWN[name] if name in _OWN else _others()[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**_OWN, **_others()})

    def __len__(self) -> int:
        return len(list(iter(self)))


LAWS: Mapping[str, Law] = _Laws()


@cache
def _others() -> dict[str, Law]:
    """Laws of other packages.

    Raises
    ------
    InputError
        An entry point that fails, is no law, or has the name of one of ours.
    """
    found = {}
    for entry in entry_points(group=GROUP):
        where = f"law {entry.name!r} of the entry point {entry.value}"
        if entry.name in _OWN:
            raise InputError(f"{where}: bulgefit has a law of that name; give it another")
        try:
            law = entry.load()
        except Exception as error:
            raise InputError(
                f"{where} cannot be loaded: {type(error).__name__}: {error}; mend or uninstall "
                "its package"
            ) from error
        if not isinstance(law, Law):
            raise InputError(f"{where}: expected a bulgefit.fem.laws.law.Law, got {law!r}")
        found[entry.name] = law
    return found
