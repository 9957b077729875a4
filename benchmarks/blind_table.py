"""Tell what was said of a round of withheld tests, as Markdown.

python benchmarks/blind_table.py benchmarks/blind/round2.json --write docs/blind.md
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

#: What is to be known of a round beside its answers.
NOTES = {
    "round2": "Each was run once, two at a time on two cores. `clothB` and `clothC` have no "
    "answer: at a shear modulus of 1e-6 MPa a difference of 1e-3 MPa leads below zero. Such steps "
    "are refused now; these answers are of before."
}


def row(name: str, answer: Mapping[str, Any]) -> list[str]:
    """A row of the table."""
    if "error" in answer:
        return [name, "no answer", answer["error"], "", "", ""]
    fields = [
        f"{f['field']}{_owner(f)} ({f['probability']:.3f}), largest at "
        + ", ".join(f"{k} {v:.3g}" for k, v in f["where"].items())
        for f in answer["fields"]
    ]
    causes = [f"{c['effect']}{_owner(c)} ({c['probability']:.3f})" for c in answer["causes"]]
    moduli = answer["parameters"]["corrected"]
    found = [
        f"{m} {moduli[m]['value']:.4g} ± {moduli[m]['stderr']:.2g}" for m in ("E1", "E2", "G12")
    ]
    return [
        name, answer["verdict"], ", ".join(causes), ", ".join(fields), ", ".join(found),
        f"{answer['meta']['seconds']:.0f}",
    ]  # fmt: skip


def _owner(part: Mapping[str, Any]) -> str:
    """Of which specimen, where there are several."""
    owner = part.get("specimen")
    return "" if owner is None else f" of {owner + 1}"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("answers", type=Path)
    parser.add_argument("--write", type=Path, help="Markdown file")
    args = parser.parse_args()
    said = json.loads(args.answers.read_text(encoding="utf-8"))
    head = ["test", "verdict", "causes (probability)", "fields", "moduli, MPa", "s"]
    lines = [head, ["---"] * len(head), *(row(name, answer) for name, answer in said.items())]
    text = "\n\n".join(
        [
            "# Withheld tests of another program",
            f"Made by `python benchmarks/blind_table.py {args.answers.as_posix()}` of what "
            "`benchmarks/blind_round.py` kept. The truth of these tests is not known here, so that "
            "nothing is scored. Specimens of one cloth are judged together.",
            NOTES.get(args.answers.stem, ""),
            "\n".join("| " + " | ".join(line) + " |" for line in lines),
        ]
    )
    if args.write:
        args.write.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
