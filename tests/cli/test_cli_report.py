"""Does --report write one page, and is the same page drawn again from the JSON?"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from bulgefit.cli.main import main

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"
FIT = ["--refine", "2", "--starts", "1", "--max-pressure", "1", "--workers", "1", "--quiet"]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder with the test, the JSON of its fit and the page."""
    folder = tmp_path_factory.mktemp("fitted")
    shutil.copy(EXAMPLE, folder / "bulge.npz")
    words = ["fit", str(folder / "bulge.npz"), "--json", str(folder / "fit.json")]
    assert main([*words, "--report", str(folder / "page.html"), *FIT]) == 0
    return folder


@pytest.fixture
def folder(fitted, tmp_path, monkeypatch):
    """A copy that may be changed, as the working folder."""
    shutil.copytree(fitted, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    result = json.loads(Path("fit.json").read_text())
    result["sources"][0]["source"] = "bulge.npz"
    Path("fit.json").write_text(json.dumps(result))
    return tmp_path / "copy"


def refused(capsys, message, *words):
    before = sorted(Path().rglob("*"))
    assert main([*words, "--quiet"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert message in output.err
    assert sorted(Path().rglob("*")) == before


def test_a_page_says_how_it_was_made(fitted):
    result = json.loads((fitted / "fit.json").read_text())
    run = result["run"]
    assert run["command"].startswith("bulgefit fit ")
    assert " --max-pressure 1 " in run["command"]
    assert set(run["versions"]) >= {"bulgefit", "numpy", "python"}
    page = (fitted / "page.html").read_text()
    for text in (run["date"], run["command"], result["sources"][0]["sha256"], "Use E1 = "):
        assert text in page


def test_the_same_page_is_drawn_again(folder, fitted, capsys):
    assert main(["report", "fit.json"]) == 0
    assert capsys.readouterr().out == "fit.html\n"
    first, again = ((folder / name).read_text() for name in ("page.html", "fit.html"))
    added = "<tr><th>drawn from</th><td><code>fit.json</code></td></tr>\n"
    assert added in again
    again = again.replace(added, "").replace("(bulge.npz)", f"({fitted / 'bulge.npz'})")
    assert again == first


def test_a_json_that_moved_finds_the_test_beside_it(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder.parent)
    assert main(["report", "copy/fit.json", "--output", "x.html"]) == 0
    assert 'id="surface"' in Path("x.html").read_text()
    assert capsys.readouterr().err == ""


def test_a_folder_that_moved_holds_the_test_beside_the_json(folder, monkeypatch, capsys):
    """The test was read from elsewhere, which is not there any more."""
    told = json.loads(Path("fit.json").read_text())
    told["sources"][0]["source"] = "/measured/long ago/bulge.npz"
    Path("fit.json").write_text(json.dumps(told))
    assert main(["report", "fit.json"]) == 0
    assert 'id="surface"' in Path("fit.html").read_text()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda test: test.unlink(), "bulge.npz is no longer there"),
        (
            lambda test: shutil.copy(EXAMPLE.with_name("example_slip.npz"), test),
            "bulge.npz has changed since (its SHA-256 is another)",
        ),
        (lambda test: test.write_text("damaged"), "bulge has no maps: bulge.npz"),
    ],
)
def test_without_its_test_a_page_has_no_maps_and_says_so(folder, capsys, change, told):
    change(folder / "bulge.npz")
    assert main(["report", "fit.json"]) == 0
    assert told in capsys.readouterr().err
    page = Path("fit.html").read_text()
    assert told in page
    assert 'id="surface"' not in page
    assert "Use E1 = " in page


