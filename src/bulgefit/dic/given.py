"""Which tests are meant? Tests as they are, or the files that hold them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import without_copies
from bulgefit.dic.readers import read_test
from bulgefit.errors import InputError, kind_of

__all__ = ["GivenTest", "GivenTests", "given_test", "given_tests"]

GivenTest = BulgeTest | str | os.PathLike[str]
GivenTests = GivenTest | Sequence[GivenTest]


def given_test(test: Any) -> BulgeTest:
    """A test, or the one that a path names.

    Parameters
    ----------
    test : BulgeTest or path

    Raises
    ------
    InputError
        It is neither, or the file cannot be read.
    """
    if isinstance(test, BulgeTest):
        return test
    if isinstance(test, (str, os.PathLike)):
        return read_test(test)
    raise InputError(
        f"a bulge test or the path of one is needed, not {kind_of(test)}; read_test reads files, "
        "and BulgeTest.from_arrays makes tests"
    )


def given_tests(tests: Any) -> list[BulgeTest]:
    """One or several tests, each as it is or by its path, and each frame of it once.

    A frame that was written twice would count twice, and errors come out too small.

    Parameters
    ----------
    tests : BulgeTest, path, or iterable of them

    Raises
    ------
    InputError
        As of `given_test`.
    """
    if isinstance(tests, (BulgeTest, str, os.PathLike)) or not isinstance(tests, Iterable):
        tests = [tests]
    return [without_copies(given_test(test)) for test in tests]
