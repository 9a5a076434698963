"""`cavirheo show`, `cite`, `laws` and `app`: what exists, on the terminal or in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Exit

from cavirheo import settings
from cavirheo.errors import InputError
from cavirheo.settings import argument, number, option
from cavirheo.writing import digits, terminal

_HOST = "address to listen on; 0.0.0.0 is open to the network, without a password"
_NAME = 26  # most characters of the name of a shot
_FILE = "a document, a folder of results, a measurement"


def show(
    file: Annotated[Path, argument("FILE", _FILE)],
    shots: settings.Shots = None,
    fps: settings.Fps = None,
    um_per_px: settings.UmPerPx = None,
) -> None:
    """What a file is: when and by which command it was made, and its table; of measured curves, what would be read."""
    from cavirheo.loading import document_of, load, print_table

    if file.suffix.lower() in (".html", ".htm") and document_of(file) is None:
        raise InputError(f"{file} is a report for a browser: give its folder, {file.parent}", "show.report")
    is_document = file.suffix.lower() == ".json" or document_of(file) is not None
    measurement = {"shots": shots, "fps": fps, "um-per-px": um_per_px}
    given = [name for name, value in measurement.items() if value is not None]
    if given and is_document:
        raise InputError(f"--{given[0]} is for measurements, and {file} is none: leave it out", "show.measurement")
    if not is_document:
        _show_curves(file, shots=shots, frame_rate_hz=fps, um_per_px=um_per_px)
        return
    document = load(file)
    date = f", {document.date}" if document.date else ""
    terminal.write(f"{file}: {document.kind}, written by cavirheo {document.version}{date}\n{document.command}\n")
    print_table(document, file if file.is_dir() else file.parent)


def _show_curves(path: Path, **keywords: Any) -> None:
    """Print what `infer` would read: a row per curve, then the input warnings, and remarks on how it was read."""
    from cavirheo.io.files import expand
    from cavirheo.io.shots import read_shots
    from cavirheo.reporting.measured import curve_warnings, curves_by_note, summary_cells

    curves, problems, remarks = read_shots(expand(path), **keywords)
    remarks = [remark for remark in remarks if not any(remark in curve.notes for curve in curves)]  # those are said
    if not curves:
        raise InputError(problems[0], "show.unreadable")
    heads = ["shot", "R_max\nµm", "frame rate\nkHz", "frames with\na radius", "recorded\nµs", "collapses"]
    names = digits.distinct_names([curve.name for curve in curves])
    curves = [curve.labelled(name=name) for curve, name in zip(curves, names, strict=True)]
    terminal.write(f"{path}: {digits.counted(len(curves), 'measured curve')}\n")
    rows = zip(digits.short_names(names, _NAME), map(summary_cells, curves), strict=True)
    terminal.print_table(heads, [[name, *cells] for name, cells in rows])
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


def app(
    host: Annotated[str, option(_HOST)] = "127.0.0.1",
    port: Annotated[int, number("port; 0: any free one", kind=int, least=0, most=65535)] = 7860,
    browser: Annotated[bool, option("open the page in the browser", None, "--browser/--no-browser")] = True,
) -> None:
    """The same in the browser: upload files, look, infer, compare with the simulation, download everything as a zip."""
    terminal.say("cavirheo app: starting, a few seconds ...")
    from cavirheo.app.server import serve

    serve(host, port, browser=browser)


def laws() -> None:
    """All laws for `simulate --material`: parameters with units, and the energy or viscosity function."""
    from cavirheo.physics.materials import EXAMPLE, KINDS, summary, usage

    for kind, names in KINDS.items():
        terminal.write(f"{kind}:")
        for name in names:
            terminal.print_text(usage(name), indent=2)
            terminal.print_text(summary(name), indent=6)
        terminal.write("")
    terminal.print_text("A material is one law, or a sum of one elastic part, one viscous part and any with memory:")
    terminal.write(f"  --material '{EXAMPLE}'")
    values = "those with a value here (= 0) may be left out."
    terminal.print_text(f"Parameters by position or by name (shear_modulus=2e3); {values}")
