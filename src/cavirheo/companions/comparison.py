"""Comparison of answers (of sets of measurements, or in a result.json of `infer` or `fit`) with published values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from cavirheo.companions.published_values import ReferenceSet, by_group, read_references
from cavirheo.errors import InputError, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.io.files import expand, measurement_files
from cavirheo.io.shots import CurveSet, read_shots, shot_numbers
from cavirheo.physics.bubble import Requested
from cavirheo.physics.simulate import load_solver
from cavirheo.reporting import DOCUMENTS, html, outputs, read_json, result, table, write_report
from cavirheo.reporting.group import REFERENCE_METHODS
from cavirheo.reporting.record import Result
from cavirheo.workflow.store import Unfinished
from cavirheo.writing.document import Outputs, write_json, write_rows

_TABLE_NAME = "comparison.csv"
_LIQUID_NETWORKS = {"bdt-viscoelastic": "bdt-viscous"}  # network for gels: network for liquids


@dataclass(frozen=True)
class AnswerSettings:
    """Settings for sets that do not state their own; by default those of `infer`, but with the field's bubble.

    bubble: the field's, which published values assume. material: a law; by default nhkv, or Newtonian for a set whose
    published values have no modulus. Raises InputError: no such law or network.
    """

    model: str = DEFAULT
    material: str | None = None
    bubble: Requested = "field"
    trust_input: bool = False

    def __post_init__(self) -> None:
        Analysis("infer", self.model, self.material, self.bubble)

    def analysis(self, reference: ReferenceSet) -> Analysis:
        """The analysis of the shots of a set. Raises InputError, which names the set: a setting is not accepted."""
        model, law = self.model, reference.settings.get("material", self.material)
        if not reference.solid:  # use the paper's network for liquids
            model = _LIQUID_NETWORKS.get(model, model)
        model = str(reference.settings.get("model") or model)
        options: dict[str, Any] = {name: reference.settings.get(name) for name in ("stretch", "window")}
        options |= {"medium": reference.medium, "given": reference.given, "trust_input": self.trust_input}
        try:
            if law is None and model == DEFAULT:  # a network has its own
                law = "nhkv" if reference.solid else "newtonian"
            shot_numbers(reference.settings.get("shots"))
            return Analysis("infer", model, law, self.bubble, **options)
        except InputError as error:
            raise error.within(f"{reference.where}, set {reference.name!r}") from None


class ComparisonRun(NamedTuple):
    """The result, the number of unreadable files, and whether answers are missing (the first note says how many)."""

    result: Result
    unread: int = 0
    interrupted: bool = False


def compare(
    source: str | Path,
    references: str | Path,
    out: str | Path,
    *,
    settings: AnswerSettings | None = None,
    pairing: Sequence[str] = (),
    reference_methods: Sequence[str] = (),
    pictures: bool = True,
    command: str = "cavirheo compare",
    progress: bool = False,
) -> ComparisonRun:
    """Compare answers with published values; write result.json with both, report.html, and the comparison as a table
    into `out`.

    Each set is a group of the result; a set without recordings, or whose files are missing, has its published values
    alone. Answers are stored as they are found; after Ctrl-C only these are compared.

    Args:
        source: the folder to which the files of the sets are relative, or a result.json, whose groups are matched with
            the sets by name.
        references: the CSV file (published_values.py).
        settings: settings for sets that do not state their own; by default those of `infer`, with the field's bubble.
        pairing: groups of a result.json with their sets, "GROUP=SET", where the names differ.
        reference_methods: methods to which errors are relative; default: those REFERENCE_METHODS that are in the file.
        progress: show a bar on stderr.
        pictures: whether the report has pictures.

    Raises:
        InputError: a mistake in `references` (line, column, what was expected), an unknown model or method, a folder
            that cannot be read or written, or a file in `out` that cavirheo did not write.
    """
    source, references, out = Path(source), Path(references), Path(out)
    message = f"{source} is neither a folder nor a result.json: give the folder that holds the sets of measurements"
    require(source.is_dir() or (source.is_file() and source.suffix == ".json"), message, "compare.folder")
    sets = {reference.name: reference for reference in read_references(references)}
    published = {name: reference.values for name, reference in sets.items()}
    methods = list(dict.fromkeys(method for values in published.values() for method in values))
    for name in reference_methods:
        message = f"reference method {name!r}: not in {references}; it has {', '.join(methods) or 'none'}"
        require(name in methods, message, "compare.method")
    against = list(dict.fromkeys(reference_methods)) or [name for name in REFERENCE_METHODS if name in methods]
    none = f"no relative errors: {references} has no method {' or '.join(REFERENCE_METHODS)}; see --reference-method"
    notes = [] if against else [none]
    head: dict[str, Any] = {"command": command, "date": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")}
    inputs = [references, *([source] if source.is_file() else [])]
    table_outputs = partial(Outputs, out, _TABLE_NAME, inputs=inputs)  # each call reads the folder again
    table_outputs()
    if source.is_file():
        message = f"{source} is not answered again: leave out --model, --material, --bubble and --trust-input"
        require(settings in (None, AnswerSettings()), message, "compare.answered")
        earlier = read_json(source)
        document = earlier.model_copy(update={**head, "notes": [*earlier.notes, *notes]})
        document.add_published(by_group((group.name for group in document.groups), published, pairing), against)
        report = Outputs(out, *DOCUMENTS, inputs=inputs)  # the same documents, without pictures of shots
        report.write("result.json", write_json, document)
        report.write("result.csv", write_rows, *table.csv_rows(document))
        report.write("report.html", html.write, document)
        report.finish()
        _write_table(table_outputs(), document)
        return ComparisonRun(document)
    require(not pairing, f"{source} is a folder, whose groups are the sets: leave out --set", "compare.pairing")
    settings = settings or AnswerSettings()
    analyses = {name: settings.analysis(reference) for name, reference in sets.items()}  # checked before any shot
    files = {name: files_of(reference, source, references) for name, reference in sets.items() if reference.recorded}
    answered = source / "result.json"
    remedy = f"to compare answers give {answered}" if answered.is_file() else "give the folder that holds them"
    message = f"{source} holds no recording of the {len(files)} sets of {references}: {remedy}"
    require(not files or any(found for found, _ in files.values()), message, "compare.no_recording")
    shots = _distinct_names({name: shots_of(reference, *files.get(name, ())) for name, reference in sets.items()})
    notes = [f"{name}: {note}" for name, read in shots.items() for note in read.problems + read.remarks] + notes
    curves = [curve for read in shots.values() for curve in read.curves]
    unread = sum(len(read.problems) for read in shots.values())
    unfinished, report = Unfinished(out, visible=progress), outputs(out, curves)
    load_solver()
    answers = {name: unfinished.answers(read.curves, analyses[name]) for name, read in shots.items()}
    pairs = [(shots[name].curves[i], answer) for name, of in answers.items() for i, answer in of.numbered()]
    note = unfinished.note(len(pairs), len(curves))
    if note and report.listed_entry("report.html"):  # the earlier report stays until all is answered
        interrupted = result(pairs, command, notes=[f"{note}; until then the earlier answers stay"])
        return ComparisonRun(interrupted, unread, True)
    head |= {"notes": [note, *notes] if note else notes, "complete": not note, "draw": pictures}
    document = write_report(out, pairs, **head, published=published, references=against)
    _write_table(table_outputs(), document)
    if not note:
        unfinished.remove()
    return ComparisonRun(document, unread, bool(note))


def _write_table(outputs: Outputs, document: Result) -> None:
    """Write the table of the comparison beside result.json."""
    outputs.write(_TABLE_NAME, table.write_comparison, document)
    outputs.finish()


def _distinct_names(sets: Mapping[str, CurveSet]) -> dict[str, CurveSet]:
    """The sets, each with its own group; a shot name that several sets share gets the name of the set before it."""
    names = Counter(curve.name for shots in sets.values() for curve in shots.curves)
    distinct = {}
    for name, shots in sets.items():
        curves = [curve.with_group(name, "") for curve in shots.curves]
        curves = [curve.labelled(name=f"{name}/{curve.name}") if names[curve.name] > 1 else curve for curve in curves]
        distinct[name] = shots._replace(curves=curves)
    return distinct


def files_of(reference: ReferenceSet, folder: Path, references: Path) -> tuple[list[Path], list[str]]:
    """The recordings of a set in the folder, without the file `references`; and notes on other files that match."""
    name = reference.settings.get("files", reference.name)
    files, left = list[Path](), list[Path]()
    # an absolute pattern, or a name that no file can have
    with suppress(InputError, ValueError, NotImplementedError, OSError):
        named = folder / name
        files = [named] if named.is_file() else []
        places = [named] if named.exists() else sorted(folder.glob(name))
        for path in places if not files else []:
            if path.name[:1] in ("", "."):
                continue
            taken, inside = measurement_files(path.parent)[0], [path]
            if path.is_dir():
                taken, inside = [], sorted(path.iterdir())
                with suppress(InputError):
                    taken = expand([path])
            files += [path] if taken == [path] else [file for file in inside if file in taken]
            left += [file for file in inside if file not in taken and file.is_file() and file.name[0] != "."]
    files = [file for file in files if file.resolve() != references.resolve()]
    ignored = ", ".join(file.name for file in left)
    return files, [f"left out, for they do not look like measurements: {ignored}"] if ignored else []


def shots_of(reference: ReferenceSet, files: Sequence[Path] = (), notes: Sequence[str] = ()) -> CurveSet:
    """The curves of a set from its files, with hints as remarks."""
    settings, notes = reference.settings, list(notes)
    if not reference.recorded:
        return CurveSet([], [], ["no open recording: published values alone"], [])
    if not files:
        return CurveSet([], [f"no file matches {settings.get('files', reference.name)!r}"], notes, [])
    constants: Any = {"density": reference.medium.density, "pressure": reference.medium.pressure}
    scale, shots = settings["rmax_um"] * 1e-6 if "rmax_um" in settings else None, settings.get("shots")
    try:
        curves, problems, repeated, hints = read_shots(files, max_radius=scale, shots=shots, **constants)
    except InputError as error:  # an R_max that does not fit these shots
        return CurveSet([], [str(error)], notes, [])
    values = {key: f"{value:g}" if isinstance(value, float) else value for key, value in settings.items()}
    words = ", ".join(f"{key} {value}" for key, value in values.items() if key != "files")
    notes += [*repeated, *hints, *([f"with {words}"] if words else [])]
    return CurveSet(curves, problems, notes, [])
