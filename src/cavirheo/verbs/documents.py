"""`cavirheo show`: what a file holds, or what a network is; `cavirheo cite`: how a paper describes a result."""

from __future__ import annotations

from os.path import exists  # False of a name that is too long
from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.writing import digits, terminal

_FILE = "a document, a folder of results, a training set, an .onnx model; a measurement; or the name of a shipped "
_FILE += "network"


def show(
    file: Annotated[Path, argument("FILE", _FILE)],
    shots: options.Shots = None,
    json: Annotated[bool, option("print the document as it is in its file", None, "--json")] = False,
) -> None:
    """What a file is: when and by which command it was made, and its table; of measured curves, what would be read.

    Of a network: what it answers, for which recordings, how well, and where its card is.
    """
    if len(file.parts) == 1 and not file.suffix and not exists(file):
        from cavirheo.inference.model import shipped

        networks = shipped()
        message = f"{file} does not exist, nor is it the name of a shipped network ({', '.join(networks)})"
        require(file.name in networks, message, "show.missing")
        file = networks[file.name]
    network = file.suffix.lower() == ".onnx" or (file.suffix == ".json" and file.with_suffix(".onnx").is_file())
    document = not network and (file.is_dir() or file.suffix.lower() == ".json")
    message = f"--shots is for measurements, and {file} is none: leave it out"
    require(shots is None or not (network or document), message, "show.shots")
    require(document or not json, f"--json is for documents, and {file} is none: leave it out", "show.json")
    if network:
        from cavirheo.verbs.networks import explain

        explain(file.with_suffix(".onnx"))
    elif any(file.glob("shard-*.h5")) or any(file.glob("curves-*.h5")):
        _show_training_set(file)
    elif document:
        _show_document(file, json)
    else:
        _show_curves(file, shots)


def _show_document(path: Path, json: bool) -> None:
    from cavirheo.loading import load, print_table
    from cavirheo.writing.document import as_json

    document = load(path)
    if json:
        print(as_json(document), end="")
        return
    name, date = type(document).__name__.lower(), f", {document.date}" if document.date else ""
    terminal.console().print(f"{path}: {name}, written by cavirheo {document.version}{date}\n{document.command}\n")
    print_table(document)


def _show_training_set(path: Path) -> None:
    """File by file: it may be larger than the memory, and still grow."""
    from cavirheo.training import dataset

    survey = dataset.survey(path)
    growing = f"growing: {survey.lacking} of {survey.files + survey.lacking} files are still to be made"
    lines = [
        f"{path}: training set, written by cavirheo {survey.made_by}, seed {survey.seed}",
        f"  {survey.curves} of {survey.total} curves, {growing if survey.lacking else 'complete'}",
        *(f"  {line}" for line in survey.summary),
        *(f"  {count} {status}" for status, count in sorted(survey.statuses.items(), key=lambda item: -item[1])),
        f"  {survey.size / 1e6:.3g} MB, {survey.size / survey.curves:.0f} bytes a curve; checksum {survey.sha256}",
    ]
    terminal.console().print("\n".join(lines))


def _show_curves(path: Path, shots: str | None) -> None:
    """What `infer` would read: a row per curve, then what was recognised, and the input warnings."""
    from cavirheo.io import read_curves
    from cavirheo.reporting.table import curve_warnings, notes, summary_cells

    curves, console = read_curves(path, shots=shots), terminal.console()
    heads = ["R_max\nµm", "1000 frames\nper s", "frames with\na radius", "recorded\nµs", "collapses"]
    table = terminal.table("curve", heads)
    for curve in curves:
        table.add_row(curve.name, *summary_cells(curve))
    console.print(f"{path}: {digits.counted(len(curves), 'measured curve')}\n")
    console.print(table)
    terminal.print_warnings(console, curve_warnings(curves))
    terminal.print_remarks(console, notes(curves))


def cite(result: Annotated[Path, argument("RESULT", "a result.json, or the folder that holds one")]) -> None:
    """What a paper must say about a result: models, window, priors, method, versions; and the references as BibTeX."""
    from cavirheo.loading import load
    from cavirheo.reporting.citation import methods
    from cavirheo.reporting.record import Result

    document = load(result)
    if not isinstance(document, Result):
        kind = type(document).__name__.lower()
        message = f"{result} is a document of another kind ({kind}): give the result.json of infer or fit"
        raise InputError(message, "cite.kind")
    paragraph, sources = methods(document)
    require(bool(paragraph), "no curve of this result has an answer: there is nothing to cite", "cite.nothing")
    print("\n\n".join([paragraph, *(source.bibtex for source in sources)]))
