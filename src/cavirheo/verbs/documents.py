"""`cavirheo show`, `cite` and `models`: content of a file, methods and references of a result, summaries of networks;
and the installation for a bug report (`cavirheo --version --verbose`)."""

from __future__ import annotations

import os
import platform
import re
import sys
from importlib.metadata import distributions, requires
from os.path import exists  # returns False for a name that is too long
from pathlib import Path
from typing import Annotated, Any

from typer import Exit

from cavirheo import settings
from cavirheo.errors import InputError, sha256
from cavirheo.parallel import cores
from cavirheo.settings import argument, option
from cavirheo.writing import digits, terminal

_FILE = "a document, a folder of results, a training set, weights (.npz), a measurement; or a shipped network's name"
_VARIABLES = ("NUMBA_", "CAVIRHEO_", "OMP_", "OPENBLAS_")  # prefixes of variables that change speed or answers


def show(
    file: Annotated[Path, argument("FILE", _FILE)],
    shots: settings.Shots = None,
    fps: settings.Fps = None,
    um_per_px: settings.UmPerPx = None,
    json: Annotated[bool, option("print the document as it is in its file", None, "--json")] = False,
) -> None:
    """What a file is: when and by which command it was made, and its table; of measured curves, what would be read.

    Of a network: what it answers, for which recordings, how well, and where its card is.
    """
    from cavirheo.inference.cards import shipped
    from cavirheo.loading import documents_in

    if str(file) in shipped() and not exists(file):
        file = shipped()[str(file)]
    if file.suffix.lower() in (".html", ".htm"):
        raise InputError(f"{file} is a report for a browser: give its folder, {file.parent}", "show.report")
    models = [path for path in file.glob("*.npz") if path.with_suffix(".json").is_file()]
    file = models[0] if len(models) == 1 else file  # the folder of a run of `train`
    network = file.suffix.lower() == ".npz" or (file.suffix == ".json" and file.with_suffix(".npz").is_file())
    training_set = any(file.glob("shard-*.h5"))
    document = not network and (file.suffix.lower() == ".json" or training_set or bool(documents_in(file)))
    measurement = {"shots": shots, "fps": fps, "um-per-px": um_per_px}
    given = [name for name, value in measurement.items() if value is not None]
    if given and (network or document):
        raise InputError(f"--{given[0]} is for measurements, and {file} is none: leave it out", "show.measurement")
    if json and not document:
        raise InputError(f"--json is for documents, and {file} is none: leave it out", "show.json")
    if network:
        _show_network(file.with_suffix(".npz"))
    elif training_set:
        _show_training_set(file)
    elif document:
        _show_document(file, json)
    else:
        _show_curves(file, shots=shots, frame_rate_hz=fps, um_per_px=um_per_px)


def _show_document(path: Path, json: bool) -> None:
    from cavirheo.loading import load, print_table
    from cavirheo.writing.document import as_json

    document = load(path)
    if json:
        terminal.write(as_json(document).rstrip())
        return
    date = f", {document.date}" if document.date else ""
    terminal.write(f"{path}: {document.kind}, written by cavirheo {document.version}{date}\n{document.command}\n")
    print_table(document, path if path.is_dir() else path.parent)


def _show_training_set(path: Path) -> None:
    from cavirheo.training import dataset

    data = dataset.load(path)
    lines = [f"{path}: training set of {len(data)} curves, written by cavirheo {data.made_by}, seed {data.seed}"]
    lines += [*dataset.layout_of(data.problem).summary, f"checksum {data.sha256}"]
    lines += [f"{count} {status}" for status, count in data.origin["failures"].items()]
    terminal.write("\n  ".join(lines))


def _show_curves(path: Path, **keywords: Any) -> None:
    """Print what `infer` would read: a row per curve, then the input warnings, and remarks on how it was read."""
    from cavirheo.io.files import expand
    from cavirheo.io.shots import read_shots
    from cavirheo.reporting.table import curve_warnings, curves_by_note, summary_cells

    curves, problems, remarks, _ = read_shots(expand([path]), **keywords)
    if not curves:
        raise InputError(problems[0], "show.unreadable")
    console = terminal.console()
    heads = ["shot", "R_max\nµm", "frame rate\nkHz", "frames with\na radius", "recorded\nµs", "collapses"]
    names = digits.distinct_names([curve.name for curve in curves])
    curves = [curve.labelled(name=name) for curve, name in zip(curves, names, strict=True)]
    console.print(f"{path}: {digits.counted(len(curves), 'measured curve')}\n")
    terminal.print_table(console, heads, [[curve.name, *summary_cells(curve)] for curve in curves])
    terminal.print_remarks(console, curve_warnings(curves), most=2, mark="check input:")
    terminal.print_remarks(console, curves_by_note(curves), remarks)
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
    terminal.write("\n\n".join([paragraph, *(source.bibtex for source in sources)]))


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.cards import card, shipped

    for name, path in shipped().items():
        terminal.write("\n".join(summary(name, card(path))))


def summary(name: str, content: dict[str, Any]) -> list[str]:
    """Return lines on what a model answers, for which recordings, and how well, from its card. Raises KeyError,
    TypeError, ValueError: the card is incomplete or invalid."""
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


def _show_network(path: Path) -> None:
    """Print a model's summary, files and checksum. Raises InputError: no model, or an incomplete card."""
    from cavirheo.inference.cards import card

    content = card(path)
    digest = sha256(path)
    changed = "" if content["weights"]["sha256"] == digest else ", which is NOT the file that its card describes"
    try:
        lines = summary(path.stem, content)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the card of {path} lacks what it should say: {error!r}", "model.card") from None
    lines.append(f"  file {path}, sha256 {digest}{changed}, made {content.get('date', 'at an unknown date')}")
    lines.append(f"  card {path.with_suffix('.json')}: priors, training, losses, scores and license in full")
    terminal.write("\n".join(lines))


def installation_report() -> str:
    """Return lines on versions, machine, libraries and variables of this installation."""
    import cavirheo

    needed = [re.split(r"[^\w.-]", line)[0] for line in requires("cavirheo") or () if not re.search(r"== .dev\b", line)]
    versions = {name: next((each.version for each in distributions(name=name)), "absent") for name in needed}
    variables = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(_VARIABLES)]
    lines = {
        "cavirheo": f"{cavirheo.__version__} in {Path(cavirheo.__file__).parent}",
        "python": f"{platform.python_version()} ({platform.python_implementation()}), {sys.executable}",
        "machine": f"{platform.platform()}, {cores()} cores",
        "libraries": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "variables": ", ".join(variables) or "none that matter",
    }
    return "\n".join(f"{name:<10}{text}" for name, text in lines.items())
