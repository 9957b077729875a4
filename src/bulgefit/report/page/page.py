"""One page to open, of whatever verb: from its JSON, and its tests where they are at hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Any

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import BulgefitError, InputError
from bulgefit.report.page.blocks import Page
from bulgefit.report.page.fields import MOST_TESTS, packed, thinned
from bulgefit.report.page.of_crossval import page_of_crossval
from bulgefit.report.page.of_diagnosis import page_of_diagnosis
from bulgefit.report.page.of_fit import page_of_fit
from bulgefit.report.page.of_trial import page_of_trial
from bulgefit.report.page.predicted import of_diagnosis, of_fit
from bulgefit.report.page.render import rendered
from bulgefit.report.record import checked_record

__all__ = ["has_maps", "page_html", "sources_of", "verb_of"]

Result = Mapping[str, Any]

#: A key that the JSON of a verb has and no other's, and how its page is made.
_PAGES: dict[str, tuple[str, Callable[[Result], Page]]] = {
    "fit": ("starts", page_of_fit),
    "diagnose": ("causes", page_of_diagnosis),
    "crossval": ("folds", page_of_crossval),
    "trial": ("scores", page_of_trial),
}


def verb_of(result: Result, where: str) -> str:
    """Whose JSON it is.

    Raises
    ------
    InputError
        Of no verb that has a report.
    """
    for verb, (key, _) in _PAGES.items():
        if key in result:
            return verb
    raise InputError(
        f"{where}: no result of bulgefit {', '.join(_PAGES)} that a report can be drawn from"
    )


def sources_of(result: Result, where: str = "result") -> list[dict[str, Any]]:
    """Names, files and checksums of the tests that went in; none of a trial.

    Raises
    ------
    InputError
    """
    verb = verb_of(result, where)
    told = checked_record(result, where)["report"].get("tests") if verb == "diagnose" else None
    return _checked(result.get("sources", []) if told is None else told, where)


def _kept_out_of(result: Result, verb: str, where: str) -> list[dict[str, Any]]:
    """The same of the test that a diagnosis kept out, of which there are no maps."""
    kept = result["report"].get("kept_out") if verb == "diagnose" else None
    return [] if kept is None else _checked([kept], where)


def _checked(found: Any, where: str) -> list[dict[str, Any]]:
    if not isinstance(found, list) or not all(map(_is_source, found)):
        raise InputError(f"{where}: damaged, its sources are no names, files and checksums")
    return found


def _is_source(found: Any) -> bool:
    if not isinstance(found, dict) or {"name", "source", "sha256"} - found.keys():
        return False
    return isinstance(found["name"], str) and isinstance(found["source"], str | None)


def has_maps(verb: str) -> bool:
    """Whether a page of a verb shows maps of tests; a trial's tests are many, and made."""
    return verb in _MODELS


def page_html(
    result: Result, tests: Sequence[BulgeTest | None], *, notes: Sequence[str] = (), where: str = ""
) -> str:
    """The page of a result as one file of HTML, which holds all that it shows.

    Parameters
    ----------
    result : mapping
        The JSON of a fit, a cross-validation, a diagnosis (its record) or a trial.
    tests : sequence of BulgeTest or None
        In the order of the result's sources; None where a file is no longer as it was. Those that
        are there get maps.
    notes : sequence of str
        Why maps are missing, say.
    where : str
        The file that holds the JSON, for errors.

    Raises
    ------
    InputError
        The result is damaged, or of no verb that has a page.
    """
    verb = verb_of(result, where)
    sources = [*sources_of(result, where), *_kept_out_of(result, verb, where)]
    with _damage_told(where, verb) if where else nullcontext():
        page, origin = _PAGES[verb][1](result), _origin(result, sources, where)
        fields = _fields(result, verb, tests)
    fields["notes"] = [*notes, *fields["notes"]]
    return rendered(page, fields, origin)


@contextmanager
def _damage_told(where: str, verb: str) -> Iterator[None]:
    """What is missing in a file, or of another kind, is told in a line."""
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        lacks = f"a value is of another kind: {error}"
        if isinstance(error, KeyError):
            lacks = f"it has no {error.args[0]!r}"
        raise InputError(
            f"{where}: damaged, not as bulgefit {verb} writes it ({lacks}); draw it from the file "
            "as it was written"
        ) from error


def _fields(result: Result, verb: str, tests: Sequence[BulgeTest | None]) -> dict[str, Any]:
    """Maps of the tests that are at hand, and why others have none."""
    there = [(index, test) for index, test in enumerate(tests) if test is not None]
    if not has_maps(verb) or not there:
        return {"tests": [], "notes": []}
    notes = []
    if len(there) > MOST_TESTS:
        notes.append(f"Maps are drawn of the first {MOST_TESTS} tests.")
    drawn = []
    for index, test in there[:MOST_TESTS]:
        judged = _judged(result, verb, index)
        try:
            some = thinned(test, min(len(there), MOST_TESTS), judged)
            drawn.append(packed(some, _MODELS[verb](result, index)))
        except BulgefitError as error:
            notes.append(f"{test.name}: no maps ({error}).")
    return {"tests": drawn, "notes": notes}


def _judged(result: Result, verb: str, index: int) -> list[float] | None:
    return result["report"]["tests"][index]["judged_bar"] if verb == "diagnose" else None


def _of_fit(result: Result, index: int) -> dict[str, Any]:
    return {"with these parameters": partial(of_fit, result=result, index=index)}


def _of_diagnosis(result: Result, index: int) -> dict[str, Any]:
    told = result["report"]
    law = told["law"]
    models = {
        "moduli alone": partial(
            of_diagnosis, values=told["values"]["baseline"], index=index, law=law
        )
    }
    if result["tried"]:
        models["with causes"] = partial(
            of_diagnosis, values=told["values"]["final"], index=index, law=law,
            trust=told["tests"][index] if told["offsets"][index] else None,
        )  # fmt: skip
    return models


#: Models by label, of a test; a cross-validation has one for each fold, and a trial's are many.
_MODELS: dict[str, Callable[[Result, int], dict[str, Any]]] = {
    "fit": _of_fit,
    "diagnose": _of_diagnosis,
}


def _origin(
    result: Result, sources: Sequence[Mapping[str, Any]], where: str
) -> list[tuple[str, str]]:
    """Command, date, versions and checksums."""
    run = result.get("run", {})
    rows = [(key, str(run[key])) for key in ("command", "date") if key in run]
    made_by = (run, result, result.get("meta", {}))
    versions: dict[str, str] = next((of["versions"] for of in made_by if of.get("versions")), {})
    rows.append(("versions", ", ".join(f"{name} {value}" for name, value in versions.items())))
    if where:
        rows.append(("drawn from", where))
    for source in sources:
        name = f"{source['name']} ({source['source']})" if source["source"] else source["name"]
        rows.append((f"SHA-256 of {name}", source["sha256"] or "made in memory"))
    seals = result.get("meta", {}).get("seals", {})
    rows += [(f"seal of {name}", digest) for name, digest in seals.items()]
    return rows
