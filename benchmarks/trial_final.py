"""The final test of the diagnosis: 300 made tests of seeds that no program has seen, in six parts.

    python benchmarks/trial_final.py PART --folder FOLDER [--workers 2]
    python benchmarks/trial_final.py --write docs/trial_results.md

Each part is the 50 tests of a seed of its own, takes one to two hours on two cores, and keeps their
truths and answers in benchmarks/final, with the commit of the program; a part that was interrupted
goes on in its folder, by the same command, and one that is kept is not run again. Without a part
those that are kept are scored together.
"""

from __future__ import annotations

from trial import TO_NOISE, run  # first: pins the threads
from trial_page import section

import argparse  # isort: skip
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bulgefit
from bulgefit.errors import BulgefitError
from bulgefit.trial.folder import answered_in
from bulgefit.trial.recording import Recipe
from bulgefit.trial.score import judge, score
from sections import marked, put

#: One for each part; no other run has them.
SEEDS = tuple(range(1119, 1125))
#: Tests of a part.
NUMBER = 50
KEPT = Path(__file__).parent / "final"
#: What is kept of an answer: what was said. How it was come to, and fields' maps, are many times
#: that.
SAID = (
    "verdict", "error", "causes", "fields", "law", "scatter", "parameters", "gap", "seconds",
)  # fmt: skip


def commit() -> str:
    """The commit of the package that runs; it may not have been changed since."""
    package = Path(bulgefit.__file__).parent

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(package), *words], check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    if git("status", "--porcelain", "."):
        raise SystemExit(f"{package}: has changes that are not committed; a final test is of one")
    return git("rev-parse", "--short=10", "HEAD")


def answer(part: int, folder: Path, workers: int) -> None:
    """Run what is left of a part, and keep what was said."""
    program, place = commit(), folder / f"part{part}"
    begun = place.with_suffix(".commit")
    if begun.is_file() and begun.read_text(encoding="utf-8") != program:
        raise SystemExit(f"{place}: begun by {begun.read_text('utf-8')}, goes on by that alone")
    begun.write_text(program, encoding="utf-8")
    run(place, SEEDS[part - 1], workers, {"number": NUMBER, "recipe": Recipe(shrink=TO_NOISE)})
    asked, _, records = answered_in(place)
    for record in records:
        said = {k: record["answer"][k] for k in SAID if k in record["answer"]}
        fields = [{k: v for k, v in f.items() if k != "map"} for f in said.get("fields") or ()]
        record["answer"] = {**said, "fields": fields}
    KEPT.mkdir(exist_ok=True)
    lines = [{"program": program, **asked}, *records]
    _kept(part).write_text("".join(f"{json.dumps(line)}\n" for line in lines), encoding="utf-8")


def _kept(part: int) -> Path:
    """What was asked in a line of JSON, then a line for each test."""
    return KEPT / f"part{part}.jsonl"


def page(parts: Sequence[dict[str, Any]]) -> str:
    """The parts, scored together."""
    records = [
        {**record, "file": f"{part['seed']}/{record['file']}"}
        for part in parts
        for record in part["records"]
    ]
    seeds, programs = (
        ", ".join(dict.fromkeys(str(part[key]) for part in parts)) for key in ("seed", "program")
    )
    hours = sum(record["answer"]["seconds"] for record in records) / 3600
    words = (
        f"`python benchmarks/trial_final.py`, {len(parts)} of its {len(SEEDS)} parts: seeds "
        f"{seeds}, none of which was run before, each run once and told as it came. The answers "
        f"are in `benchmarks/final`, by the program of commit {programs}; they took {hours:.1f} "
        "hours of one core."
    )
    title = f"The final test: {len(records)} of {NUMBER * len(SEEDS)} tests"
    return section(title, words, score(records), [judge(record) for record in records])


def main() -> None:
    """Run a part, or score all that are kept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", type=int, nargs="?", choices=range(1, len(SEEDS) + 1))
    parser.add_argument("--folder", type=Path, help="tests, truths and answers of a part")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--write", type=Path, help="page whose section of the final test is made")
    args = parser.parse_args()
    if args.part is not None and not _kept(args.part).is_file():
        if args.folder is None:
            parser.error("a part needs --folder: what is answered is kept there")
        args.folder.mkdir(parents=True, exist_ok=True)
        answer(args.part, args.folder, args.workers)
    files = [file for part in range(1, len(SEEDS) + 1) if (file := _kept(part)).is_file()]
    if not files:
        parser.error(f"{KEPT}: no part is kept yet; name one")
    parts = [list(map(json.loads, file.read_text("utf-8").splitlines())) for file in files]
    made = page([{**asked, "records": records} for asked, *records in parts])
    if args.write:
        put(marked("final test", made), args.write)
    print(made)


if __name__ == "__main__":
    try:
        main()
    except BulgefitError as error:
        sys.exit(f"trial_final: {error}")
