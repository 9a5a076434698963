"""The answers of `infer` or `fit` beside published values: an analysis of sets of measurements, or a result.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cavirheo.companions.published_values import ReferenceSet, by_group, read_references
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.law import Family
from cavirheo.inference.model import Network
from cavirheo.inference.posterior_network import network_of
from cavirheo.io.files import expand
from cavirheo.io.shots import read_shots, shot_numbers
from cavirheo.parallel import run_in_thread
from cavirheo.physics.bubble import Requested
from cavirheo.physics.simulate import load_solver
from cavirheo.reporting import DOCUMENTS, html, outputs, read_json, result, table, write_report
from cavirheo.reporting import comparison as tables
from cavirheo.reporting.comparison import ALL, MU, TRUSTED, ComparedParameter, Comparison, G
from cavirheo.reporting.group import OURS, REFERENCES, Published
from cavirheo.reporting.record import Result
from cavirheo.workflow.analyse import Unfinished
from cavirheo.writing import digits, style
from cavirheo.writing.document import Outputs, Spread, write_json
from cavirheo.writing.style import BLUE, INK, VERMILLION, plain_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = (  # Okabe and Ito's colours, and a shape each for those who do not see them
    (BLUE, "s"),
    ("#009e73", "D"),
    ("#7f7f7f", "^"),
    ("#cc79a7", "v"),
    ("#e69f00", "P"),
    ("#56b4e9", "X"),
)
_ROOM = 0.78  # of the height of a set, for its methods
_TABLES = ("comparison.csv", "comparison.png")
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

    def model_of(self, reference: ReferenceSet) -> str:
        """That of the set, or this; of the paper's two networks the one for liquids where no modulus is published."""
        usual = self.model if reference.solid else _OF_LIQUIDS.get(self.model, self.model)
        return str(reference.settings.get("model") or usual)

    def check(self, reference: ReferenceSet) -> None:
        """Raises InputError, with its place in the file: what only inference can judge, before a shot costs time."""
        settings, model = reference.settings, self.model_of(reference)
        analysis = partial(Analysis, "infer", model, settings.get("material", self.material), self.bubble)
        attempts: dict[str, Callable[[], object]] = {
            "model": lambda: network_of(model),
            "material": analysis,
            "stretch": lambda: analysis(stretch=settings.get("stretch")),
            "shots": lambda: shot_numbers(settings.get("shots")),
        }
        for column, attempt in attempts.items():
            try:
                attempt()
            except InputError as error:
                line = reference.lines.get(column)
                raise (error.within(f"{line}, column {column}") if line else error) from None

    def analysis(self, reference: ReferenceSet) -> Analysis:
        """What is asked of the shots of a set."""
        model = self.model_of(reference)
        network, law = network_of(model), reference.settings.get("material", self.material)
        if not isinstance(network, Network) and law is None and not reference.solid:
            law = "newtonian"
        how: dict[str, Any] = {name: reference.settings.get(name) for name in ("stretch", "window")}
        how |= {"medium": reference.medium, "trust_input": self.trust_input, "bubble": self.bubble}
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
    sets = {reference.name: reference for reference in read_references(references)}
    published = {name: reference.values for name, reference in sets.items()}
    against = _reference_methods(references, published, reference_methods)
    none = f"no relative errors: {references} has no method {' or '.join(REFERENCES)}; see --reference-method"
    drawing = pictures and style.available()
    notes = ([] if against else [none]) + ([_NO_PICTURE] if pictures and not drawing else [])
    head: dict[str, Any] = {"command": command, "date": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")}
    inputs = [references, *([source] if source.is_file() else [])]
    table_outputs = partial(Outputs, out, *_TABLES[: 1 + drawing], inputs=inputs)  # of the folder as it is then
    table_outputs()
    if source.is_file():
        message = f"{source} is not answered again: leave out --model, --material, --bubble, --fit and --trust-input"
        require(how in (None, Answering()), message, "compare.answered")
        document = _with_published(source, Outputs(out, *DOCUMENTS, inputs=inputs), published, against, notes, head)
        _write_tables(table_outputs(), document, drawing)
        return ComparisonRun(document)
    how = how or Answering()
    for reference in sets.values():
        how.check(reference)
    shots = _distinct_names({name: shots_of(reference, source, references) for name, reference in sets.items()})
    notes = [f"{name}: {note}" for name, read in shots.items() for note in read.notes] + notes
    curves, unread = [curve for read in shots.values() for curve in read.curves], sum(r.unread for r in shots.values())
    unfinished, report = Unfinished(out, visible=progress), outputs(out, curves)
    run_in_thread(load_solver)
    answers = {name: unfinished.answers(read.curves, how.analysis(sets[name])) for name, read in shots.items()}
    pairs = [(shots[name].curves[i], answer) for name, of in answers.items() for i, answer in of.numbered()]
    note = unfinished.note(len(pairs), len(curves))
    if note and report.holds("report.html"):  # which stays until all is answered
        interrupted = result(pairs, command, notes=[f"{note}; until then the earlier answers stay"])
        return ComparisonRun(interrupted, unread, True)
    document = write_report(
        out,
        pairs,
        **head,
        notes=[note, *notes] if note else notes,
        complete=not note,
        draw=pictures,
        published=published,
        references=against,
    )
    _write_tables(table_outputs(), document, drawing and not note)
    if not note:
        unfinished.remove()
    return ComparisonRun(document, unread, bool(note))


def _reference_methods(path: Path, published: Mapping[str, Published], requested: Sequence[str]) -> list[str]:
    """The methods that errors are to. Raises InputError: the file has no such method."""
    methods = list(dict.fromkeys(method for values in published.values() for method in values))
    for name in requested:
        message = f"reference method {name!r}: not in {path}; it has {', '.join(methods) or 'none'}"
        require(name in methods, message, "compare.method")
    return list(dict.fromkeys(requested)) or [name for name in REFERENCES if name in methods]


def _write_tables(outputs: Outputs, document: Result, drawing: bool) -> None:
    """The comparison as tables and a picture, beside result.json."""
    if drawing:
        document.notes += outputs.picture("comparison.png", style.save, figure, document)
    outputs.write("comparison.csv", tables.write_csv, document)
    outputs.finish()


def _with_published(
    source: Path,
    outputs: Outputs,
    sets: Mapping[str, Published],
    against: Sequence[str],
    notes: Sequence[str],
    head: Mapping[str, str],
) -> Result:
    """The answers that are there, with the values beside them: the same documents, without pictures of shots."""
    earlier = read_json(source)
    document = earlier.model_copy(update={**head, "notes": [*earlier.notes, *notes]})
    document.add_published(by_group((group.name for group in document.groups), sets), against)
    outputs.write("result.json", write_json, document)
    outputs.write("result.csv", table.write_csv, document)
    outputs.write("report.html", html.write, document)
    outputs.finish()
    return document


def _distinct_names(sets: Mapping[str, Shots]) -> dict[str, Shots]:
    """A set is a group; names of shots that several sets share get the set before them."""
    names = Counter(curve.name for shots in sets.values() for curve in shots.curves)
    distinct = {}
    for name, shots in sets.items():
        curves = [curve.with_group(name, "") for curve in shots.curves]
        curves = [curve.labelled(name=f"{name}/{curve.name}") if names[curve.name] > 1 else curve for curve in curves]
        distinct[name] = replace(shots, curves=curves)
    return distinct


def shots_of(reference: ReferenceSet, folder: Path, references: Path) -> Shots:
    """The recordings of a set in the folder; `references` is none of them."""
    if not reference.recorded:
        return Shots(notes=["no open recording: published values alone"])
    settings = reference.settings
    name = settings.get("files", reference.name)
    matches, files = list[Path](), list[Path]()
    try:
        matches = [folder / name] if (folder / name).exists() else sorted(folder.glob(name))
        matches = [path for path in matches if path.name[0] != "."]
        files = [file for file in expand(matches) if file.resolve() != references.resolve()]
    except (InputError, ValueError, NotImplementedError, OSError):  # an absolute pattern, a name that no file can have
        pass
    neighbours = [file for path in matches if path.is_dir() for file in sorted(path.iterdir()) if file.name[0] != "."]
    ignored = ", ".join(file.name for file in neighbours if file.is_file() and file not in files)
    notes = [f"left out, for they do not look like measurements: {ignored}"] if ignored else []
    if not files:
        return Shots((), 1, [f"no file matches {name!r} in {folder}", *notes])
    constants: Any = {"density": reference.medium.density, "pressure": reference.medium.pressure}
    scale, shots = settings["rmax_um"] * 1e-6 if "rmax_um" in settings else None, settings.get("shots")
    try:
        curves, problems, repeated, hints = read_shots(files, max_radius=scale, shots=shots, **constants)
    except InputError as error:  # a scale that is none of these shots
        return Shots((), 1, [str(error), *notes])
    values = {key: f"{value:g}" if isinstance(value, float) else value for key, value in settings.items()}
    words = ", ".join(f"{key} {value}" for key, value in values.items() if key != "files")
    notes += [*repeated, *hints, *([f"with {words}"] if words else [])]
    return Shots(curves, len(problems), [*problems, *notes])


def figure(result: Result) -> Figure:
    """Mean ± standard deviation; ours is over the trusted shots, hollow where there are none.

    Our shots are dots, hollow where they are not trusted. Needs matplotlib.
    """
    from matplotlib.figure import Figure

    comparison = Comparison(result)
    names, methods = [group.name for group in result.groups], [*comparison.methods, OURS]
    parameters = [name for name in (G, MU) if any(row.name == name for row in comparison.rows)] or [MU]
    height = 1.3 + len(names) * max(0.16 * len(methods), 0.35)
    drawing = Figure(figsize=(1.2 + 4.2 * len(parameters), height), facecolor="white", layout="constrained")
    panels = drawing.subplots(1, len(parameters), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, parameters, strict=True):
        factor, label = comparison.unit(name)
        rows = {row.group.name: row for row in comparison.rows if row.name == name}
        _panel(axes, [rows.get(group) for group in names], factor, methods, comparison.answers[0])
        axes.set_xlabel(label, fontsize=10, color=INK)
    panels[0].set_yticks(range(len(names)), [digits.elide(name, 28) for name in names], parse_math=False)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    handles = {text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    order = sorted(handles, key=[*methods, TRUSTED, ALL, *handles].index)
    look: Any = {"loc": "outside upper center", "ncols": min(len(order), 4), "frameon": False, "fontsize": 9}
    if comparison.bubbles:
        drawing.supxlabel(f"{OURS}: {comparison.bubbles}", fontsize=8, color=INK)
    for text in drawing.legend([handles[text] for text in order], order, **look).get_texts():
        text.set_parse_math(False)
    return drawing


def _panel(axes: Axes, rows: Sequence[ComparedParameter | None], factor: float, methods: list[str], ours: str) -> None:
    axes.set_xscale("log")
    step = _ROOM / len(methods)
    for place, row in enumerate(rows):
        heights = {method: place + (k - (len(methods) - 1) / 2) * step for k, method in enumerate(methods)}
        if place % 2:
            axes.axhspan(place - 0.5, place + 0.5, color="#f5f3ee", lw=0, zorder=0)
        if row is None:
            look: Any = {"fontsize": 8, "color": "#999999", "va": "center"}
            axes.text(0.02, place, "not determined", transform=axes.get_yaxis_transform(), **look)
            continue
        for method in methods[:-1]:
            style = _STYLES[methods.index(method) % len(_STYLES)]
            _draw_mean(axes, method, row.value(method), factor, heights[method], style)
        _draw_shots(axes, row, factor, heights[OURS] + 0.5 * step)
        name = next((name for name in row.answers if row.value(name).mean is not None), OURS)
        _draw_mean(axes, name if name == ALL else ours, row.value(name), factor, heights[OURS], (VERMILLION, "o"))
    low, high = axes.get_xlim()
    plain_ticks(axes.xaxis, (1, 2, 5) if high < 40.0 * low else (1, 3) if high < 1e3 * low else (1,))
    axes.tick_params(labelsize=9, labelcolor=INK, color="#888888")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#dddddd", lw=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)


def _draw_shots(axes: Axes, row: ComparedParameter, factor: float, height: float) -> None:
    for face, label in ((VERMILLION, f"{OURS}: shot, trusted"), ("none", f"{OURS}: shot, not trusted")):
        shots = [
            shot.determined(row.name) for shot in row.shots if shot.has_answer and shot.trusted == (face != "none")
        ]
        values = [value * factor for value in shots if value is not None]
        if values:
            look: Any = {"ms": 3, "mec": VERMILLION, "mew": 0.7, "alpha": 0.7, "mfc": face, "zorder": 2}
            axes.plot(values, [height] * len(values), "o", label=label, **look)


def _draw_mean(axes: Axes, name: str, value: Spread, factor: float, height: float, style: tuple[str, str]) -> None:
    if value.mean is None:
        return
    mean, std = value.mean * factor, (value.std or 0.0) * factor
    colour, marker = style
    hollow = name == ALL
    look: Any = {"color": colour, "ms": 5.5, "mfc": "white" if hollow else colour, "mec": colour if hollow else "white"}
    look |= {"mew": 1.2 if hollow else 0.6, "elinewidth": 1.4, "capsize": 2.5, "zorder": 3}
    below = std >= mean  # to where a logarithmic axis does not reach
    ends = [[0.0 if below else std], [std]] if std else None
    axes.errorbar(mean, height, xerr=ends, fmt=marker, label=name, **look)
    if below:
        axes.plot([0.2 * mean, mean], [height] * 2, color=colour, lw=1.4, zorder=2)
        axes.plot(0.2 * mean, height, "<", color=colour, ms=4, label="std reaches below 0", ls="none", zorder=2)
