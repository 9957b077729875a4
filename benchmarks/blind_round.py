"""Diagnose every withheld test of a folder once and keep what was said, unedited.

python benchmarks/blind_round.py ../shared/blind/round1 --output benchmarks/blind/round1.json
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import bulgefit


def diagnosed(path: Path) -> tuple[str, dict[str, Any]]:
    """The diagnosis of one file, or why there is none."""
    try:
        return path.name, bulgefit.diagnose(bulgefit.read_test(path)).to_dict()
    except bulgefit.BulgefitError as error:
        return path.name, {"error": str(error)}


def main() -> int:
    """Diagnose the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    if args.output.exists():
        parser.error(f"{args.output} exists; a blind round is run once")
    files = sorted(args.folder.glob("*.npz"))
    said: dict[str, Any] = {}
    with ProcessPoolExecutor(args.workers) as pool:
        for name, answer in pool.map(diagnosed, files):
            said[name] = answer
            causes = ", ".join(c["effect"] for c in answer.get("causes", []))
            print(name, answer.get("verdict", answer.get("error")), causes, file=sys.stderr)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(said, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
