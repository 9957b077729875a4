"""How is a run repeated? Every verb takes its options from a TOML file, and writes them to one.

A key is the long name of an option without its dashes, or the name of what stands without an
option, such as `tests`. What the command line says comes after the file, and so replaces it.
"""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bulgefit.errors import InputError

__all__ = ["add_config_arguments", "check_config", "save_config", "with_config"]

#: What values are, in words.
_KINDS: Mapping[Any, str] = {int: "whole number", float: "number"}

#: Options that are about the run's file, or end the program.
_NOT_KEPT = ("config", "save-config", "help")


def add_config_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --config FILE and --save-config FILE."""
    group = parser.add_argument_group("repeating a run")
    group.add_argument(
        "--config",
        metavar="FILE.toml",
        help="take options from this file, as 'starts = 3' for --starts 3; options that are given "
        "beside it replace those in it (default: none)",
    )
    group.add_argument(
        "--save-config",
        metavar="FILE.toml",
        help="write all options of this run to a file that --config takes (default: none)",
    )


def with_config(parser: argparse.ArgumentParser, words: Sequence[str]) -> list[str]:
    """The words of a command line, after those that its --config stands for.

    Parameters
    ----------
    parser : ArgumentParser
        Of the verb; what stands without an option becomes optional where the file gives it.
    words : sequence of str

    Raises
    ------
    InputError
        The file cannot be read, is no TOML, has a key that is no option, or a value that the
        option does not take.
    """
    finder = argparse.ArgumentParser(prog=parser.prog, add_help=False, allow_abbrev=False)
    finder.error = parser.error  # type: ignore[method-assign]
    finder.add_argument("--config", action="append")
    files = finder.parse_known_args(words)[0].config
    if files is None:
        return list(words)
    if len(files) > 1:
        raise InputError(f"--config: {len(files)} files are named; put their options into one")
    (file,) = files
    actions = _actions(parser)
    found: list[str] = []
    content, writer = _read(file)
    for key, value in content.items():
        if key not in actions:
            raise InputError(
                f"{file}: {key} is no option of {parser.prog}; "
                + _instead(key, value, actions, parser.prog, writer)
            )
        action = actions[key]
        texts = _texts(action, value, f"{file}: {key}")
        if action.option_strings:
            found += [] if _adds_to(action, words) else _as_words(action, texts)
        else:
            action.default, action.required = texts, False
            action.nargs = "*" if action.nargs == "+" else "?"
            if action.nargs == "?":
                (action.default,) = texts
    return [*found, *words]


def _instead(key: str, value: Any, known: Iterable[str], verb: str, writer: str | None) -> str:
    """What to do about a key that is no option."""
    if writer is not None and writer != verb:
        return f"the file was written by {writer}, and each verb has its own options"
    if isinstance(value, dict):
        return "the file has options alone, and no sections"
    near = difflib.get_close_matches(key, known, n=1)
    return f"did you mean {near[0]}?" if near else f"see {verb} --help"


def _adds_to(action: argparse.Action, words: Sequence[str]) -> bool:
    """Whether a line gives an option whose values would stand beside those of the file."""
    given = {word.partition("=")[0] for word in words}
    return isinstance(action, argparse._AppendAction) and not given.isdisjoint(
        action.option_strings
    )


def check_config(args: argparse.Namespace) -> None:
    """Refuse a --save-config that cannot be, or that another option names, before the work."""
    if args.save_config is None:
        return
    from bulgefit.files import check_apart, check_output

    check_output(args.save_config, getattr(args, "force", False))
    values = [value for name, value in vars(args).items() if name != "save_config"]
    named = [item for value in values for item in (value if isinstance(value, list) else [value])]
    check_apart([args.save_config], [item for item in named if isinstance(item, str)])


def save_config(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Write what `args` say to the file of --save-config, if there is one."""
    if args.save_config is None:
        return
    import tomli_w

    import bulgefit
    from bulgefit.files import atomic_write_text

    values = {key: getattr(args, action.dest) for key, action in _actions(parser).items()}
    kept = {
        key: True if _is_flag(action) else values[key]
        for key, action in _actions(parser).items()
        # a flag that was not given has nothing to say, nor has an option without a value
        if values[key] not in (None, [])
        and not (_is_flag(action) and values[key] == action.default)
    }
    head = f"# {parser.prog}, version {bulgefit.__version__}\n"
    atomic_write_text(args.save_config, head + tomli_w.dumps(kept), getattr(args, "force", False))


def _actions(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """What a file may set, by its key."""
    keys = {_key(action): action for action in parser._actions}
    return {key: action for key, action in keys.items() if key not in _NOT_KEPT}


def _key(action: argparse.Action) -> str:
    long = [name for name in action.option_strings if name.startswith("--")]
    return long[0].removeprefix("--") if long else action.dest


def _is_flag(action: argparse.Action) -> bool:
    return bool(action.option_strings) and action.nargs == 0


def _read(file: str) -> tuple[Mapping[str, Any], str | None]:
    """What a file says, and the verb by whose --save-config it was written, where it was."""
    import tomllib
    from pathlib import Path

    try:
        # an editor may have put a byte order mark before it
        text = Path(file).read_text(encoding="utf-8-sig")
        written = re.match(r"# (bulgefit \w+), version", text)
        return tomllib.loads(text), None if written is None else written[1]
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no TOML ({error}); a line is as 'starts = 3'") from error


def _texts(action: argparse.Action, value: Any, where: str) -> list[str]:
    """A value of a file as words of a command line; none for a flag that is not set."""
    if _is_flag(action):
        if not isinstance(value, bool):
            raise InputError(f"{where}: give true or false, not {value!r}")
        return ["true"] if value else []
    several = action.nargs in ("+", "*") or isinstance(action, argparse._AppendAction)
    several = several or isinstance(action.nargs, int)
    items = value if several and isinstance(value, list) else [value]
    if not items and isinstance(action, argparse._AppendAction):
        return []
    if not items or any(isinstance(i, (bool, list, dict)) for i in items):
        kind = "a string or a number, or a list of them" if several else "a string or a number"
        raise InputError(f"{where}: give {kind}, not {value!r}")
    texts = [str(item) for item in items]
    for text in texts:
        try:
            if callable(action.type):
                action.type(text)
        except (ValueError, TypeError, argparse.ArgumentTypeError) as error:
            kind = _KINDS.get(action.type, "value of it")
            raise InputError(f"{where}: {text!r} is no {kind}") from error
    return texts


def _as_words(action: argparse.Action, texts: list[str]) -> list[str]:
    name = f"--{_key(action)}"
    if _is_flag(action):
        return [name] * len(texts)
    if action.nargs is None:
        return [f"{name}={text}" for text in texts]
    return [name, *texts]
