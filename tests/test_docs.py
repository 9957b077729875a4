"""Do the pages name what there is?"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BENCHMARKS = ROOT / "benchmarks"
VERIFICATION = (DOCS / "verification.md").read_text(encoding="utf-8")
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_tests_that_are_named_exist():
    texts = {
        path.name: path.read_text(encoding="utf-8")
        for path in Path(__file__).parent.rglob("test_*.py")
    }
    named = set(re.findall(r"`(test_\w+\.py)::(test_\w+)", VERIFICATION))
    assert len(named) > 100
    for file, name in sorted(named):
        assert f"def {name}(" in texts[file], name


def test_mutants_that_are_told_are_those_that_are_tried():
    mutants = runpy.run_path(str(BENCHMARKS / "mutations.py"))["MUTANTS"]
    rows = [line for line in VERIFICATION.splitlines() if re.search(r"\| `test_\w+\.py::", line)]
    for row, one in zip(rows, mutants, strict=True):
        assert row.startswith(f"| `{one.file}` | `{one.old}` | `{one.new}` | ")
        source = (ROOT / "src" / "bulgefit" / one.file).read_text(encoding="utf-8")
        assert source.count(one.old) == 1, one.old
    assert f"each of its {len(mutants)} mutants" in VERIFICATION
    assert f"evidence in {len(mutants)} ways" in CHANGES


def test_every_page_is_linked_from_the_index():
    """For a code host, which draws no table of contents, and for the site, which hides it."""
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = {path.name for path in DOCS.glob("*.md")} - {"index.md"}
    examples = {f"examples/{path.name}" for path in (DOCS / "examples").glob("plot_*.py")}
    assert set(re.findall(r"\]\(([^)]+)\)", index)) == pages | examples
    listed = re.findall(r"^(\w+)$", index, re.MULTILINE)
    assert sorted(f"{name}.md" for name in listed) == sorted(pages)


@pytest.mark.parametrize("page", sorted(path.name for path in DOCS.glob("*.md")))
def test_links_of_pages_lead_somewhere(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if not target.startswith("https://"):
            assert (DOCS / target).exists(), target


@pytest.mark.parametrize("page", sorted(path.name for path in DOCS.glob("*.md")))
def test_every_mark_of_a_section_that_a_command_makes_has_its_end(page):
    """And commands that make one have its name: what they make would be put at the end else."""
    marks = re.findall(r"^<!-- (.+) -->$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert marks[1::2] == [f"end of {name}" for name in marks[::2]]
    made = "".join(path.read_text(encoding="utf-8") for path in BENCHMARKS.glob("*.py"))
    for name in marks[::2]:
        assert f'marked("{name}", ' in made or f'"{name}": lambda: ' in made, name


def test_a_section_goes_where_it_stood_and_what_is_beside_it_stays(tmp_path):
    sections = runpy.run_path(str(BENCHMARKS / "sections.py"))
    marked, put = sections["marked"], sections["put"]
    page = tmp_path / "page.md"
    for text in (r"a \1", "b"):
        put(marked("one", text), page)
        put(marked("two", text), page)
        page.write_text(page.read_text(encoding="utf-8") + "\nby hand\n", encoding="utf-8")
    put(marked("one", "c\n\nd\n"), page)
    assert page.read_text(encoding="utf-8") == (
        "<!-- one -->\nc\n\nd\n<!-- end of one -->\n\n<!-- two -->\nb\n<!-- end of two -->\n"
        "\nby hand\n\nby hand\n"
    )