def test_what_is_no_result_is_refused(folder, capsys):
    refused(capsys, ".: is a folder; name the JSON of a result", "report", ".")
    Path("text.json").write_text("{")
    Path("list.json").write_text("[]")
    Path("other.json").write_text("{}")
    damaged = json.loads(Path("fit.json").read_text())
    del damaged["quality"]
    Path("damaged.json").write_text(json.dumps(damaged))
    refused(capsys, "nothing.json: cannot be read", "report", "nothing.json")
    refused(capsys, "text.json: no JSON of bulgefit", "report", "text.json")
    refused(capsys, "list.json: no JSON of bulgefit", "report", "list.json")
    refused(capsys, "other.json: no result of bulgefit fit", "report", "other.json")
    refused(capsys, "damaged.json: damaged", "report", "damaged.json")


def _without_cells(result):
    result["settings"]["cells"] = None


def _numbered(result):
    result["sources"][0]["source"] = 7


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda result: result.update(run="x"), "its run.reading does not say how"),
        (lambda result: result["run"].update(reading=3), "its run.reading does not say how"),
        (
            lambda result: result["run"]["reading"].update(max_pressure_bar="low"),
            "its run.reading does not say how",
        ),
        (lambda result: result["run"]["reading"].update(options=[1]), "its run.reading does not"),
        (_without_cells, "not as bulgefit fit writes it (a value is of another kind"),
        (_numbered, "its sources are no names, files and checksums"),
    ],
)
def test_what_was_changed_by_hand_is_told_as_damaged(folder, capsys, change, told):
    result = json.loads(Path("fit.json").read_text())
    change(result)
    Path("fit.json").write_text(json.dumps(result))
    refused(capsys, f"fit.json: damaged, {told}", "report", "fit.json", "--force")


def test_options_that_were_changed_by_hand_leave_no_maps(folder, capsys):
    result = json.loads(Path("fit.json").read_text())
    result["run"]["reading"]["options"]["radius"] = [1]
    Path("fit.json").write_text(json.dumps(result))
    assert main(["report", "fit.json", "--force"]) == 0
    assert "has no maps: " in capsys.readouterr().err


def test_outputs_are_refused_before_the_work(folder, capsys, monkeypatch):
    import bulgefit.fitting.fit

    monkeypatch.setattr(bulgefit.fitting.fit, "fit", lambda *_, **__: pytest.fail("began"))
    fit = ["fit", "bulge.npz"]
    refused(capsys, "page.html: exists; use --force", *fit, "--report", "page.html")
    refused(capsys, "give a name that ends in .html", *fit, "--report", "page.pdf")
    refused(capsys, "two outputs have this name", *fit, "--report", "p.html", "--json", "p.html")
    refused(capsys, "give a name that ends in .html", "report", "fit.json", "--output", "x.txt")
    refused(capsys, "page.html: exists", "report", "fit.json", "--output", "page.html")
    crossval = ["crossval", "bulge.npz", "bulge.npz", "--report", "nowhere/p.html"]
    refused(capsys, "nowhere does not exist", *crossval)
    trial = ["trial", "--output", "t", "--report", "page.html"]
    refused(capsys, "page.html: exists", *trial)


@pytest.mark.parametrize(
    "words",
    [
        ["info", "bulge.npz"],
        ["evaluate", "bulge.npz", "--undeformed"],
        ["simulate", "--E", "300", "--pressure", "1", "--refine", "2"],
        ["formats"],
    ],
)
def test_every_result_has_a_format_and_says_how_it_was_made(folder, capsys, words):
    assert main([*words, "--json", "-", "--quiet"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert isinstance(result["format"], int)
    assert result["run"]["command"] == " ".join(["bulgefit", *words, "--json", "-", "--quiet"])


def test_a_cross_validation_has_its_page(folder, capsys):
    shutil.copy(EXAMPLE.with_name("example_slip.npz"), "slip.npz")
    words = ["crossval", "bulge.npz", "slip.npz", "--json", "folds.json", "--report", "folds.html"]
    assert main([*words, *FIT]) == 0
    page = Path("folds.html").read_text()
    assert "A test that was left out is met within e_w" in page
    for source in json.loads(Path("folds.json").read_text())["sources"]:
        assert source["sha256"] in page
    assert main(["report", "folds.json", "--output", "again.html"]) == 0
    assert "drawn from" in Path("again.html").read_text()
