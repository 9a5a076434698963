"""The verbs that are functions, for their options are few: `cavirheo show`, `cite`, `app`, `laws`, `models`,
`generate` and `train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Exit

from cavirheo import settings
from cavirheo.errors import InputError
from cavirheo.settings import argument, number, option
from cavirheo.verbs.run import Quiet, ResumableOut, Run, Scheduler, Slurm
from cavirheo.writing import digits, terminal

_HOST = "address to listen on; 0.0.0.0 is open to the network, without a password"
_FILE = "a document, a folder of results, a measurement"


def show(
    file: Annotated[Path, argument("FILE", _FILE)],
    shots: settings.Shots = None,
    fps: settings.Fps = None,
    um_per_px: settings.UmPerPx = None,
) -> None:
    """What a file is: when and by which command it was made, and its table; of measured curves, what would be read."""
    from cavirheo.loading import documents_in, load, print_table

    if file.suffix.lower() in (".html", ".htm"):
        raise InputError(f"{file} is a report for a browser: give its folder, {file.parent}", "show.report")
    is_document = file.suffix.lower() == ".json" or bool(documents_in(file))
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
            terminal.write(f"  {usage(name)}\n      {summary(name)}")
        terminal.write("")
    terminal.write("A material is one law, or a sum of one elastic part, one viscous part and any with memory:")
    terminal.write(f"  --material '{EXAMPLE}'")
    terminal.write(
        "Parameters by position or by name (shear_modulus=2e3); those with a value here (= 0) may be left out."
    )


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.cards import card, shipped

    for name, path in shipped().items():
        terminal.write("\n".join(about_network(name, card(path))))


def about_network(name: str, content: dict[str, Any]) -> list[str]:
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


def generate(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    out: ResumableOut,
    n: Annotated[int | None, number("curves; default: as in the recipe", None, "-n", kind=int, above=0)] = None,
    seed: Annotated[int | None, number("default: as in the recipe", kind=int, least=0)] = None,
    workers: Annotated[int | None, number("threads; default: all cores", kind=int, above=0)] = None,
    scheduler: Scheduler = None,
    slurm: Slurm = None,
    quiet: Quiet = False,
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.physics.simulate import load_solver
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe
    from cavirheo.workflow import connected

    content = read_recipe(recipe)
    if workers is not None and (scheduler or slurm):
        message = "--workers are threads of this machine, and a cluster has its own: leave out one of them"
        raise InputError(message, "option.workers")
    load_solver()
    run = Run(quiet=quiet)
    count = n or content.data.n
    seed = content.data.seed if seed is None else seed
    with connected(scheduler, slurm, run.say) as executor:
        written = dataset.generate(
            content.problem, count, out, seed=seed, workers=workers, progress=not quiet, executor=executor
        )
    for status, failed in written.failures.items():
        run.say(f"{failed} failed: {status}")
    run.end(f"{written.curves} curves in {out}, {written.simulated} of them simulated now")


def train(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")],
    out: ResumableOut,
    threads: Annotated[int | None, number("threads; default: torch's choice", kind=int, least=1, most=1024)] = None,
    device: Annotated[str | None, option("cpu or cuda; default: cuda if there is one")] = None,
    quiet: Quiet = False,
) -> None:
    """Train a recipe's network (the same call resumes) and write it as NAME.npz with its card NAME.json."""
    from cavirheo.inference.cards import card
    from cavirheo.training import train as training
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        path = training.train(content, data, out, device=device, threads=threads, progress=not quiet)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if not quiet:
        terminal.write("\n".join(about_network(path.stem, card(path))))
        terminal.say(f"model: {path}")
