"""What does a diagnosis say on a terminal?"""

from __future__ import annotations

from bulgefit.report._diagnosis_cloth import cloth_lines, secant_rows
from bulgefit.report.record import Record
from bulgefit.report.words.causes import evidence_words, parameter_rows
from bulgefit.report.words.gaps import GAP_COLUMNS, gap_rows, held_out_words, moduli_rows
from bulgefit.report.words.left import remainder_items
from bulgefit.report.words.names import with_rivals
from bulgefit.report.words.next import action_items, advice_items
from bulgefit.report.words.notes import alarms_of, note_items
from bulgefit.report.words.unnamed import field_items
from bulgefit.report.words.verdict import verdict_words

__all__ = ["table"]


def table(record: Record) -> str:
    """The diagnosis to read on a terminal."""
    lines = [line for alarm in alarms_of(record) for line in _wrapped(alarm, "WARNING: ")]
    lines += [f"verdict: {record['verdict']}", *_wrapped(verdict_words(record))]
    for cause in record["causes"]:
        lines += ["", f"{with_rivals(record, cause)}: {cause['meaning']}"]
        rows = list(parameter_rows(record, cause))
        width = max(len(name) for name, _ in rows)
        lines += [f"  {name:<{width}}  {text}" for name, text in rows]
        lines += _wrapped(evidence_words(cause))
    lines += ["", f"{'gap (mm; chi in noise)':<26}" + "".join(f"{c:>9}" for c in GAP_COLUMNS)]
    lines += [
        f"{label:<26}" + "".join(f" {gap[c]:>8.4f}" for c in GAP_COLUMNS)
        for label, gap in gap_rows(record)
    ]
    lines += _wrapped(held_out_words(record))
    lines += ["", f"{'moduli (MPa)':<26}{'moduli alone':<24}with causes"]
    lines += [f"{m:<26}{alone:<24}{final}" for m, alone, final in moduli_rows(record)]
    lines += [
        f"{row[0]:<26}" + "".join(f"{cell:<16}" for cell in row[1:]).rstrip()
        for row in secant_rows(record)
    ]
    parts = {
        "unnamed": field_items(record),
        "cloth": cloth_lines(record),
        "left": remainder_items(record)[:3],
        "next": (*action_items(record), *advice_items(record)),
        "note": note_items(record),
    }
    for title, items in parts.items():
        lines += [""] * bool(items)
        for item in items:
            lines += _wrapped(item, f"{title}: ")
    return "\n".join(lines)


def _wrapped(text: str, start: str = "  ") -> list[str]:
    from textwrap import wrap

    return wrap(
        text, 98, initial_indent=start, subsequent_indent=" " * len(start), break_on_hyphens=False
    )
