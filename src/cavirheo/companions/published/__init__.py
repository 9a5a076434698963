"""Published values beside ours, for a folder of sets of measurements: a table for papers and a picture.

Answers and reports, one per set in its own folder, are those of `cavirheo infer` or `cavirheo fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from cavirheo.companions.published.comparison import ComparedSet, Comparison, compared_set, markdown, write_csv
from cavirheo.companions.published.references import G, ReferenceSet, read_references
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.law import Family
from cavirheo.inference.model import DEFAULT, Network
from cavirheo.inference.posterior_model import PosteriorModel, network_of
from cavirheo.inference.reconstruct import check_stretch
from cavirheo.parallel import aside
from cavirheo.physics.simulate import load_solver
from cavirheo.reading.files import MEASUREMENTS
from cavirheo.reading.selection import shot_numbers
from cavirheo.reading.shots import read_shots
from cavirheo.reporting import file_names, outputs, write_report
from cavirheo.workflow.analyse import Unfinished
from cavirheo.writing import style
from cavirheo.writing.document import Outputs, write_json

REFERENCES = ("IMR", "rheometer")  # of relative errors, where the user names none
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
    trust_input: bool = False,
    pictures: bool = True,
    command: str = "cavirheo compare",
    progress: bool = False,
) -> Comparison:
    """Infer or fit every set that `references` names; write the comparison and a report per set into `out`.

    A set whose files are missing or unreadable keeps its row and says so in `problems`; one without recordings
    (references.py) has its published values alone. Answers are kept as they are found (workflow/analyse.py); after
    Ctrl-C the comparison is of those, and its notes begin with "interrupted".

    Args:
        folder: what the files of the sets are relative to.
        references: the CSV file (references.py).
        model: for sets that name none; "posterior" gives intervals, the paper's networks one value at R_max near that
            of their training.
        fit: a law, such as "nhkv": least squares instead of networks; Newtonian where the model is.
        reference_methods: those to which errors are relative; default: of REFERENCES those in the file.
        progress: show a bar on stderr.
        trust_input: doubts about recordings or constants are said, but decide no verdict.
        pictures: False: none, neither of the sets nor of their shots.

    Raises:
        InputError: a mistake in `references` (line, column, what was expected), an unknown model or method,
            a folder that cannot be read or written, or a file in `out` that is not ours.
    """
    if fit:
        Family(fit)
    folder, references, out = Path(folder), Path(references), Path(out)
    expected = "expected the folder that holds the sets of measurements"
    require(folder.is_dir(), f"{folder} is not a folder; {expected}", "compare.folder")
    sets = read_references(references)
    methods = list(dict.fromkeys(method for about in sets for method, _ in about.values))
    for name in reference_methods:
        trouble = f"reference method {name!r}: not in {references}; it has {', '.join(methods) or 'none'}"
        require(name in methods, trouble, "compare.method")
    against = list(dict.fromkeys(reference_methods)) or [name for name in REFERENCES if name in methods]
    none = f"no relative errors: {references} has no method {' or '.join(REFERENCES)}; see --reference-method"
    for about in sets:
        _check(about, model)
    found = [shots_of(about, folder, references) for about in sets]
    names = file_names([*_OUTPUTS, *(about.name for about in sets)])[len(_OUTPUTS) :]
    written, kept = Outputs(out, *_OUTPUTS, inputs=[references]), Unfinished(out, shown=progress)
    places = [outputs(out / name, curves) for name, (curves, *_) in zip(names, found, strict=True)]
    aside(load_solver)
    asked = [_analysis(about, model, fit, trust_input) for about in sets]
    answers = [kept.answers(curves, one) for (curves, *_), (_, one) in zip(found, asked, strict=True)]
    note = kept.note(sum(map(len, answers)), sum(len(curves) for curves, *_ in found))
    earlier = bool(note) and any(place.holds("report.html") for place in places)  # stay until all is answered
    notes = [note] if note else []
    records: list[ComparedSet] = []
    for about, name, (which, _), answered, (curves, files, problems, left_out) in zip(
        sets, names, asked, answers, found, strict=True
    ):
        pairs = [(curves[i], answer) for i, answer in answered.numbered()]
        how: dict[str, Any] = {"notes": notes, "complete": not note, "draw": pictures}
        how["published"] = {"": about.published()}
        document = write_report(out / name, pairs, command, **how) if pairs and not earlier else None
        rows, groups = (document.curves, document.groups) if document else ([], [])
        material = [one.line for group in groups if (one := group.population) and one.found]
        records.append(compared_set(
            about, rows, against, material=material, model=which, medium=asdict(about.medium),
            problems=problems, notes=left_out,
            files=[str(file.relative_to(folder) if file.is_relative_to(folder) else file) for file in files],
            report=f"{name}/report.html" if rows and not note else None,
        ))  # fmt: skip
    comparison = Comparison(
        command=command, date=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        notes=notes + ([] if against else [none]) + ([_NO_PICTURE] if pictures and not style.available() else []),
        methods=methods, reference_methods=against, sets=records,
    )  # fmt: skip
    if pictures and style.available() and not note:
        from cavirheo.companions.published.picture import figure

        comparison.notes += written.picture("comparison.png", style.save_png, figure, comparison)
    if earlier:
        comparison.notes[0] += "; until then the earlier answers stay"
        return comparison
    written.write("comparison.csv", write_csv, comparison)
    written.write("comparison.md", Path.write_text, markdown(comparison), encoding="utf-8")
    written.write("comparison.json", write_json, comparison)
    written.finish()
    if not note:
        kept.remove()
    return comparison


def _check(about: ReferenceSet, model: str) -> None:
    """What only inference can judge, before the first shot costs time."""
    column = "model"
    try:
        _network(about, model)
        column = "stretch"
        check_stretch(about.settings.get("stretch"))
        column = "shots"
        shot_numbers(about.settings.get("shots"))
    except InputError as error:
        line = about.given.get(column)
        raise (error.within(f"{line}, column {column}") if line else error) from None


def _network(about: ReferenceSet, model: str) -> tuple[Network | PosteriorModel, str]:
    """The network of a set and the law that it answers: its own; of the posterior network, Newtonian for a set without
    a published modulus. Raises InputError."""
    which = about.settings.get("model", model)
    network = network_of(which)
    if isinstance(network, PosteriorModel):
        solid = not about.values or any(quantity == G for _, quantity in about.values)
        return network, "nhkv" if solid else "newtonian"
    return network, network.card["material"]


def _analysis(about: ReferenceSet, model: str, fit: str | None, trust_input: bool) -> tuple[str, Analysis]:
    """(by what the set is answered, how)."""
    which = about.settings.get("model", model)
    options: dict[str, Any] = {name: about.settings.get(name) for name in ("stretch", "window")}
    options |= {"medium": about.medium, "trust_input": trust_input, "bubble": "field"}  # what published values assume
    _, material = _network(about, model)
    if not fit:
        return which, Analysis("infer", which, material, **options)
    law = "newtonian" if material == "newtonian" else fit
    return f"least squares, {law}", Analysis("fit", material=law, **options)


def shots_of(
    about: ReferenceSet, folder: Path, references: Path
) -> tuple[list[RadiusCurve], list[Path], list[str], list[str]]:
    """(curves, files, problems, what was left out) of a set."""
    if not about.recorded:
        return [], [], [], ["no open recording: published values alone"]
    name = about.settings.get("files", about.name)
    try:
        matches = [folder / name] if (folder / name).exists() else sorted(folder.glob(name))
    except (ValueError, NotImplementedError, OSError):  # an absolute pattern, a name that no file can have
        matches = []
    files: list[Path] = []
    others: list[Path] = []
    for path in matches:
        for file in sorted(path.iterdir()) if path.is_dir() else [path]:
            if file.is_dir() or file.name.startswith(".") or file.resolve() == references.resolve():
                continue
            taken = file in matches or file.suffix.lower() in MEASUREMENTS
            (files if taken else others).append(file)
    left_out = ", ".join(file.name for file in others)
    notes = [f"left out, for they do not look like measurements: {left_out}"] if others else []
    if not files:
        return [], [], [f"no file matches {name!r} in {folder}"], notes
    scale = about.settings["rmax_um"] * 1e-6 if "rmax_um" in about.settings else None
    density, pressure = about.medium.density, about.medium.pressure
    how: Any = {"density": density, "pressure": pressure, "shots": about.settings.get("shots")}
    try:
        curves, problems, again = read_shots(files, max_radius=scale, **how)
    except InputError as error:  # a scale that is none of these shots
        return [], files, [str(error)], notes
    return curves, files, problems, notes + again
