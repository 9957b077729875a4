"""Do tables tell units and specimens apart, whatever these are called?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bulgefit.dic import write_test
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import distinctly_named, given_tests
from bulgefit.fitting.answers import CrossValidation
from bulgefit.fitting.batch import batch_of
from bulgefit.fitting.crossval import crossval
from bulgefit.fitting.fit import fit
from bulgefit.fitting.quality import Quality, Warned
from bulgefit.model.setup import Setup
from bulgefit.shown import plain

Maker = Callable[..., BulgeTest]


def names(test: BulgeTest, *sources: str) -> list[str]:
    return [t.name for t in distinctly_named([replace(test, source=s) for s in sources])]


def test_specimens_of_one_name_are_called_by_their_shortest_paths(make: Maker) -> None:
    test = make(name="test")
    assert names(test, "a/test.npz", "b/test.npz") == ["a/test", "b/test"]
    assert names(test, "a/x/test.npz", "b/x/test.npz") == ["a/x/test", "b/x/test"]
    assert names(test, "a/one.npz", "a/two.npz") == ["one", "two"]
    assert names(test, "a/test.npz", "a/test.h5") == ["test.npz", "test.h5"]
    # a name that is alone is left; where no path tells them apart, numbers do
    assert names(test, "a/test.npz") == ["test"]
    assert names(test, "", "") == ["test_1", "test_2"]
    assert names(test, "a/test.npz", "", "a/test.npz") == ["test_1", "test_2", "test_3"]
    taken = distinctly_named([test, replace(test, name="test_1"), test])
    assert [t.name for t in taken] == ["test_2", "test_1", "test_3"]
    other = replace(test, name="b/test", source="c/other.npz")
    mixed = [replace(test, source=f"{folder}/test.npz") for folder in ("a", "b")]
    assert len({t.name for t in distinctly_named([*mixed, other])}) == 3


def test_they_are_told_apart_in_folds_and_fits(make: Maker, setup: Setup, tmp_path: Path) -> None:
    files = []
    for seed, folder in enumerate(("left", "right")):
        (tmp_path / folder).mkdir()
        files.append(tmp_path / folder / "test.npz")
        write_test(make(noise=0.02, seed=seed), files[-1])
    tests = given_tests(files)
    assert [test.name for test in tests] == ["left/test", "right/test"]
    bounds = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
    options = {"starts": 1, "setup": setup, "bounds": bounds}
    folds = crossval(files, **options)
    assert [fold["left_out"] for fold in folds["folds"]] == ["left/test", "right/test"]
    head, first = folds.report().splitlines()[:2]
    assert head.split("  ")[0] == "left out"
    for told in ("E1 (MPa)", "nu12 ", "training (mm)", "e_w (mm)"):
        assert told in head
    assert first.startswith("left/test ")
    assert [part.name for part in fit(files, **options).tests] == ["left/test", "right/test"]


def test_columns_of_long_names_stand_apart(make: Maker, setup: Setup) -> None:
    fits = [
        fit(make(noise=0.02, seed=i), starts=1, setup=setup, effects="clamp_slip") for i in (0, 1)
    ]
    head, *rows = batch_of(fits).report().splitlines()[:4]
    assert "  clamp_slip.compliance (mm per N/mm)" in head
    assert {len(row) for row in rows} == {len(head)}
    warned = [Warned("swapped", f"{fits[0].tests[0].name}: dx is along y"), Warned("flat", "flat")]
    odd = replace(fits[0], quality=replace(fits[0].quality, warnings=warned))
    told = [line for line in batch_of([odd, fits[1]]).report().splitlines() if "WARNING" in line]
    name = odd.tests[0].name
    assert told[:2] == [f"WARNING: {name}: dx is along y", f"WARNING: {name}: flat"]
    fold = {
        "left_out": "one", "parameters": {"E1": 300.0, "clamp_slip.compliance": 0.02},
        "training": {"objective": "e_w", "value": 0.1},
        "left_out_objectives": {"e": 0.1, "e_w": 0.1, "e_z": None}, "at_bound": [],
    }  # fmt: skip
    told = CrossValidation(
        {
            "folds": [fold], "objective": "likelihood", "judged_by": "e", "mean": 0.1,
            "standard_deviation": None,
        }
    )  # fmt: skip
    assert told.report().splitlines()[-1] == "e left out: mean 0.1 mm"
    head, row = told.report().splitlines()[:2]
    assert "  clamp_slip.compliance (mm per N/mm)  training" in head
    assert len(row) == len(head)


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [(100.0, 2, "100"), (123.4, 2, "120"), (-86547.0, 4, "-86550"), (0.0123, 2, "0.012")],
)
def test_no_power_of_ten_stands_for_a_plain_number(value: float, digits: int, said: str) -> None:
    assert plain(value, digits) == said


def test_what_a_bad_fit_says_is_written_plainly() -> None:
    told = Quality(3.0, -865.47, 0.5, [0.1, 0.1, 0.1], [0.1, 0.2, 1.0], 1, 1, {}, []).lines()
    assert "-86550 % of the measured displacement explained" in told[0]
    assert "100, 100, 100 µm in dx, dy, dz, beside a noise of 100, 200, 1000 µm" in told[0]
