"""The blind trial: does the diagnosis find effects that it is not told?

    python benchmarks/trial.py [--number 200] [--seed 0] [--workers 2] [--folder FOLDER]
                               [--write FILE] [--score]

Four runs: all that tests may have; the true effects struck from the catalogue; sizes shrunk to
find what is just detectable; creases and knees. The tests of a run depend on its seed and number
alone. Its seeds, below 1000, are for calibration, while the program is worked on; those that no
program has seen are `trial_final.py`'s. A run in a FOLDER that was interrupted goes on where it
was, by the same command.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bulgefit
from bulgefit.gap.effects import CATALOGUE
from bulgefit.parallel.journal import journaled
from bulgefit.trial.known import FORMS, KNOWN
from bulgefit.trial.recording import Recipe
from bulgefit.trial.run import run_trial, score_folder
from trial_page import section

#: Sizes are divided by up to this: down to the noise, and, in the third run, below it.
TO_NOISE, SHRINK = 10.0, 30.0
#: Calibration takes seeds below this.
FIRST_FINAL = 1000


def runs(number: int) -> dict[str, dict[str, Any]]:
    """Options of each run; those after the first are smaller."""
    return {
        "All that tests may have": {"number": number, "recipe": Recipe(shrink=TO_NOISE)},
        "True effects struck": {
            "number": max(1, number // 4),
            "kinds": [*KNOWN],
            "strike": True,
            "options": {"effects": [*CATALOGUE]},
        },
        f"Sizes shrunk by up to {SHRINK:g}": {
            "number": max(1, number // 4),
            "kinds": [*KNOWN],
            "recipe": Recipe(shrink=SHRINK),
        },
        "Creases and knees": {"number": max(1, number // 8), "kinds": [*FORMS]},
    }


def page(results: Mapping[str, Mapping[str, Any]]) -> str:
    """All results as Markdown."""
    parts = [
        "# Results of the blind trial",
        f"Made by `python benchmarks/trial.py`; Python {platform.python_version()}. What the "
        "figures mean is told in [trial.md](trial.md).",
    ]
    for title, result in results.items():
        meta = result["meta"]
        words = f"{_count(meta)}, seed {meta['seed']}, {meta['seconds'] / 60:.0f} minutes."
        parts.append(section(title, words, result["scores"], result["tests"]))
    return "\n\n".join(parts) + "\n"


def _count(meta: dict[str, Any]) -> str:
    answered, number = meta["answered"], meta["number"]
    return f"{number} tests" if answered == number else f"The first {answered} of {number} tests"


def run(folder: Path, seed: int, workers: int, options: dict[str, Any]) -> dict[str, Any]:
    """The answers of one run: as they stand beside its folder, or what is left of it done."""
    ended, journal = folder.with_suffix(".json"), folder.with_suffix(".part")
    if ended.is_file():
        return dict(json.loads(ended.read_text(encoding="utf-8")))
    begun = journal.is_file()
    asked = {"version": bulgefit.__version__, "seed": seed, "number": options["number"]}
    with journaled(journal, asked, resume=True):
        answer = run_trial(
            seed=seed,
            output=folder,
            workers=workers,
            diagnose=bulgefit.diagnose,
            say=lambda line: print(line, file=sys.stderr, flush=True),
            resume=begun,
            **options,
        )
    ended.write_text(json.dumps(answer, indent=2) + "\n", encoding="utf-8")
    return dict(answer)


def main() -> None:
    """Run, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="below 1000")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--folder", type=Path, help="keep tests, truths and answers here")
    parser.add_argument(
        "--score", action="store_true", help="only score what the folder's runs have answered"
    )
    parser.add_argument("--write", type=Path, help="Markdown file for the tables")
    args = parser.parse_args()
    chosen = runs(args.number)
    if not 0 <= args.seed <= FIRST_FINAL - len(chosen):
        parser.error(
            f"--seed {args.seed}: give 0 to {FIRST_FINAL - len(chosen)}, a seed for each run"
        )
    if args.score:
        results = {
            title: score_folder(folder)
            for place, title in enumerate(chosen)
            if any((folder := args.folder / f"run{place + 1}").glob("answers/*.json"))
        }
        if args.write:
            args.write.write_text(page(results), encoding="utf-8")
        print(page(results))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found: dict[str, Mapping[str, Any]] = {}
        for place, (title, options) in enumerate(chosen.items()):
            print(f"== {title}", file=sys.stderr, flush=True)
            found[title] = run(folder / f"run{place + 1}", args.seed + place, args.workers, options)
            # after each run, so that an interrupted benchmark leaves what it found
            if args.write:
                args.write.write_text(page(found), encoding="utf-8")
    print(page(found))


if __name__ == "__main__":
    main()
