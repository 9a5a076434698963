"""Published values beside ours, for a folder of sets of measurements: a table for papers and a picture.

| module | does |
|---|---|
| references | the CSV file of published values, written by hand |
| record | comparison.json: the rows, with relative errors |
| table | the terminal, Markdown, CSV |
| picture | G and mu of all sets by all methods (needs the [plot] extra) |

The answers are those of `cavirheo infer` or `cavirheo fit`, and so are the reports, one per set in its own folder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from cavirheo.beside.published.record import Comparison, SetRecord, set_record
from cavirheo.beside.published.references import ReferenceSet, read_references
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import infer_many
from cavirheo.inference.law import Family
from cavirheo.inference.model import DEFAULT, load
from cavirheo.inference.reconstruct import check_stretch
from cavirheo.reading.shots import read_shots
from cavirheo.reporting import file_names, write_report
from cavirheo.writing.document import into, write_json

__all__ = ["REFERENCES", "compare"]

REFERENCES = ("IMR", "rheometer")  # errors are relative to these where the file has them and the user names none
_MEASUREMENTS = {".mat", ".csv", ".txt", ".h5", ".hdf5", ".xlsx"}  # what is taken of a subfolder
_OUTPUTS = ("comparison.json", "comparison.csv", "comparison.md", "comparison.png")
_NO_PICTURE = 'comparison.png is left out: matplotlib is not installed; pip install "cavirheo[plot]"'


def compare(
    folder: str | Path,
    references: str | Path,
    out: str | Path,
    *,
    model: str = DEFAULT,
    fit: str | None = None,
    reference_methods: Sequence[str] = (),
    command: str = "cavirheo compare",
    done: Callable[[int], None] | None = None,
) -> Comparison:
    """Infer, or fit, every set that `references` names and write the comparison, and a report per set, into `out`.

    Args:
        folder: what the files of the sets are relative to.
        references: the CSV file (references.py).
        model: for sets that name none.
        fit: a law, such as "nhkv": least squares (inference/fit) in the place of networks, Newtonian for sets whose
            model is that of a Newtonian liquid.
        reference_methods: those to which errors are relative; default: of REFERENCES those in the file.
        done: called after each shot with the number of all shots.

    A set whose files are missing or unreadable keeps its row and says so in `problems`; a shot without an answer is
    counted.

    Raises:
        InputError: a mistake in `references` (line, column, what was expected), an unknown model or reference method,
            or a folder that cannot be read or written.
    """
    if fit:
        Family(fit)
    folder, references, out = Path(folder), Path(references), Path(out)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; expected the folder that holds the sets of measurements")
    sets = read_references(references)
    methods = list(dict.fromkeys(method for about in sets for method, _ in about.values))
    against, notes = _against(reference_methods, methods, references)
    for about in sets:
        _check(about, model, references)
    found = [shots_of(about, folder, references) for about in sets]
    total = sum(len(curves) for curves, *_ in found)
    names = file_names([*_OUTPUTS, *(about.name for about in sets)])[len(_OUTPUTS) :]
    records: list[SetRecord] = []
    for about, name, (curves, files, problems, left_out) in zip(sets, names, found, strict=True):
        which = about.settings.get("model", model)
        options: dict[str, Any] = {name: about.settings.get(name) for name in ("stretch", "window")}
        options |= {"medium": about.medium, "done": (lambda: done(total)) if done else None}
        if fit:
            from cavirheo.inference.fit import fit_many

            which = "newtonian" if load(which).card["material"] == "newtonian" else fit
            answers = fit_many(curves, which, windows=False, **options)
            which = f"least squares, {which}"
        else:
            answers = infer_many(curves, model=which, **options)
        rows = write_report(out / name, list(zip(curves, answers, strict=True)), command).curves if curves else []
        records.append(
            set_record(
                about,
                rows,
                against,
                files=[str(file.relative_to(folder) if file.is_relative_to(folder) else file) for file in files],
                model=which,
                medium=asdict(about.medium),
                report=f"{name}/report.html" if curves else None,
                problems=problems,
                notes=left_out,
            )
        )
    date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    comparison = Comparison(
        command=command, date=date, methods=methods, reference_methods=against, sets=records, notes=notes
    )
    _write(out, comparison)
    return comparison


def _against(wanted: Sequence[str], methods: list[str], references: Path) -> tuple[list[str], list[str]]:
    """The reference methods, and a note if there is none."""
    for name in wanted:
        if name not in methods:
            raise InputError(f"reference method {name!r}: not in {references}; it has {', '.join(methods) or 'none'}")
    against = list(dict.fromkeys(wanted)) or [name for name in REFERENCES if name in methods]
    if against:
        return against, []
    return [], [f"no relative errors: {references} has no method {' or '.join(REFERENCES)}; see --reference-method"]


def _check(about: ReferenceSet, model: str, references: Path) -> None:
    """What only inference can judge, before the first shot costs time."""
    try:
        load(about.settings.get("model", model))
    except InputError as error:
        line = about.lines.get("model")
        raise InputError(f"{references}, line {line}, column model: {error}" if line else str(error)) from None
    try:
        check_stretch(about.settings.get("stretch"))
    except InputError as error:
        raise InputError(f"{references}, line {about.lines['stretch']}, column stretch: {error}") from None


def shots_of(
    about: ReferenceSet, folder: Path, references: Path
) -> tuple[list[RadiusCurve], list[Path], list[str], list[str]]:
    """(curves, files, problems, what was left out) of a set."""
    try:
        matches = [folder / about.files] if (folder / about.files).exists() else sorted(folder.glob(about.files))
    except (ValueError, NotImplementedError, OSError):  # an absolute pattern, or a name that no file can have
        matches = []
    candidates = [f for path in matches for f in (sorted(path.iterdir()) if path.is_dir() else [path])]
    files: list[Path] = []
    left_out: list[Path] = []
    for file in candidates:
        in_folder = file not in matches
        if file.is_dir() or file.name.startswith(".") or file.resolve() == references.resolve():
            continue
        (left_out if in_folder and file.suffix.lower() not in _MEASUREMENTS else files).append(file)
    notes = [f"left out, for they do not look like measurements: {', '.join(f.name for f in left_out)}"]
    if not files:
        return [], [], [f"no file matches {about.files!r} in {folder}"], notes if left_out else []
    curves, problems = read_shots(
        files,
        density=about.medium.density,
        pressure=about.medium.pressure,
        max_radius=about.settings["rmax_um"] * 1e-6 if "rmax_um" in about.settings else None,
    )
    return curves, files, problems, notes if left_out else []


def _write(out: Path, comparison: Comparison) -> None:
    from cavirheo.beside.published import picture, table
    from cavirheo.reporting.picture import save_png
    from cavirheo.writing import style

    if not style.available():
        comparison.notes.append(_NO_PICTURE)
    with into(out):
        write_json(out / "comparison.json", comparison)
        table.write_csv(out / "comparison.csv", comparison)
        (out / "comparison.md").write_text(table.markdown(comparison), encoding="utf-8")
        if style.available():
            save_png(out / "comparison.png", picture.figure(comparison))
