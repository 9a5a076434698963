"""The answers of `infer` or `fit` beside published values: an analysis of sets of measurements, or a result.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from cavirheo.companions.published_values import ReferenceSet, by_group, read_references
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.law import Family
from cavirheo.inference.model import Network
from cavirheo.inference.posterior_model import network_of
from cavirheo.io.files import MEASUREMENTS
from cavirheo.io.shots import read_shots, shot_numbers
from cavirheo.parallel import aside
from cavirheo.physics.bubble import Requested
from cavirheo.physics.simulate import load_solver
from cavirheo.reporting import DOCUMENTS, outputs, read_json, result, write_report
from cavirheo.reporting import comparison as tables
from cavirheo.reporting.group import REFERENCES, Published
from cavirheo.reporting.record import Result
from cavirheo.workflow.analyse import Unfinished
from cavirheo.writing import style
from cavirheo.writing.document import Outputs, write_json

_TABLES = ("comparison.md", "comparison.csv", "comparison.png")
_OF_LIQUIDS = {"bdt-viscoelastic": "bdt-viscous"}  # by the network of gels
_NO_PICTURE = 'comparison.png is left out: matplotlib is not installed; pip install "cavirheo[plot]"'


@dataclass(frozen=True)
class Answering:
    """How sets are answered that do not say so themselves: as `infer` does, or by least squares of the law `fit`.

    bubble: the field's is that which published values assume. material: a law; by default that of `infer`, Newtonian
    of a set whose published values have no modulus. Raises InputError: no such law.
    """

    model: str = DEFAULT
    material: str | None = None
    fit: str | None = None
    bubble: Requested = "field"
    trust_input: bool = False

    def __post_init__(self) -> None:
        if self.fit:
            Family(self.fit)

    def model_of(self, about: ReferenceSet) -> str:
        """That of the set, or this; of the paper's two networks the one for liquids where no modulus is published."""
        return str(
            about.settings.get("model") or (self.model if about.solid else _OF_LIQUIDS.get(self.model, self.model))
        )

    def check(self, about: ReferenceSet) -> None:
        """Raises InputError, with its place in the file: what only inference can judge, before a shot costs time."""
        settings, model = about.settings, self.model_of(about)
        material = settings.get("material", self.material)
        attempts: dict[str, Callable[[], object]] = {
            "model": lambda: network_of(model),
            "material": lambda: Analysis("infer", model, material, self.bubble),
            "stretch": lambda: Analysis("infer", model, material, self.bubble, stretch=settings.get("stretch")),
            "shots": lambda: shot_numbers(settings.get("shots")),
        }
        for column, attempt in attempts.items():
            try:
                attempt()
            except InputError as error:
                line = about.given.get(column)
                raise (error.within(f"{line}, column {column}") if line else error) from None

    def analysis(self, about: ReferenceSet) -> Analysis:
        """What is asked of the shots of a set."""
        model = self.model_of(about)
        network, law = network_of(model), about.settings.get("material", self.material)
        if not isinstance(network, Network) and law is None and not about.solid:
            law = "newtonian"
        how: dict[str, Any] = {name: about.settings.get(name) for name in ("stretch", "window")}
        how |= {"medium": about.medium, "trust_input": self.trust_input, "bubble": self.bubble}
        if not self.fit:
            return Analysis("infer", model, law, **how)
        liquid = "newtonian" in (law, network.card["material"] if isinstance(network, Network) else None)
        return Analysis("fit", material="newtonian" if liquid else self.fit, **how)


@dataclass(frozen=True)
class Shots:
    """What was read of a set: its curves, the number of files that cannot be read, and what is to be said of it."""

    curves: Sequence[RadiusCurve] = ()
    unread: int = 0
    notes: Sequence[str] = ()


class ComparisonRun(NamedTuple):
    """The result, how many files could not be read, and whether answers are missing (its first note says how many)."""

    result: Result
    unread: int = 0
    interrupted: bool = False


