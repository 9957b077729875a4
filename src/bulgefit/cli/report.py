"""bulgefit report: the page of a result, drawn again from its JSON. And --report of other verbs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli import _common
from bulgefit.cli.json_in import json_of
from bulgefit.errors import BulgefitError, InputError

if TYPE_CHECKING:
    from bulgefit.dic import BulgeTest

__all__ = [
    "HELP",
    "add_arguments",
    "add_report_argument",
    "check_page",
    "is_page",
    "page_of",
    "run",
]

HELP = "draw the page of a result again from its JSON"

_SUFFIX = ".html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Draw the page that --report gives of fit, crossval, diagnose and trial again, from the\n"
        "JSON alone. Where the tests are still there, and their checksums those of then, the page\n"
        "has maps of them; where not, it says so. Lengths in mm, moduli in MPa, pressures in bar."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit report gap.json\n"
        "  bulgefit report fit.json --output for_the_customer.html"
    )
    parser.add_argument("result", metavar="FILE.json", help="what a verb wrote with --json")
    parser.add_argument(
        "--output",
        metavar="FILE.html",
        help="the page (default: beside the JSON, with its name and .html)",
    )
    parser.add_argument(
        "--force", action="store_true", help="replace the page if it exists (default: refuse)"
    )


def run(args: argparse.Namespace) -> int:
    """Read, find the tests, draw."""
    from bulgefit.files import atomic_write_text, check_apart, check_output

    if not args.result:
        raise InputError("the name of the JSON is empty; give that of a result")
    if not Path(args.result).name:
        raise InputError(f"{args.result}: is a folder; name the JSON of a result")
    output = args.output or str(Path(args.result).with_suffix(_SUFFIX))
    _check_name(output, "--output")
    check_apart([output], [args.result])
    result = json_of(args.result)

    # only now: it takes seconds
    from bulgefit.report.page.page import page_html, sources_of

    sources = sources_of(result, args.result)
    check_apart([output], [source["source"] for source in sources if source["source"]])
    check_output(output, args.force)
    tests, notes = _tests(args, result, sources)
    page = page_html(result, tests, notes=notes, where=args.result)
    atomic_write_text(output, page, args.force)
    for note in notes:
        _common.progress(args, f"note: {note}")
    print(output)
    return 0


def add_report_argument(parser: argparse.ArgumentParser, shown: str) -> None:
    """Add --report FILE.html, a page that shows what is said here, and how it was made."""
    parser.add_argument(
        "--report",
        metavar="FILE.html",
        help=f"write one page of HTML that holds all it shows: {shown}, how it was made; it opens "
        "offline, from a mail, on a phone (default: none)",
    )


def is_page(path: str) -> bool:
    """Whether the name is that of a page."""
    return Path(path).suffix.lower() == _SUFFIX


def check_page(args: argparse.Namespace) -> list[str]:
    """The page of --report, if there is one; refused before the work where it cannot be."""
    from bulgefit.files import check_output

    if args.report is None:
        return []
    _check_name(args.report, "--report")
    check_output(args.report, _common.may_replace(args, args.report))
    return [args.report]


def page_of(
    args: argparse.Namespace, result: Mapping[str, Any], tests: Sequence[BulgeTest | None]
) -> list[Callable[[], None]]:
    """What writes the page of --report, for `deliver`; nothing where none is asked for."""
    if args.report is None:
        return []
    return [lambda: _write(args, result, tests)]


def _write(
    args: argparse.Namespace, result: Mapping[str, Any], tests: Sequence[BulgeTest | None]
) -> None:
    from bulgefit.files import atomic_write_text
    from bulgefit.report.page.page import page_html

    page = page_html({**result, "run": _common.run_of(args)}, tests)
    atomic_write_text(args.report, page, _common.may_replace(args, args.report))
    _common.progress(args, f"wrote {args.report}")


def _check_name(path: str, option: str) -> None:
    if not is_page(path):
        raise InputError(f"{option} {path}: give a name that ends in {_SUFFIX}")


def _tests(
    args: argparse.Namespace, result: Mapping[str, Any], sources: Sequence[Mapping[str, Any]]
) -> tuple[list[BulgeTest | None], list[str]]:
    """The tests that are as they were, and why others have no maps."""
    from bulgefit.report.page.page import has_maps, verb_of

    if not has_maps(verb_of(result, args.result)):
        return [], []
    tests, notes = list[Any](), []
    reading = _reading(result, args.result)
    for source in sources:
        try:
            tests.append(_same(source, Path(args.result).parent, reading))
        except BulgefitError as error:
            tests.append(None)
            notes.append(f"{source['name']} has no maps: {error}")
    return tests, notes


def _reading(result: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """How the tests were read, as `reading_of` tells it; InputError where that is damaged."""
    try:
        reading = result.get("run", {}).get("reading", {})
        options, most = reading.get("options", {}), reading.get("max_pressure_bar")
        return {"options": {**options}, "max": None if most is None else float(most)}
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{where}: damaged, its run.reading does not say how the tests were read ({error})"
        ) from error


def _same(source: Mapping[str, Any], folder: Path, reading: Mapping[str, Any]) -> BulgeTest:
    """The test as it was, from where it was read, or from beside the JSON."""
    from bulgefit.cli._fitting import up_to
    from bulgefit.dic import read_test

    if not source["source"]:
        raise InputError("it was made in memory")
    where = Path(source["source"])
    places = [where, folder / where, folder / where.name]
    there = next((place for place in places if place.exists()), None)
    if there is None:
        raise InputError(f"{source['source']} is no longer there")
    try:
        test = read_test(str(there), **reading["options"])
    except (TypeError, AttributeError) as error:  # values that no option has
        raise InputError(f"its run.reading.options are damaged ({error})") from error
    if test.checksum != source["sha256"]:
        raise InputError(f"{there} has changed since (its SHA-256 is another)")
    return test if reading["max"] is None else up_to(test, reading["max"])
