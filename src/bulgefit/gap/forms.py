"""In how small a form is an effect enough?"""

from __future__ import annotations

from collections.abc import Callable, Collection

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.effects import CATALOGUE
from bulgefit.gap.keys import group_keys
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.search import GAIN_PER_PARAMETER, TIE, Groups, Search
from bulgefit.gap.structure import structure

__all__ = ["in_smallest_forms", "smallest_form"]

#: A smaller form is not fitted where it would lose so many times what it may by a linear forecast:
#: for bends and knees that overstated the loss up to 27 times on made tests, for others by 2 %.
HOPELESS = 100.0


def smallest_form(
    search: Search,
    fit: Regression,
    effect: str,
    keys: tuple[str, ...],
    least: float = 0.0,
    enough: Callable[[Regression], bool] = lambda _: True,
) -> tuple[Regression, tuple[str, ...]]:
    """A model with one effect in as small a form as held-out data are content with, and its keys.

    Parameters
    ----------
    search : Search
    fit : Regression
        With the effect in the form that `keys` are.
    effect : str
    keys : tuple of str
    least : float
        Size that a form must exceed.
    enough : callable
        Whether a fit with a smaller form will do otherwise.
    """
    refused: list[set[str]] = []
    for group in reversed(CATALOGUE[effect].groups()):
        form = group_keys(group, len(search.data))
        # what a form lacks, those within it lack too
        within = any(set(form) <= larger for larger in refused)
        if within or not set(form) < set(keys) or search.size(form) <= least:
            continue
        dropped = set(keys) - set(form)
        search.say(f"{effect} ({len(form)} parameters)")
        smaller = _fit_without(search, fit, dropped)
        if smaller is None or not enough(smaller):
            refused.append(set(form))
        else:
            fit, keys = smaller, form
    return fit, keys


def _fit_without(search: Search, fit: Regression, dropped: Collection[str]) -> Regression | None:
    """The fit without some keys; None where held-out data are not content with it."""
    limit = TIE + GAIN_PER_PARAMETER * search.size(dropped)
    if search.loss_without(fit, dropped) > HOPELESS * limit:
        return None
    try:
        smaller = regress(
            search.data,
            tuple(k for k in fit.keys if k not in dropped),
            {k: v for k, v in fit.values.items() if k not in dropped},
            [p.shapes for p in fit.predictions],
        )
    except (SolveError, InputError):
        return None
    return smaller if smaller.held_out() - fit.held_out() <= limit else None


def in_smallest_forms(
    search: Search, current: Regression, groups: Groups
) -> tuple[Regression, Groups]:
    """A model with each effect as small as the others let it be: it may have grown without them."""
    forms = dict(groups)
    for effect, keys in groups.items():
        current, forms[effect] = smallest_form(
            search,
            current,
            effect,
            keys,
            enough=lambda fit: not structure(search.data, fit).significant,
        )
    return current, forms
