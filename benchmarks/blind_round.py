"""Diagnose every withheld test of a folder once and keep what was said, unedited.

Files `clothA_1.npz`, `clothA_2.npz`, ... are specimens of one cloth: they are judged together, and
their answer stands under `clothA`. Every other file is judged alone, and stands under its own name.
What is there is written after each answer.

python benchmarks/blind_round.py ../shared/blind/round2 --output benchmarks/blind/round2.json
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import re
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import bulgefit

FAMILY = re.compile(r"(?P<cloth>cloth[^_]+)_\d+")


def cases(folder: Path) -> dict[str, list[Path]]:
    """Files that are judged together, by the name of their answer; families, the longest, first."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*.npz")):
        family = FAMILY.fullmatch(path.stem)
        found.setdefault(family["cloth"] if family else path.name, []).append(path)
    return dict(sorted(found.items(), key=lambda case: -len(case[1])))


def diagnosed(paths: list[Path]) -> dict[str, Any]:
    """The diagnosis of one file or family, or why there is none."""
    try:
        return bulgefit.diagnose([bulgefit.read_test(path) for path in paths]).to_dict()
    except bulgefit.BulgefitError as error:
        return {"error": str(error)}


def main() -> int:
    """Diagnose the folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    if args.output.exists():
        parser.error(f"{args.output} exists; a blind round is run once")
    args.output.parent.mkdir(parents=True, exist_ok=True)
    said: dict[str, Any] = {}
    with ProcessPoolExecutor(args.workers) as pool:
        running = {
            pool.submit(diagnosed, paths): name for name, paths in cases(args.folder).items()
        }
        for done in as_completed(running):
            name, answer = running[done], done.result()
            said[name] = answer
            args.output.write_text(json.dumps(dict(sorted(said.items())), indent=1) + "\n")
            causes = ", ".join(c["effect"] for c in answer.get("causes", []))
            print(name, answer.get("verdict", answer.get("error")), causes, file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
