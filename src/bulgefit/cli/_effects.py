"""What do --with, --hold, --from, --prior and --uncertainty say?"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bulgefit.cli._common import USUAL_LAW, progress
from bulgefit.cli.json_in import json_of, value_of
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bulgefit.dic import BulgeTest
    from bulgefit.fitting.problem import Prior

__all__ = [
    "add_effect_arguments",
    "add_freeing_arguments",
    "add_hold_argument",
    "add_prior_argument",
    "found_law",
    "found_tests",
    "given_ratios",
    "held_by_hand",
    "held_from",
    "priors_from",
    "take_found_law",
    "take_found_moduli",
    "uncertainty_from",
    "with_from",
]


def add_effect_arguments(parser: argparse.ArgumentParser, *, fits: bool = False) -> None:
    """Add --hold and --from.

    Parameters
    ----------
    fits : bool
        Whether the verb fits the material, so that --from says effects alone.
    """
    group = parser.add_argument_group("effects", "what the test has that the ideal one has not")
    add_hold_argument(
        group,
        "set a parameter of an effect, in its unit, as clamp_slip.compliance=0.02",
        "every effect is absent",
    )
    group.add_argument(
        "--from",
        dest="from_file",
        metavar="FILE.json",
        help="hold the effects' parameters at what bulgefit diagnose or fit found and wrote with "
        "--json; moduli, Poisson's ratio and law are not taken from it, nor fields"
        if fits
        else "set the effects' parameters, and moduli, law, clamp, thickness and angle that no "
        "option gives, to what bulgefit diagnose or fit found, or its tests had, and wrote with "
        "--json; fields are not taken from it",
    )


def add_hold_argument(group: argparse._ArgumentGroup, meaning: str, default: str) -> None:
    """Add --hold."""
    group.add_argument(
        "--hold",
        action="append",
        default=[],
        metavar="EFFECT.PARAMETER=VALUE",
        help=f"{meaning}; several by commas or by giving it again (default: {default})",
    )


def add_freeing_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --with, --prior and --uncertainty."""
    group = parser.add_argument_group("effects that are fitted")
    group.add_argument(
        "--with",
        dest="with_effects",
        action="append",
        default=[],
        metavar="EFFECT,...",
        help="fit these effects (or single parameters, EFFECT.PARAMETER) beside the moduli, as "
        "clamp_slip,initial_shape",
    )
    add_prior_argument(group, "what is believed of a fitted parameter, in its unit, as E1=300+-60")
    group.add_argument(
        "--uncertainty",
        action="append",
        default=[],
        metavar="NAME=SD",
        help="standard deviation of thickness, radius or pressure, as a share (thickness=0.02), or "
        "of nu12; intervals include it",
    )


def add_prior_argument(group: argparse._ArgumentGroup, meaning: str) -> None:
    """Add --prior."""
    group.add_argument(
        "--prior", action="append", default=[], metavar="NAME=VALUE+-SD", help=meaning
    )


def _items(given: list[str], option: str) -> list[tuple[str, str]]:
    """NAME=VALUE pairs; each name once."""
    found: dict[str, str] = {}
    for item in (part.strip() for text in given for part in text.split(",")):
        if not item:
            continue
        name, equals, value = (part.strip() for part in item.partition("="))
        if not (name and equals and value):
            raise InputError(f"--{option}: {item!r} is not of the form NAME=VALUE")
        if name in found:
            raise InputError(f"--{option}: {name} is given twice; give it once")
        found[name] = value
    return list(found.items())


def _number(text: str, option: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"--{option} {name}: {text!r} is no finite number")
    return value


def held_from(args: argparse.Namespace, tests: Sequence[BulgeTest] = ()) -> dict[str, float]:
    """Values of effects' parameters that --from and --hold set; --hold goes before.

    Parameters
    ----------
    tests : sequence of BulgeTest
        Of several, `effect.parameter@i` of --hold is test i's own, in their order; of a file the
        same test's, wherever it stands.
    """
    held: dict[str, float] = {}
    if args.from_file is not None:
        path = Path(args.from_file)
        held |= _found_effects(path, tests)
        for line in _not_taken(_read(path)):
            progress(args, f"warning: --from {path}: {line}")
    return held | held_by_hand(args)


