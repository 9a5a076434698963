"""The command line: one verb, one thin function."""

from __future__ import annotations

import os
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cavirheo.app.command import app as browser_app
from cavirheo.collapse.command import collapse_time
from cavirheo.commands.fit import fit
from cavirheo.commands.shared import (
    Density,
    ExactLaw,
    ExposureUs,
    MediumName,
    ModelName,
    Out,
    Pressure,
    SoundSpeed,
    SurfaceTension,
    Temperature,
    Verify,
    check_level,
    liquid_of,
    load_solver,
    progress,
    read_files,
    report,
    verified,
)
from cavirheo.commands.which_law import which_law
from cavirheo.errors import InputError, SolverError
from cavirheo.rheometer.command import rheometer

if TYPE_CHECKING:
    from cavirheo.physics.materials import Material

app = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"cavirheo {version('cavirheo')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="show the version and exit", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    """Material properties of soft matter from the radius history R(t) of a laser-made bubble."""


@app.command()
def infer(
    files: Annotated[list[Path], typer.Argument(help="measured R(t): .mat, .csv, .h5, .xlsx; one or many curves each")],
    model: ModelName = "bdt-viscoelastic",
    rmax_um: Annotated[float | None, typer.Option(help="true R_max of the shots, um: rescales the radii")] = None,
    stretch: Annotated[float | None, typer.Option(help="R_max/R_0 if known; fitted otherwise")] = None,
    window: Annotated[
        int | None, typer.Option(help="collapses over which answer and measurement are compared", min=1)
    ] = None,
    verify: Verify = "none",
    exact_law: ExactLaw = False,
    exposure_us: ExposureUs = None,
    medium: MediumName = "water",
    density: Density = None,
    sound_speed: SoundSpeed = None,
    surface_tension: SurfaceTension = None,
    pressure: Pressure = None,
    temperature: Temperature = None,
    out: Out = Path("cavirheo-result"),
) -> None:
    """Shear modulus and viscosity from measured radius histories, with pictures that show whether to believe them."""
    from cavirheo.inference import infer_many

    began = time.perf_counter()
    check_level(verify, exposure_us)
    liquid = liquid_of(medium, density, sound_speed, surface_tension, pressure, temperature)
    curves, unreadable = read_files(files, liquid, rmax_um, exposure_us)
    load_solver()
    with progress() as bar:
        task = bar.add_task("", total=len(curves))
        answers = infer_many(
            curves, model=model, medium=liquid, stretch=stretch, window=window, done=lambda: bar.advance(task)
        )
    answers = verified(curves, answers, verify, medium=liquid, stretch=stretch, discrepancy=not exact_law)
    report(curves, answers, out, began, unreadable)


@app.command()
def compare(
    folder: Annotated[Path, typer.Argument(help="holds the measurements: a file, subfolder or glob per set")],
    references: Annotated[Path, typer.Option(help="CSV of sets and published values, see docs/compare.md")],
    reference_method: Annotated[
        list[str] | None, typer.Option(help="errors are relative to it; may be repeated  [default: IMR, rheometer]")
    ] = None,
    model: ModelName = "bdt-viscoelastic",
    fit_law: Annotated[
        str | None, typer.Option("--fit", help="least squares with this law (nhkv, ...) instead of networks")
    ] = None,
    out: Out = Path("cavirheo-comparison"),
) -> None:
    """Published values of many sets beside ours, with relative errors: tables, a picture and a report per set."""
    from cavirheo.comparison import compare as run
    from cavirheo.comparison.table import print_table

    began = time.perf_counter()
    load_solver()
    command, against = shlex.join(["cavirheo", *sys.argv[1:]]), reference_method or []
    with progress() as bar:
        task = bar.add_task("", total=None)
        result = run(
            folder, references, out, model=model, fit=fit_law, reference_methods=against, command=command,
            done=lambda total: bar.update(task, total=total, advance=1),
        )  # fmt: skip
    print_table(result)
    shots = sum(about.n_shots for about in result.sets)
    seconds = time.perf_counter() - began
    print(f"{len(result.sets)} sets, {shots} shots in {seconds:.1f} s; table: {out / 'comparison.md'}", file=sys.stderr)
    if any(about.problems for about in result.sets):
        raise typer.Exit(2)
    if any(about.n_answered < about.n_shots for about in result.sets):
        raise typer.Exit(1)


def _material(text: str, **options: float | None) -> Material:
    """A name whose parameters are options of the command, or a sum of laws that holds its own."""
    from cavirheo.physics.laws import parse
    from cavirheo.physics.materials import MATERIALS, make

    if text in MATERIALS:
        return make(text, **options)
    law = parse(text)
    if given := [f"--{key.replace('_', '-')}" for key, value in options.items() if value is not None]:
        raise InputError(f"--material {text!r} holds its own parameters: leave out {', '.join(given)}")
    return law


@app.command()
def simulate(
    out: Annotated[Path, typer.Option("-o", "--out", help="CSV file to write")],
    rmax_um: Annotated[float, typer.Option(help="largest radius, um")],
    stretch: Annotated[float, typer.Option(help="R_max/R_0")],
    material: Annotated[
        str,
        typer.Option(
            help="nhkv, newtonian or qkv; or any laws with their parameters (see `cavirheo laws`), "
            "'yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)'"
        ),
    ] = "nhkv",
    shear_modulus: Annotated[float | None, typer.Option(help="Pa")] = None,
    viscosity: Annotated[float | None, typer.Option(help="Pa s")] = None,
    stiffening: Annotated[float | None, typer.Option(help="alpha of qkv")] = None,
    duration_us: Annotated[float, typer.Option(help="us after R_max")] = 100.0,
    frame_rate_hz: Annotated[float, typer.Option(help="1/s")] = 1e6,
    pulse: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="ultrasound: peak kPa (negative: tension), MHz, us of the peak", metavar="KPA MHZ US"),
    ] = None,
    driving: Annotated[
        Path | None, typer.Option(help="far-field pressure above ambient: CSV file with columns time_us,pressure_kPa")
    ] = None,
    motion: Annotated[str, typer.Option(help="keller-miksis, rayleigh-plesset or gilmore")] = "keller-miksis",
    polytropic: Annotated[
        float | None, typer.Option(help="exponent of the gas, instead of heat and vapour transport")
    ] = None,
    relaxed: Annotated[bool, typer.Option("--relaxed", help="laws with memory start unstressed")] = False,
    precise: Annotated[bool, typer.Option("--precise", help="ten times as accurate, five times as long")] = False,
    fields: Annotated[
        Path | None, typer.Option(help="HDF5 file for temperature and vapour in the bubble at every frame")
    ] = None,
    medium: MediumName = "water",
    density: Density = None,
    sound_speed: SoundSpeed = None,
    surface_tension: SurfaceTension = None,
    pressure: Pressure = None,
    temperature: Temperature = None,
) -> None:
    """One bubble from rest at its largest radius, or at equilibrium (--stretch 1) under ultrasound.

    Columns: time_us, radius_um, velocity_m_per_s of the wall, pressure_Pa in the bubble, stress_Pa of the material
    (stress integral), hoop strain and strain_rate_per_s at the wall.
    """
    import numpy as np

    from cavirheo.physics.driving import Pulse, read_trace
    from cavirheo.physics.simulate import simulate as solve
    from cavirheo.physics.simulation import write_csv, write_fields

    if pulse and driving:
        raise InputError("give either --pulse or --driving, not both; a file can hold any sum of pressures")
    liquid = liquid_of(medium, density, sound_speed, surface_tension, pressure, temperature)
    law = _material(material, shear_modulus=shear_modulus, viscosity=viscosity, stiffening=stiffening)
    if not (duration_us > 0 and frame_rate_hz > 0 and 1 <= duration_us * 1e-6 * frame_rate_hz <= 1e6):
        raise InputError(
            f"duration and frame rate must give 1 to a million frames, got {duration_us} us at {frame_rate_hz} Hz"
        )
    frames = int(duration_us * 1e-6 * frame_rate_hz * (1 + 1e-9)) + 1
    far_field = read_trace(driving) if driving else None
    load_solver()
    run = solve(
        law,
        max_radius=rmax_um * 1e-6,
        stretch=stretch,
        time=np.arange(frames) / frame_rate_hz,
        medium=liquid,
        driving=Pulse(pulse[0] * 1e3, pulse[1] * 1e6, pulse[2] * 1e-6) if pulse else far_field,
        motion=motion,
        polytropic=polytropic,
        relaxed=relaxed,
        fields=fields is not None,
        precise=precise,
    )
    write_csv(run, out)
    if fields:
        write_fields(run, fields)
    print(f"{frames} frames of {law} in {liquid.name}: {out}", file=sys.stderr)


@app.command()
def laws() -> None:
    """All laws for `simulate --material`: parameters with units, and the energy or viscosity function."""
    from cavirheo.physics.laws import EXAMPLE, KINDS, summary, usage

    for kind, names in KINDS.items():
        print(f"{kind}:")
        for name in names:
            print(f"  {usage(name)}\n      {summary(name)}")
        print()
    print(
        "A material is one law, or a sum of one elastic part, one viscous part and any with memory:\n"
        f"  --material '{EXAMPLE}'"
    )
    print("Parameters by position or by name (shear_modulus=2e3); those with a value here (= 0) may be left out.")


@app.command()
def generate(
    recipe: Annotated[Path, typer.Argument(help="TOML file, see recipes/")],
    out: Out,
    n: Annotated[int | None, typer.Option("-n", help="curves; default: as in the recipe", min=1)] = None,
    seed: Annotated[int | None, typer.Option(help="default: as in the recipe", min=0)] = None,
    workers: Annotated[int | None, typer.Option(help="threads; default: all cores", min=1)] = None,
    shard: Annotated[str, typer.Option(help="i/N: make the i-th of N parts only")] = "1/1",
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        part, parts = (int(number) for number in shard.split("/"))
    except ValueError:
        raise InputError(f"--shard must read i/N, e.g. 2/8; got {shard!r}") from None
    load_solver()
    made = dataset.generate(
        content.problem,
        content.data.n if n is None else n,
        out,
        seed=content.data.seed if seed is None else seed,
        workers=workers,
        shard=(part, parts),
    )
    print(f"{made.curves} curves in {out}: {made.written} files written, {made.skipped} already there", file=sys.stderr)
    if made.simulated:
        print(
            f"{made.simulated} simulated in {made.seconds:.0f} s ({made.curves_per_second:.0f} per s)", file=sys.stderr
        )
    for status, count in made.failures.items():
        print(f"{count} failed and are kept with their status: {status}", file=sys.stderr)


@app.command()
def train(
    recipe: Annotated[Path, typer.Argument(help="TOML file, see recipes/")],
    data: Annotated[Path, typer.Argument(help="folder written by `cavirheo generate`")],
    out: Out,
    threads: Annotated[int | None, typer.Option(help="of the processor; default: torch's choice", min=1)] = None,
    device: Annotated[str | None, typer.Option(help="cpu or cuda; default: cuda if there is one")] = None,
) -> None:
    """Train a recipe's network (the same call resumes) and export it as NAME.onnx with its card NAME.json."""
    try:
        from cavirheo.training.export import export
        from cavirheo.training.train import train as run
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install cavirheo with the extra [train]") from error
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    result = run(content, data, out, device=device, threads=threads)
    path = export(content, out, out)
    for name, score in result["metrics"].items():
        print(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
    print(f"model: {path}; use it with: cavirheo infer --model {path} FILE", file=sys.stderr)


@app.command()
def evaluate(
    model: Annotated[str, typer.Argument(help="a shipped model or an .onnx file")],
    data: Annotated[Path, typer.Argument(help="folder written by `cavirheo generate`")],
    out: Out = Path("cavirheo-evaluation"),
    robustness: Annotated[
        bool, typer.Option("--robustness", help="also with noise, other frame rates, a first frame off, gaps: minutes")
    ] = False,
) -> None:
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""
    from cavirheo.inference.model import path_of
    from cavirheo.training.evaluate import evaluate as judge
    from cavirheo.training.tables import markdown

    if robustness:
        load_solver()
    print(markdown(judge(path_of(model), data, out, robust=robustness, progress=True)))
    print(f"written to {out}", file=sys.stderr)


@app.command()
def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.model import card, shipped

    for name, path in shipped().items():
        about = card(path)
        print(f"{name}: {about['material']}, one value each without an interval" if about["kind"] == "point" else name)
        for output in about["outputs"]:
            low, high = about["problem"]["prior"][output["name"]]
            if output["scale"] == "log10":
                low, high = 10**low, 10**high
            score = about["metrics"][output["name"]]["r2"]
            what = f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"
            print(f"  {what:40s} R2 {score:.4f} ({output['scale']} scale, {about['data']['test']} test curves)")
        print(f"  trained on {about['data']['train']} curves, {about['date']}; card: {path.with_suffix('.json')}")


app.command()(fit)
app.command()(which_law)
app.command()(rheometer)
app.command()(collapse_time)
app.command("app")(browser_app)


def main() -> None:
    """The command line in this process: errors of the user become one line and exit status 2."""
    try:
        app()
    except (InputError, SolverError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def entry() -> None:
    """`main` as a program: leaves at once, for tearing down the compiled libraries takes a third of a second."""
    status = 0
    try:
        main()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    entry()
