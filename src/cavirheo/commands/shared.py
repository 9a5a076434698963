"""What the verbs share: options for the surroundings, files in, the solver loaded, a bar that moves."""

from __future__ import annotations

import math
import shlex
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cavirheo.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress

    from cavirheo.curve import RadiusCurve
    from cavirheo.physics.media import Medium
    from cavirheo.posterior import Posterior

ModelName = Annotated[
    str, typer.Option("--model", help="shipped model (see `cavirheo models`) or a path to an .onnx file")
]
Out = Annotated[Path, typer.Option("-o", "--out", help="folder for the results")]
MediumName = Annotated[str, typer.Option("--medium", help="named constants: water, bu2026, estrada2018, ...")]
Density = Annotated[float | None, typer.Option(help="of the liquid or gel, kg/m3")]
SoundSpeed = Annotated[float | None, typer.Option(help="m/s")]
SurfaceTension = Annotated[float | None, typer.Option(help="N/m")]
Pressure = Annotated[float | None, typer.Option(help="far from the bubble, Pa")]
Temperature = Annotated[float | None, typer.Option(help="far from the bubble, K")]
Verify = Annotated[
    str,
    typer.Option(help="map: the posterior's maximum; full: draws weighted by the physics (docs/posterior.md); none"),
]
ExposureUs = Annotated[
    float | None, typer.Option(help="of a frame, us, centred on its time: --verify blurs the simulation as the camera")
]
ExactLaw = Annotated[
    bool, typer.Option("--exact-law", help="--verify: no discrepancy between law and bubble, narrower intervals")
]


def liquid_of(name: str, *constants: float | None) -> Medium:
    """`constants` as the options have them: density, sound speed, surface tension, pressure, temperature."""
    from cavirheo.physics.media import medium

    names = ("density", "sound_speed", "surface_tension", "pressure", "temperature")
    return medium(name, **dict(zip(names, constants, strict=True)))


def load_solver() -> None:
    """Load the compiled solver; tell the user if that takes long because it is compiled for the first time."""
    said = threading.Timer(
        2.0,
        lambda: print("compiling the bubble solver for this machine, once (10 to 30 s) ...", file=sys.stderr),
    )
    said.start()
    try:
        from cavirheo.physics.materials import Newtonian
        from cavirheo.physics.simulate import simulate

        simulate(Newtonian(0.1), max_radius=1e-4, stretch=2.0, time=[0.0, 1e-7])
    finally:
        said.cancel()


def progress(what: str = "inferring") -> Progress:
    """A bar on stderr that vanishes when done."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def read_files(
    files: list[Path], medium: Medium, rmax_um: float | None, exposure_us: float | None = None
) -> tuple[list[RadiusCurve], int]:
    """All curves of all files, and the number of files that could not be read (each is reported on stderr)."""
    from cavirheo.reading.shots import read_shots

    if exposure_us is not None and not 0.0 < exposure_us < math.inf:
        raise InputError(f"--exposure-us must be a positive time in us, got {exposure_us:g}")
    scale = None if rmax_um is None else rmax_um * 1e-6
    curves, problems = read_shots(files, density=medium.density, pressure=medium.pressure, max_radius=scale)
    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)
    if not curves:
        raise InputError("no curve could be read")
    if exposure_us is not None:
        exposed = {"exposure_s": exposure_us * 1e-6}
        curves = [replace(curve, meta={**curve.meta, **exposed}) for curve in curves]
    return curves, len(problems)


def verified(curves: list[RadiusCurve], answers: list[Posterior], level: str, **settings: Any) -> list[Posterior]:
    """The answers with --verify none, map or full; `settings` are those of `verify_many`."""
    if level == "none":
        return answers
    from cavirheo.inference.verify import verify_many

    with progress("verifying") as bar:
        task = bar.add_task("", total=len(curves))
        return verify_many(curves, answers, level=level, done=lambda: bar.advance(task), **settings)  # type: ignore[arg-type]


def report(curves: list[RadiusCurve], answers: list[Posterior], out: Path, began: float, unreadable: int) -> None:
    """The end of `infer` and `fit`: documents into `out`, the table, the time since `began`, the exit status."""
    from cavirheo.reporting import write_report
    from cavirheo.reporting.table import print_table

    result = write_report(out, list(zip(curves, answers, strict=True)), shlex.join(["cavirheo", *sys.argv[1:]]))
    print_table(result)
    seconds = time.perf_counter() - began
    print(f"{len(curves)} curves in {seconds:.1f} s; report: {out / 'report.html'}", file=sys.stderr)
    if unreadable:
        raise typer.Exit(2)
    if any(answer.checks.verdict == "failed" for answer in answers):
        raise typer.Exit(1)


def check_level(level: str, exposure_us: float | None = None) -> None:
    """Raises InputError for another --verify than none, map or full, or for an exposure that nothing would use, before
    hours are spent."""
    if level not in ("none", "map", "full"):
        raise InputError(f"--verify must be none, map or full, got {level!r}")
    if exposure_us is not None and level == "none":
        raise InputError("--exposure-us belongs to the camera of the posterior: give --verify map or full too")


def number_or(text: str | None, word: str, option: str, kind: type[Any]) -> Any:
    """`text` as a number of this kind, unless it is the word or None."""
    if text is None or text == word:
        return text
    try:
        return kind(text)
    except ValueError:
        raise InputError(f"{option} must be a number or {word!r}, got {text!r}") from None