def _not_taken(content: dict[str, Any]) -> Iterator[str]:
    """What a diagnosis says that its causes and moduli alone do not, or not for sure."""
    if not _is_gap(content):
        return
    from bulgefit.gap.evidence.probability import SURE

    chances = {cause["effect"]: cause.get("probability") for cause in content["causes"]}
    unsure = [name for name, p in chances.items() if isinstance(p, float) and p < SURE]
    if unsure:
        yield f"not sure are its causes {', '.join(unsure)}; they are taken"
    told = content.get("fields")
    fields = [str(one.get("field")) for one in told if isinstance(one, dict)] if told else []
    if fields:
        yield (
            f"fields are not taken ({', '.join(dict.fromkeys(fields))}), beside which the moduli "
            "and causes were found: the model is another one"
        )


def held_by_hand(args: argparse.Namespace) -> dict[str, float]:
    """Values of effects' parameters that --hold sets."""
    held = {}
    for name, text in _items(args.hold, "hold"):
        if "." not in name:
            raise InputError(
                f"--hold {name}: name an effect's parameter as EFFECT.PARAMETER; moduli of a fit "
                "are held by equal --bounds, its Poisson's ratio by --nu12, that of a diagnosis "
                "by poisson_ratio.nu12"
            )
        held[name] = _number(text, "hold", name)
    return held


def with_from(args: argparse.Namespace) -> tuple[str, ...]:
    """Effects that --with frees."""
    names = [part.strip() for text in args.with_effects for part in text.split(",")]
    return tuple(dict.fromkeys(name for name in names if name))


def priors_from(args: argparse.Namespace) -> dict[str, Prior]:
    """Of --prior."""
    from bulgefit.fitting.problem import Prior

    out = {}
    for name, text in _items(args.prior, "prior"):
        mean, sign, deviation = text.replace("±", "+-").partition("+-")
        if not sign:
            raise InputError(f"--prior {name}={text}: give NAME=VALUE+-SD, as E1=300+-60")
        out[name] = Prior(_number(mean, "prior", name), _number(deviation, "prior", name))
    return out


def uncertainty_from(args: argparse.Namespace) -> dict[str, float]:
    """Of --uncertainty."""
    return {
        name: _number(text, "uncertainty", name)
        for name, text in _items(args.uncertainty, "uncertainty")
    }


def _read(path: Path) -> dict[str, Any]:
    content = json_of(path, option="--from", of="bulgefit diagnose or fit")
    if not any(isinstance(content.get(key), list) for key in ("causes", "starts")):
        raise InputError(
            f"--from {path}: no JSON of bulgefit diagnose or fit (it has no causes or starts)"
        )
    return content


def _is_gap(content: dict[str, Any]) -> bool:
    return "causes" in content


def _told_effects(content: dict[str, Any]) -> dict[str, Any]:
    """What stands of each parameter of an effect, by its name."""
    if not _is_gap(content):
        return {name: found for name, found in content["parameters"].items() if "." in name}
    told = {
        f"{cause['effect']}.{name}": found
        for cause in content["causes"]
        for name, found in cause["parameters"].items()
    }
    return told | {name: {"value": value} for name, value in content.get("held", {}).items()}


def _found_effects(path: Path, tests: Sequence[BulgeTest]) -> dict[str, float]:
    """Values of effects' parameters that the file tells, of several tests by their order here."""
    from bulgefit.effects.parameter import Key
    from bulgefit.effects.registry import catalogue, parameter_named

    known = {name for effect in catalogue().values() for name in effect.names}
    held, content = {}, _read(path)
    try:
        told = _told_effects(content)
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise InputError(f"--from {path}: {_lacks(error, 'its causes are')}") from error
    places: dict[int, int] | None = None
    for name, found in told.items():
        key = Key.read(name)
        if key.name not in known:
            raise InputError(
                f"--from {path}: {key.name} is no parameter that a model can be given (an offset "
                "of every point, say); leave it out and hold the others with --hold"
            )
        if key.specimen is not None:
            places = _places(path, tests) if places is None else places
            if key.specimen not in places:
                continue  # of a test that is not looked at here
            key = key._replace(specimen=places[key.specimen] if len(tests) > 1 else None)
        held[str(key)] = value_of(found, name, parameter_named(key.name).unit, f"--from {path}")
    return held


