"""Which tests are meant? Tests as they are, or the files that hold them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, count
from pathlib import Path
from typing import Any

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import same_data, without_copies
from bulgefit.dic.readers import read_test
from bulgefit.dic.reference_image import without_reference
from bulgefit.errors import InputError, kind_of

__all__ = ["GivenTest", "GivenTests", "distinctly_named", "each_once", "given_test", "given_tests"]

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
    """One or several tests, each as it is or by its path, under names that tell them apart.

    Each frame is there once: one that was written twice would count twice, and errors come out too
    small. So would they by the reference image, which is left out.

    Parameters
    ----------
    tests : BulgeTest, path, or iterable of them

    Raises
    ------
    InputError
        As of `given_test`, and of `each_once`.
    """
    if isinstance(tests, (BulgeTest, str, os.PathLike)) or not isinstance(tests, Iterable):
        tests = [tests]
    found = [without_reference(without_copies(given_test(test))) for test in tests]
    return each_once(distinctly_named(found))


def each_once(tests: list[BulgeTest]) -> list[BulgeTest]:
    """The tests, of which no two hold the same data.

    One that counted twice would be taken for two specimens: errors come out too small.

    Raises
    ------
    InputError
        Two do.
    """
    for one, other in combinations(tests, 2):
        if same_data(one, other):
            both = f"{one.source or one.name} and {other.source or other.name}"
            raise InputError(f"{both}: hold the same data; name each test once")
    return tests


def distinctly_named(tests: Sequence[BulgeTest]) -> list[BulgeTest]:
    """Tests of which no two have one name.

    Those of different files are called by as much of the ends of their paths, without the suffix
    where that will do, as tells them apart: a/test and b/test. Others of one name are numbered:
    test_1 and test_2.
    """
    return _numbered(_by_path(tests))


def _by_path(tests: Sequence[BulgeTest]) -> list[BulgeTest]:
    """Tests of which no two from different files have one name."""
    names = [test.name for test in tests]
    alike = [i for i, test in enumerate(tests) if test.source and names.count(test.name) > 1]
    paths = [Path(tests[i].source).absolute() for i in alike]
    others = {name for i, name in enumerate(names) if i not in alike}
    for depth in range(1, max((len(path.parts) for path in paths), default=0) + 1):
        for ends in ([path.with_suffix("").parts for path in paths], [p.parts for p in paths]):
            found = ["/".join(parts[-depth:]) for parts in ends]
            if len({*found, *others}) == len(found) + len(others):
                new = dict(zip(alike, found, strict=True))
                return [replace(test, name=new.get(i, test.name)) for i, test in enumerate(tests)]
    return list(tests)


def _numbered(tests: list[BulgeTest]) -> list[BulgeTest]:
    """Tests of which those of one name are numbered, by what no other is called."""
    names = [test.name for test in tests]
    taken, found = {name for name in names if names.count(name) == 1}, []
    for test in tests:
        if names.count(test.name) > 1:
            numbered = (f"{test.name}_{k}" for k in count(1))
            name = next(name for name in numbered if name not in taken)
            taken.add(name)
            test = replace(test, name=name)
        found.append(test)
    return found