def compare(
    source: str | Path,
    references: str | Path,
    out: str | Path,
    *,
    how: Answering | None = None,
    reference_methods: Sequence[str] = (),
    pictures: bool = True,
    command: str = "cavirheo compare",
    progress: bool = False,
) -> ComparisonRun:
    """Put published values beside answers; write result.json with them, report.html, and the comparison as tables and a
    picture into `out`.

    A set is a group of the result; one whose files are missing, or that has no recordings, has its published values
    alone. Answers are kept as they are found; after Ctrl-C the comparison is of those.

    Args:
        source: the folder that the files of the sets are relative to, or a result.json, whose groups are the sets of
            their names.
        references: the CSV file (published_values.py).
        how: sets are answered that do not say so; by default as `infer` does, with the field's bubble.
        reference_methods: those to which errors are; default: of REFERENCES those in the file.
        progress: show a bar on stderr.
        pictures: False: none, neither of the sets nor of their shots.

    Raises:
        InputError: a mistake in `references` (line, column, what was expected), an unknown model or method, a folder
            that cannot be read or written, or a file in `out` that is not ours.
    """
    source, references, out = Path(source), Path(references), Path(out)
    message = f"{source} is neither a folder nor a result.json: give the folder that holds the sets of measurements"
    require(source.is_dir() or (source.is_file() and source.suffix == ".json"), message, "compare.folder")
    sets = read_references(references)
    methods = list(dict.fromkeys(method for about in sets for method in about.values))
    for name in reference_methods:
        trouble = f"reference method {name!r}: not in {references}; it has {', '.join(methods) or 'none'}"
        require(name in methods, trouble, "compare.method")
    against = list(dict.fromkeys(reference_methods)) or [name for name in REFERENCES if name in methods]
    none = f"no relative errors: {references} has no method {' or '.join(REFERENCES)}; see --reference-method"
    drawn = pictures and style.available()
    about: dict[str, Any] = {"command": command, "date": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")}
    about["notes"] = ([] if against else [none]) + ([_NO_PICTURE] if pictures and not drawn else [])
    written = _Tables(out, [references, *([source] if source.is_file() else [])], drawn)
    if source.is_file():
        message = f"{source} is not answered again: leave out --model, --material, --bubble, --fit and --trust-input"
        require(how in (None, Answering()), message, "compare.answered")
        return ComparisonRun(_beside_result(source, {one.name: one.values for one in sets}, against, written, about))
    how, found = how or Answering(), {}
    for one in sets:
        how.check(one)
    found = _named_apart({one.name: shots_of(one, source, references) for one in sets})
    about["notes"] = [f"{name}: {note}" for name, shots in found.items() for note in shots.notes] + about["notes"]
    kept, report = Unfinished(out, shown=progress), outputs(out, [one for of in found.values() for one in of.curves])
    aside(load_solver)
    answers = {one.name: kept.answers(found[one.name].curves, how.analysis(one)) for one in sets}
    pairs = [(found[name].curves[i], answer) for name, of in answers.items() for i, answer in of.numbered()]
    note = kept.note(len(pairs), sum(len(shots.curves) for shots in found.values()))
    unread = sum(shots.unread for shots in found.values())
    if note and report.holds("report.html"):  # which stays until all is answered
        return ComparisonRun(
            result(pairs, command, notes=[f"{note}; until then the earlier answers stay"]), unread, True
        )
    about |= {"notes": [note, *about["notes"]] if note else about["notes"], "complete": not note, "draw": pictures}
    about |= {"published": {one.name: one.values for one in sets}, "references": against}
    document = write_report(out, pairs, **about)
    written.write(document, complete=not note)
    if not note:
        kept.remove()
    return ComparisonRun(document, unread, bool(note))


@dataclass(frozen=True)
class _Tables:
    """Where the comparison is written as tables and a picture: beside result.json. Raises InputError: it cannot be."""

    folder: Path
    inputs: Sequence[Path]
    drawn: bool

    def __post_init__(self) -> None:
        self._outputs()

    def _outputs(self) -> Outputs:
        return Outputs(self.folder, *_TABLES[: 2 + self.drawn], inputs=self.inputs)

    def write(self, document: Result, *, complete: bool = True) -> None:
        outputs = self._outputs()
        if self.drawn and complete:
            from cavirheo.companions.comparison_picture import figure

            document.notes += outputs.picture("comparison.png", style.save, figure, document)
        outputs.write("comparison.csv", tables.write_csv, document)
        outputs.write("comparison.md", Path.write_text, tables.markdown(document), encoding="utf-8")
        outputs.finish()


def _beside_result(
    source: Path, sets: Mapping[str, Published], against: Sequence[str], written: _Tables, about: Mapping[str, Any]
) -> Result:
    """The answers that are there, with the values beside them: the same documents, without pictures of shots."""
    from cavirheo.reporting import html, table

    earlier = read_json(source)
    document = earlier.model_copy(update={**about, "notes": [*earlier.notes, *about["notes"]]})
    document.put_beside(by_group((group.name for group in document.groups), sets), against)
    folder = Outputs(written.folder, *DOCUMENTS, inputs=written.inputs)
    folder.write("result.json", write_json, document)
    folder.write("result.csv", table.write_csv, document)
    folder.write("report.html", html.write, document)
    folder.finish()
    written.write(document)
    return document


def _named_apart(found: Mapping[str, Shots]) -> dict[str, Shots]:
    """A set is a group; names of shots that several sets share get the set before them."""
    names = Counter(curve.name for shots in found.values() for curve in shots.curves)
    made = {}
    for name, shots in found.items():
        curves = [curve.with_group(name, "") for curve in shots.curves]
        curves = [one.labelled(name=f"{name}/{one.name}") if names[one.name] > 1 else one for one in curves]
        made[name] = Shots(curves, shots.unread, shots.notes)
    return made


def shots_of(about: ReferenceSet, folder: Path, references: Path) -> Shots:
    """The recordings of a set."""
    if not about.recorded:
        return Shots(notes=["no open recording: published values alone"])
    name = about.settings.get("files", about.name)
    try:
        matches = [folder / name] if (folder / name).exists() else sorted(folder.glob(name))
    except (ValueError, NotImplementedError, OSError):  # an absolute pattern, a name that no file can have
        matches = []
    inside = [(file, path) for path in matches for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    kept = [
        (file, file in matches or file.suffix.lower() in MEASUREMENTS)
        for file, _ in inside
        if not (file.is_dir() or file.name.startswith(".") or file.resolve() == references.resolve())
    ]
    left_out = ", ".join(file.name for file, taken in kept if not taken)
    notes = [f"left out, for they do not look like measurements: {left_out}"] if left_out else []
    files = [file for file, taken in kept if taken]
    if not files:
        return Shots((), 1, [f"no file matches {name!r} in {folder}", *notes])
    settings = about.settings
    constants: Any = {"density": about.medium.density, "pressure": about.medium.pressure}
    scale = settings["rmax_um"] * 1e-6 if "rmax_um" in settings else None
    try:
        curves, problems, again, hints = read_shots(files, max_radius=scale, shots=settings.get("shots"), **constants)
    except InputError as error:  # a scale that is none of these shots
        return Shots((), 1, [str(error), *notes])
    known = [(key, value) for key, value in settings.items() if key != "files"]
    given = [f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in known]
    said = [f"with {', '.join(given)}"] if given else []
    return Shots(curves, len(problems), [*problems, *notes, *again, *hints, *said])
