"""How does a shell complete verbs, options and their values? By asking bulgefit, where it may."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from typing import Any

from bulgefit.errors import InputError

__all__ = ["SHELLS", "Completion", "complete", "is_asked"]

SHELLS = ("bash", "zsh", "fish")


def is_asked() -> bool:
    """Whether a shell runs the program for completions alone."""
    return "_ARGCOMPLETE" in os.environ


def complete(top: argparse.ArgumentParser, add_verb: Callable[[Any, str], None]) -> None:
    """Tell the shell that asks, and leave.

    Parameters
    ----------
    top : ArgumentParser
        Of what stands before the verb.
    add_verb : callable
        Adds to `top`'s verbs the one that stands on the line, with its options; all others by name.
    """
    line = os.environ.get("COMP_LINE", "").split()
    verbs = top.add_subparsers(metavar="VERB", parser_class=type(top))
    add_verb(verbs, next((word for word in line[1:] if not word.startswith("-")), ""))
    _argcomplete().autocomplete(top)


class Completion(argparse.Action):
    """Print what a shell must run to complete bulgefit's lines."""

    def __call__(
        self, parser: argparse.ArgumentParser, _: argparse.Namespace, shell: Any, *__: Any
    ) -> None:
        print(_argcomplete().shellcode([parser.prog], shell=shell))
        parser.exit()


def _argcomplete() -> Any:
    try:
        import argcomplete
    except ImportError:
        raise InputError(
            '--completion: argcomplete is not installed; pip install "bulgefit[completion]" brings '
            "it"
        ) from None
    return argcomplete
