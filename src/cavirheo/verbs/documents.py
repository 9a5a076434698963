"""`cavirheo show`, `cite` and `models`: content of a file, methods and references of a result, the shipped networks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Exit

from cavirheo import settings
from cavirheo.errors import InputError
from cavirheo.settings import argument
from cavirheo.writing import digits, terminal

_FILE = "a document, a folder of results, a measurement"


def show(
    file: Annotated[Path, argument("FILE", _FILE)],
    shots: settings.Shots = None,
    fps: settings.Fps = None,
    um_per_px: settings.UmPerPx = None,
) -> None:
    """What a file is: when and by which command it was made, and its table; of measured curves, what would be read."""
    from cavirheo.loading import documents_in

    if file.suffix.lower() in (".html", ".htm"):
        raise InputError(f"{file} is a report for a browser: give its folder, {file.parent}", "show.report")
    document = file.suffix.lower() == ".json" or bool(documents_in(file))
    measurement = {"shots": shots, "fps": fps, "um-per-px": um_per_px}
    given = [name for name, value in measurement.items() if value is not None]
    if given and document:
        raise InputError(f"--{given[0]} is for measurements, and {file} is none: leave it out", "show.measurement")
    if document:
        _show_document(file)
    else:
        _show_curves(file, shots=shots, frame_rate_hz=fps, um_per_px=um_per_px)


def _show_document(path: Path) -> None:
    from cavirheo.loading import load, print_table

    document = load(path)
    date = f", {document.date}" if document.date else ""
    terminal.write(f"{path}: {document.kind}, written by cavirheo {document.version}{date}\n{document.command}\n")
    print_table(document, path if path.is_dir() else path.parent)


def _show_curves(path: Path, **keywords: Any) -> None:
    """Print what `infer` would read: a row per curve, then the input warnings, and remarks on how it was read."""
    from cavirheo.io.files import expand
    from cavirheo.io.shots import read_shots
    from cavirheo.reporting.table import curve_warnings, curves_by_note, summary_cells

    curves, problems, remarks = read_shots(expand(path), **keywords)
    remarks = [remark for remark in remarks if not any(remark in curve.notes for curve in curves)]  # those are said
    if not curves:
        raise InputError(problems[0], "show.unreadable")
    heads = ["shot", "R_max\nµm", "frame rate\nkHz", "frames with\na radius", "recorded\nµs", "collapses"]
    names = digits.distinct_names([curve.name for curve in curves])
    curves = [curve.labelled(name=name) for curve, name in zip(curves, names, strict=True)]
    terminal.write(f"{path}: {digits.counted(len(curves), 'measured curve')}\n")
    terminal.print_table(heads, [[curve.name, *summary_cells(curve)] for curve in curves])
    terminal.print_remarks(curve_warnings(curves), most=2, mark="check input:")
    terminal.print_remarks(curves_by_note(curves), remarks)
    for problem in problems:
        terminal.say(f"error: {problem}")
    if problems:
        raise Exit(2)


def cite(result: Annotated[Path, argument("RESULT", "a result.json, or the folder that holds one")]) -> None:
    """What a paper must say about a result: models, window, priors, method, versions; and the references as BibTeX."""
    from cavirheo.loading import load
    from cavirheo.reporting.citation import methods_paragraph
    from cavirheo.reporting.record import Result

    document = load(result, Result)
    paragraph, sources = methods_paragraph(document)
    if not paragraph:
        raise InputError("no curve of this result has an answer: there is nothing to cite", "cite.nothing")
    terminal.write("\n\n".join([paragraph, *sources]))


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.cards import card, shipped

    for name, path in shipped().items():
        terminal.write("\n".join(summary(name, card(path))))


def summary(name: str, content: dict[str, Any]) -> list[str]:
    """Return lines on what a model answers, for which recordings, and how well, from its card."""
    training, data = content["training"], content["data"]
    tested = f"{data['test']} test curves"
    if content["kind"] == "emulator":
        lines = [f"{name}: R(t) of a bubble, from which `infer` draws"]
        errors = ", ".join(f"{quantile} {error:.2%}" for quantile, error in content["errors"].items())
        lines.append(f"  error of the frames over R_max: {errors} ({tested})")
    else:
        lines = [f"{name}: {content['material']}, one value each without an interval"]
        for output in content["outputs"]:
            score = content["metrics"][output["name"]]
            low, high = content["problem"]["prior"][output["name"]]
            if output["scale"] == "log10":
                low, high = 10**low, 10**high
            values = f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"
            error = f"R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f}"
            lines.append(f"  {values:40s} {error} ({output['scale']} scale, {tested})")
    minutes = f"{training['seconds'] / 60:.0f} min on {training['device']}"
    return [*lines, f"  trained on {data['train']} simulated curves, {minutes}"]
