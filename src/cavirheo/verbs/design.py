"""`cavirheo design`: what is known and what a rig can do in; a table, design.json and a picture out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.run import Run

_Range = tuple[float, float] | None


def design(
    known: Annotated[Path | None, Argument(readable=False, help="result.json with what is known so far")] = None,
    group: Annotated[str | None, Option(help="group of the result.json whose material is meant")] = None,
    shear_modulus: Annotated[_Range, Option(help="range in Pa, if there is no result.json", metavar="LOW HIGH")] = None,
    viscosity: Annotated[_Range, Option(help="Pa s", metavar="LOW HIGH")] = None,
    stretch: Annotated[_Range, Option(help="R_max/R_0  [default: 4 10]", metavar="LOW HIGH")] = None,
    material: Annotated[str, Option(help="a law of `cavirheo laws`", autocompletion=options.sum_names)] = "nhkv",
    bubbles: options.Bubbles = options.FROM_OPTIONS,
    rmax_um: Annotated[tuple[float, float], Option(help="R_max of the rig, um", metavar="LOW HIGH")] = (50, 400),
    fps: Annotated[str, Option(help="frame rates of the camera, frames per second, with commas")] = "1e5,2.5e5,5e5,1e6",
    frames: Annotated[int, Option(help="of a recording", min=10)] = 128,
    noise_percent: Annotated[float, Option(help="noise of the radius, % of R_max")] = 1.0,
    noise_um: Annotated[str, Option(help="further noise, um; or one value for each frame rate, with commas")] = "0",
    exposure_us: Annotated[float, Option(help="exposure time of a frame, us", min=0.0)] = 0.0,
    wanted_percent: options.WantedPercent = 10.0,
    spread: Annotated[float | None, Option(help="scatter of shots, decades  [default: of the result.json]")] = None,
    sizes: Annotated[int, Option(help="number of R_max to try", min=1)] = 5,
    draws: Annotated[int, Option(help="simulated recordings for each setting", min=2)] = 12,
    check: Annotated[int, Option(help="recordings of a recommended setting that `infer` answers", min=0)] = 6,
    for_training: Annotated[
        str | None,
        Option(
            metavar="MODEL",
            help="find where this posterior network is least sure, and write a recipe for it",
            autocompletion=options.model_names,
        ),
    ] = None,
    recordings: Annotated[int | None, Option(help="number of them for --for-training  [default: 120]", min=30)] = None,
    seed: options.Seed = 0,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-design"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Which shot to take next, and how many: expected intervals over R_max and frame rate."""
    from cavirheo.companions.design import Rig
    from cavirheo.companions.design import design as designed
    from cavirheo.companions.design_document import picture, print_table
    from cavirheo.parallel import aside
    from cavirheo.physics.simulate import load_solver
    from cavirheo.writing import style
    from cavirheo.writing.document import Outputs, write_json

    if for_training is not None:
        message = "--for-training looks at a network over its own training: give no result.json"
        require(known is None, message, "design.for_training")
        return _for_training(for_training, material, recordings or 120, seed, out, run)
    message = "--recordings is of --for-training: give that too, or --draws for the recordings of each setting"
    require(recordings is None, message, "design.for_training")
    message = "--group names a group of a result.json: give the file, or leave out --group"
    require(known is not None or group is None, message, "design.group")
    rates = _numbers("--fps", fps)
    noise = [1e-6 * one for one in _numbers("--noise-um", noise_um)]
    given = {"shear_modulus": shear_modulus, "viscosity": viscosity, "stretch": stretch}
    drawing = pictures and style.available()
    outputs = Outputs(out, "design.json", *(["design.png"] if drawing else []), inputs=[known] if known else [])
    rig = Rig(
        max_radius=[1e-6 * end for end in rmax_um],
        frame_rate=rates,
        frames=frames,
        noise=noise,
        relative_noise=0.01 * noise_percent,
        exposure=1e-6 * exposure_us,
        material=material,
        medium=liquid,
        bubble=bubbles or "real",
    )
    settings: dict[str, Any] = {"wanted": 0.01 * wanted_percent, "spread": spread, "sizes": sizes, "draws": draws}
    settings |= {"ranges": {name: pair for name, pair in given.items() if pair}, "check": check, "seed": seed}
    aside(load_solver)
    with run.bar("simulating", sizes * len(rates) * draws) as advance:
        made = designed(known, rig, group=group, done=advance, **settings)
    made.command, made.date = run.command, run.date
    if pictures and not drawing:
        made.notes.append(style.NO_PICTURES)
    outputs.write("design.json", write_json, made)
    if drawing and (said := outputs.picture("design.png", style.save_png, picture, made)):
        made.notes += said
        outputs.write("design.json", write_json, made)
    outputs.finish()
    run.show(made, print_table)
    run.end(f"written to {out} in {{seconds}}")


def _for_training(model: str, material: str, recordings: int, seed: int, out: Path, run: Run) -> None:
    from cavirheo.companions.network_design import network_design, print_table, recipe
    from cavirheo.inference.posterior_model import load_posterior
    from cavirheo.parallel import aside
    from cavirheo.physics.simulate import load_solver
    from cavirheo.writing.document import Outputs, write_json

    network = load_posterior(model)
    outputs = Outputs(out, "network-design.json", "recipe.toml")
    aside(load_solver)
    with run.bar("simulating", recordings) as advance:
        made = network_design(
            network, material, recordings=recordings, seed=seed, done=advance, command=run.command, date=run.date
        )
    outputs.write("network-design.json", write_json, made)
    outputs.write("recipe.toml", lambda path, text: path.write_text(text, encoding="utf-8"), recipe(made, network))
    outputs.finish()
    run.show(made, print_table)
    run.end(f"{made.recordings} recordings in {{seconds}}; recipe: {out / 'recipe.toml'}")


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be numbers with commas, got {text!r}", "option.numbers") from None
