"""`cavirheo design`: what is known and what a rig can do in; a table, design.json and a picture out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import InputError, require
from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run

CAMERA, SEARCH = "Camera", "Search"
_Range = tuple[float, float]
_FIND = "find where this posterior network is least sure, and write a recipe for it"


@dataclass(kw_only=True)
class Design(options.Printing, options.Documents, options.Pictures, options.Seed, options.Liquid, options.OneBubble):
    """Which shot to take next, and how many: expected intervals over R_max and frame rate."""

    known: Annotated[Path | None, argument("[RESULT]", "result.json with what is known so far", readable=False)] = None
    group: Annotated[str | None, option("group of the result.json whose material is meant")] = None
    shear_modulus: Annotated[_Range | None, option("range in Pa, if there is no result.json", metavar="LOW HIGH")] = (
        None
    )
    viscosity: Annotated[_Range | None, option("Pa s", metavar="LOW HIGH")] = None
    stretch: Annotated[_Range | None, option("R_max/R_0  [default: 4 10]", metavar="LOW HIGH")] = None
    material: Annotated[str, option("a law of `cavirheo laws`", autocompletion=completion.sum_names)] = "nhkv"
    rmax_um: Annotated[_Range, option("R_max of the rig, um", metavar="LOW HIGH")] = (50, 400)
    fps: Annotated[str, option("frames per second of the camera, with commas")] = "1e5,2.5e5,5e5,1e6"
    frames: Annotated[int, option("of a recording", min=10)] = 128
    noise_percent: Annotated[float, option("noise of the radius, % of R_max", CAMERA)] = 1.0
    noise_um: Annotated[str, option("further noise, um; or one value for each frame rate, with commas", CAMERA)] = "0"
    exposure_us: Annotated[float, option("exposure time of a frame, us", CAMERA, min=0.0)] = 0.0
    wanted_percent: options.WantedPercent = 10.0
    spread: Annotated[float | None, option("scatter of shots, decades  [default: of the result.json]", SEARCH)] = None
    sizes: Annotated[int, option("number of R_max to try", SEARCH, min=1)] = 5
    draws: Annotated[int, option("simulated recordings for each setting", SEARCH, min=2)] = 12
    check: Annotated[int, option("recordings of a recommended setting that `infer` answers", SEARCH, min=0)] = 6
    for_training: Annotated[
        str | None, option(_FIND, SEARCH, metavar="MODEL", autocompletion=completion.model_names)
    ] = None
    recordings: Annotated[int | None, option("number of them for --for-training  [default: 120]", SEARCH, min=30)] = (
        None
    )
    out: options.Out = Path("cavirheo-design")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.design import Rig
        from cavirheo.companions.design import design as designed
        from cavirheo.companions.design_document import picture, print_table
        from cavirheo.parallel import aside
        from cavirheo.physics.simulate import load_solver
        from cavirheo.writing import style
        from cavirheo.writing.document import Outputs, write_json

        if self.for_training is not None:
            message = "--for-training looks at a network over its own training: give no result.json"
            require(self.known is None, message, "design.for_training")
            return _for_training(self, self.for_training, run)
        message = "--recordings is of --for-training: give that too, or --draws for the recordings of each setting"
        require(self.recordings is None, message, "design.for_training")
        message = "--group names a group of a result.json: give the file, or leave out --group"
        require(self.known is not None or self.group is None, message, "design.group")
        rates = _numbers("--fps", self.fps)
        noise = [1e-6 * one for one in _numbers("--noise-um", self.noise_um)]
        ranges = {name: getattr(self, name) for name in ("shear_modulus", "viscosity", "stretch")}
        drawing = self.pictures and style.available()
        outputs = Outputs(
            self.out, "design.json", *(["design.png"] if drawing else []), inputs=[self.known] if self.known else []
        )
        rig = Rig(
            max_radius=[1e-6 * end for end in self.rmax_um],
            frame_rate=rates,
            frames=self.frames,
            noise=noise,
            relative_noise=0.01 * self.noise_percent,
            exposure=1e-6 * self.exposure_us,
            material=self.material,
            medium=self.liquid,
            bubble=self.bubbles or "real",
        )
        settings: dict[str, Any] = {name: getattr(self, name) for name in ("spread", "sizes", "draws", "check", "seed")}
        settings |= {"ranges": {name: pair for name, pair in ranges.items() if pair}}
        settings["wanted"] = 0.01 * self.wanted_percent
        aside(load_solver)
        with run.bar("simulating", self.sizes * len(rates) * self.draws) as advance:
            made = designed(self.known, rig, group=self.group, done=advance, **settings)
        made.command, made.date = run.command, run.date
        if self.pictures and not drawing:
            made.notes.append(style.NO_PICTURES)
        outputs.write("design.json", write_json, made)
        if drawing and (said := outputs.picture("design.png", style.save, picture, made)):
            made.notes += said
            outputs.write("design.json", write_json, made)
        outputs.finish()
        run.show(made, print_table)
        run.end(f"written to {self.out} in {{seconds}}")


def _for_training(asked: Design, model: str, run: Run) -> None:
    from cavirheo.companions.network_design import network_design, print_table, recipe
    from cavirheo.inference.posterior_model import load_posterior
    from cavirheo.parallel import aside
    from cavirheo.physics.simulate import load_solver
    from cavirheo.writing.document import Outputs, write_json

    network, recordings, out = load_posterior(model), asked.recordings or 120, asked.out
    outputs = Outputs(out, "network-design.json", "recipe.toml")
    aside(load_solver)
    with run.bar("simulating", recordings) as advance:
        made = network_design(
            network,
            asked.material,
            recordings=recordings,
            seed=asked.seed,
            done=advance,
            command=run.command,
            date=run.date,
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
