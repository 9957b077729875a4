"""What did the diagnosis find, to be seen? Figures and its page in a folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from bulgefit.errors import InputError
from bulgefit.files import atomic_write_text, check_folder, check_output
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.report._diagnosis_charts import plot_budget, plot_cosines
from bulgefit.report._diagnosis_fields import plot_component, plot_signatures
from bulgefit.report._diagnosis_maps import plot_modes, plot_where
from bulgefit.report._diagnosis_markdown import as_markdown
from bulgefit.report._diagnosis_parts import COMPONENTS
from bulgefit.report.page.of_diagnosis import page_of_diagnosis
from bulgefit.report.page.page import page_html
from bulgefit.report.record import Record, record_of
from bulgefit.report.stems import file_stems

__all__ = ["check_report", "write_report"]

#: What every test gets, beside its fields.
_OF_A_TEST = ("where_before", "where_after", "modes", "signatures")
_OF_ALL = ("budget.png", "cosines.png", "summary.md", "summary.html")


def check_report(
    names: Sequence[str], folder: str | os.PathLike[str], force: bool = False
) -> list[Path]:
    """Refuse a folder that cannot take a report, before the work for it is done.

    Parameters
    ----------
    names : sequence of str
        Of the tests.
    folder : path
        Made by `write_report` where it is missing.
    force : bool
        Whether files of an older report may be replaced.

    Returns
    -------
    list of Path
        Every file that a report may write.

    Raises
    ------
    InputError
    """
    folder = Path(folder)
    check_folder(folder)
    kinds = [*(f"field_{c}" for c in COMPONENTS), *_OF_A_TEST]
    files = [folder / f"{stem}_{kind}.png" for stem in file_stems(names) for kind in kinds]
    files += [folder / name for name in _OF_ALL]
    if folder.is_dir():
        for path in files:
            check_output(path, force)
    return files


def write_report(
    diagnosis: Diagnosis,
    folder: str | os.PathLike[str],
    *,
    record: Record | None = None,
    force: bool = False,
) -> list[Path]:
    """Draw a diagnosis into a folder, with a summary in plain words.

    Every test gets its fields, the map of its gap before and after, its azimuthal modes and the
    signatures of the leading effects; all tests together get the budget and the cosines between
    effects. `summary.html` is the page of the diagnosis and can be passed on alone.

    Parameters
    ----------
    diagnosis : Diagnosis
    folder : path
        Made if needed.
    record : mapping, optional
        What `record_of` gives, if it is known already; with the `run` of a command, the page tells
        it.
    force : bool
        Whether files of an older report may be replaced; those that this diagnosis has no use
        for are then removed.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        The folder cannot take them.
    """
    names = [t.name for t in diagnosis.tests]
    possible = check_report(names, folder, force)
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    written: list[tuple[Path, str]] = []

    record = record_of(diagnosis) if record is None else record
    path = folder / "budget.png"
    plot_budget(record, path, force=force)
    written.append((path, "What each effect takes off the gap, down to the noise"))
    for index, stem in enumerate(file_stems(names)):
        written += _draw_test(diagnosis, index, folder / stem, force)
    path = folder / "cosines.png"
    if plot_cosines(diagnosis, path, force=force):
        written.append((path, "How alike the effects are in this data"))

    page = page_of_diagnosis(record)
    pictures = [(p.name, c) for p, c in written]
    atomic_write_text(folder / "summary.md", as_markdown(page, pictures), force)
    atomic_write_text(folder / "summary.html", page_html(record, diagnosis.tests), force)
    files = [folder / "summary.html", folder / "summary.md", *(p for p, _ in written)]
    for left_over in {*possible} - {*files}:
        left_over.unlink(missing_ok=True)
    return files


def _draw_test(
    diagnosis: Diagnosis, index: int, start: Path, force: bool
) -> list[tuple[Path, str]]:
    """Figures of one test, with captions."""
    name = diagnosis.tests[index].name

    def path_of(kind: str) -> Path:
        return start.with_name(f"{start.name}_{kind}.png")

    out = []
    changed = bool(diagnosis.explanation.groups)
    where = partial(plot_where, diagnosis, index, force=force)
    where(path_of("where_before"), after=False)
    out.append((path_of("where_before"), f"{name}: where the gap lies"))
    if changed:
        where(path_of("where_after"), after=True)
        out.append((path_of("where_after"), f"{name}: what the causes leave of it"))
    plot_modes(diagnosis, index, path_of("modes"), force=force)
    out.append((path_of("modes"), f"{name}: azimuthal modes of the gap against pressure"))
    if plot_signatures(diagnosis, index, path_of("signatures"), force=force):
        out.append((path_of("signatures"), f"{name}: what each effect adds, beside the residual"))
    for component, label in enumerate(COMPONENTS):
        path = path_of(f"field_{label}")
        plot_component(diagnosis, index, component, path, force=force)
        out.append((path, f"{name}: {label} measured, modelled and left"))
    return out