def found_tests(path: Path) -> list[dict[str, Any]]:
    """What a result (--from) tells of each test that went in; nothing where it names none."""
    content = _read(path)
    try:
        told = content.get("sources", (content.get("report") or {}).get("tests")) or []
        return [{**one} for one in told]
    except (TypeError, AttributeError) as error:
        raise InputError(f"--from {path}: {_lacks(error, 'its tests are')}") from error


def _places(path: Path, tests: Sequence[BulgeTest]) -> dict[int, int]:
    """Where each test that a file is about stands among those that are given.

    By what they hold, or, where that was written anew, by their names: values that are one test's
    own are wrong of every other. A file that names none is taken to mean them in their order.
    """
    told = found_tests(path)
    try:
        sums, names = ([str(one[key]) for one in told] for key in ("sha256", "name"))
    except KeyError as error:
        raise InputError(f"--from {path}: {_lacks(error, 'its tests are')}") from error
    if not told and len(tests) > 1:
        return {i: i for i in range(len(tests))}
    if not tests or not told:
        raise InputError(
            f"--from {path}: it is about several tests; give them all, or --hold the values"
        )
    places = {}
    for place, test in enumerate(tests):
        by_sum = [i for i, found in enumerate(sums) if found and found == test.checksum]
        found = by_sum or [i for i, name in enumerate(names) if name == test.name]
        if len(found) != 1 or found[0] in places:
            raise InputError(
                f"--from {path}: which of its tests ({', '.join(names)}) is {test.name}? It tells "
                "values that are each test's own; give those tests, or --hold the values"
            )
        places[found[0]] = place
    return places


def _lacks(error: Exception, what: str) -> str:
    """What is wrong with a file that something was looked for in."""
    if isinstance(error, KeyError):
        return f"it has no {error.args[0]!r}; take the file as it was written"
    return f"{what} not as they were written ({error})"


def _told_moduli(content: dict[str, Any]) -> dict[str, Any]:
    """What stands of each, as options name them: what a fit held is told, too."""
    if _is_gap(content):
        found, names = content["parameters"]["corrected"], ["E1", "E2", "G12"]
    else:
        found = content["parameters"]
        names = [name for name in found if "." not in name]
        if content["material"] == "isotropic-EG":
            names = ["E", "G"]
    return {name: found[name] for name in names}


def given_ratios(args: argparse.Namespace) -> list[str]:
    """Poisson's ratios that options give; ask before `take_found_moduli` sets what they do not."""
    return [name for name in ("nu12", "nu") if getattr(args, name) is not None]


def take_found_moduli(args: argparse.Namespace) -> None:
    """Set the moduli (MPa) that --from found and no option gives."""
    if args.from_file is None or args.E is not None:
        return
    from bulgefit.model.parameters import MATERIALS

    path = Path(args.from_file)
    content = _read(path)
    try:
        told = _told_moduli(content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"--from {path}: {_lacks(error, 'its moduli are')}") from error
    units = {p.name: p.unit for kind in MATERIALS.values() for p in kind}
    for name, found in told.items():
        if name not in units:
            raise InputError(f"--from {path}: {name} is no parameter of a material")
        if getattr(args, name) is None:
            value = value_of(found, f"parameters.{name}", units[name], f"--from {path}")
            setattr(args, name, value)


def take_found_law(args: argparse.Namespace) -> None:
    """Set the law that --from found, or else the usual one, where no option gives it."""
    if args.law is None:
        args.law = found_law(args) or USUAL_LAW


def found_law(args: argparse.Namespace) -> str | None:
    """The law by which --from was found; None without it, or where it does not say."""
    if args.from_file is None:
        return None
    content = _read(Path(args.from_file))
    told = content.get("report" if _is_gap(content) else "settings")
    law = told.get("law") if isinstance(told, dict) else None
    return law if isinstance(law, str) else None
