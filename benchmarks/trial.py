"""The blind trial: does the diagnosis find effects that it is not told?

    python benchmarks/trial.py [--number 200] [--seed 0] [--workers 2] [--folder FOLDER]
                               [--write docs/trial_results.md] [--score]

Three runs: whole catalogue; the true effect struck from it; sizes shrunk to find what is just
detectable. The tests of a run depend on its seed and number alone.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

import bulgefit
from bulgefit.trial.draw import FORMS, KNOWN
from bulgefit.trial.make import Recipe
from bulgefit.trial.run import run_trial, score_folder
from bulgefit.trial.score import report

#: Sizes of the third run are divided by up to this.
SHRINK = 30.0


def runs(number: int) -> dict[str, dict[str, Any]]:
    """Options of each run; the second and third are smaller."""
    return {
        "Whole catalogue": {"number": number},
        "True effect struck": {"number": max(1, number // 4), "kinds": [*KNOWN], "strike": True},
        f"Sizes shrunk by up to {SHRINK:g}": {
            "number": max(1, number // 4),
            "kinds": [*KNOWN],
            "recipe": Recipe(shrink=SHRINK),
        },
        "Creases and knees": {"number": max(1, number // 8), "kinds": [*FORMS]},
    }


def page(results: dict[str, dict[str, Any]]) -> str:
    """All results as Markdown."""
    parts = [
        "# Results of the blind trial",
        f"Made by `python benchmarks/trial.py`; Python {platform.python_version()}. What the "
        "figures mean is told in [trial.md](trial.md).",
    ]
    for title, result in results.items():
        meta = result["meta"]
        parts += [
            f"## {title}",
            f"{_count(meta)}, seed {meta['seed']}, {meta['seconds'] / 60:.0f} minutes.",
            f"```\n{report(result['scores'])}\n```",
        ]
        wrong = [t for t in result["tests"] if not t["right"]]
        if wrong:
            parts += ["Not right:", "\n".join(_line(t) for t in wrong)]
    return "\n\n".join(parts) + "\n"


def _count(meta: dict[str, Any]) -> str:
    answered, number = meta["answered"], meta["number"]
    return f"{number} tests" if answered == number else f"The first {answered} of {number} tests"


def _line(test: dict[str, Any]) -> str:
    causes = " + ".join("/".join(cause) for cause in test["causes"])
    return (
        f"- {test['file']}: {' + '.join(test['truth']) or 'none'} "
        f"({test['signature_mm']:.3f} mm) answered {test['verdict']} {causes}".rstrip()
    )


def main() -> None:
    """Run, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--folder", type=Path, help="keep tests, truths and answers here")
    parser.add_argument(
        "--score", action="store_true", help="only score what the folder's runs have answered"
    )
    parser.add_argument("--write", type=Path, help="Markdown file for the tables")
    args = parser.parse_args()
    if args.score:
        results = {
            title: score_folder(folder)
            for place, title in enumerate(runs(args.number))
            if any((folder := args.folder / f"run{place + 1}").glob("answers/*.json"))
        }
        if args.write:
            args.write.write_text(page(results), encoding="utf-8")
        print(page(results))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        results = {}
        for place, (title, options) in enumerate(runs(args.number).items()):
            print(f"== {title}", file=sys.stderr, flush=True)
            results[title] = run_trial(
                seed=args.seed + place,
                output=folder / f"run{place + 1}",
                workers=args.workers,
                diagnose=bulgefit.diagnose,
                say=lambda line: print(line, file=sys.stderr, flush=True),
                **options,
            )
            (folder / f"run{place + 1}.json").write_text(
                json.dumps(results[title], indent=2) + "\n", encoding="utf-8"
            )
            # after each run, so that an interrupted benchmark leaves what it found
            if args.write:
                args.write.write_text(page(results), encoding="utf-8")
    print(page(results))


if __name__ == "__main__":
    main()
