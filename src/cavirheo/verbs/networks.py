"""`cavirheo models`, `generate`, `train` and `evaluate`: the shipped networks, and how a network is made."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import InputError, require
from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run
from cavirheo.writing.digits import printable
from cavirheo.writing.terminal import say


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.model import card, shipped

    for name, path in shipped().items():
        content = card(path)
        lines = _draws_in_short(content) if content["kind"] == "posterior" else _values_in_short(content, path)
        print(printable("\n".join([f"{name}: {next(lines)}", *lines])))


def generate(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    out: options.Growing,
    n: Annotated[int | None, option("curves; default: as in the recipe", None, "-n", min=1)] = None,
    seed: Annotated[int | None, option("default: as in the recipe", min=0)] = None,
    workers: Annotated[int | None, option("threads; default: all cores", min=1)] = None,
    shard: Annotated[str, option("i/N: make the i-th of N parts only")] = "1/1",
    scheduler: options.Scheduler = None,
    quiet: options.Quiet = False,
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.physics.simulate import load_solver
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe
    from cavirheo.workflow.cluster import connected

    content = read_recipe(recipe)
    try:
        part, parts = (int(number) for number in shard.split("/"))
    except ValueError:
        raise InputError(f"--shard must read i/N, e.g. 2/8; got {shard!r}", "option.shard") from None
    message = "--workers are threads of this machine, and --scheduler has its own: leave out one of them"
    require(workers is None or scheduler is None, message, "option.workers")
    load_solver()
    with connected(scheduler, lambda text: None if quiet else say(text)) as executor:
        written = dataset.generate(
            content.problem,
            content.data.n if n is None else n,
            out,
            seed=content.data.seed if seed is None else seed,
            workers=workers,
            shard=(part, parts),
            progress=not quiet,
            executor=executor,
        )
    messages = [f"{written.curves} curves in {out}: {written.written} files written, {written.skipped} already there"]
    if written.simulated:
        rate = written.simulated / written.seconds
        messages.append(f"{written.simulated} simulated in {written.seconds:.0f} s ({rate:.0f} per s)")
    messages += [f"{count} failed: {status}" for status, count in written.failures.items()]
    if not quiet:
        print(*messages, sep="\n", file=sys.stderr)


def train(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")],
    out: options.Growing,
    threads: Annotated[int | None, option("threads; default: torch's choice", min=1, max=1024)] = None,
    device: Annotated[str | None, option("cpu or cuda; default: cuda if there is one")] = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a recipe's network (the same call resumes) and export it as NAME.onnx with its card NAME.json."""
    try:
        from cavirheo.training import export
        from cavirheo.training.train import train as begin
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install cavirheo with the extra [train]") from error
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        result = begin(content, data, out, device=device, threads=threads, progress=not quiet)
        path = export.export(content, out, out)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if quiet:
        return
    for name, score in result.get("metrics", {}).items():
        print(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
    if "coverage" in result:
        print(f"loss {result['best_validation_loss']:.3f} on curves that were never shown")
    print(f"model: {path}; use it with: cavirheo infer --model {path} FILE", file=sys.stderr)


@dataclass(kw_only=True)
class Evaluate(options.Documents):
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""

    model: Annotated[str, argument("MODEL", "a shipped model or an .onnx file", autocompletion=completion.model_names)]
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")]
    quiet: options.Quiet = False
    out: options.Out = Path("cavirheo-evaluation")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference.model import path_of
        from cavirheo.training.evaluate import evaluate as judge
        from cavirheo.training.evaluate import markdown

        metrics = judge(path_of(self.model), self.data, self.out, command=run.command, date=run.date)
        if not run.quiet:
            print(markdown(metrics))
        run.say(f"written to {self.out}")


def _draws_in_short(content: dict[str, Any]) -> Iterator[str]:
    from cavirheo.inference.model import PosteriorCard
    from cavirheo.inference.posterior_network import describe

    yield "draws of the parameters, for any camera"
    yield from describe(PosteriorCard.model_validate(content))


def _values_in_short(content: dict[str, Any], path: Path) -> Iterator[str]:
    yield f"{content['material']}, one value each without an interval"
    for output in content["outputs"]:
        score = content["metrics"][output["name"]]["r2"]
        scale, curves = output["scale"], content["data"]["test"]
        yield f"  {_output_range(content, output):40s} R2 {score:.4f} ({scale} scale, {curves} test curves)"
    yield f"  trained on {content['data']['train']} curves, {content['date']}; card: {path.with_suffix('.json')}"


def _output_range(content: Mapping[str, Any], output: Mapping[str, Any]) -> str:
    """'shear_modulus 100 to 1e4 Pa': a number that a network gives, in the range that it was trained on."""
    low, high = content["problem"]["prior"][output["name"]]
    if output["scale"] == "log10":
        low, high = 10**low, 10**high
    return f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"


def explain(name: str, path: Path, content: dict[str, Any]) -> None:
    """Print all that the card of a model knows, a line each. Raises KeyError, TypeError, ValueError: it lacks something
    that every card has."""
    from cavirheo.verbs.machine import checksum

    draws = content["kind"] == "posterior"
    size = f"{path.stat().st_size / 1e6:.3g} MB" + _counted(content.get("network", {}), "parameters", " weights")
    rows = [
        *(_of_draws(content) if draws else _of_values(content)),
        *_origin(content),
        ("file", f"{path}, {size}"),
        ("", f"sha256 {checksum(path)}"),
        ("card", str(path.with_suffix(".json"))),
    ]
    what = "draws of the parameters, for any camera" if draws else "one value each, no interval"
    lines = [f"{name}: {what}", *(f"  {title + ':' if title else '':<15}{text}" for title, text in rows)]
    print(printable("\n".join(lines)))


def _of_draws(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from cavirheo.inference.law import Family

    losses = dict(zip(map(tuple, content["kinds"]), content.get("loss_by_kind", ()), strict=False))
    laws = dict.fromkeys(law for law, _ in content["kinds"])
    bubbles = {law: " or ".join(bubble for of, bubble in content["kinds"] if of == law) for law in laws}
    yield from _under(
        "answers", [f"{law} ({', '.join(Family(law).parameters)}), bubble {bubbles[law]}" for law in laws]
    )
    names = dict.fromkeys(name for law in laws for name in Family(law).parameters)
    kinetic = ["accommodation"] * any(bubble == "real" for _, bubble in content["kinds"])
    real = "; real bubble: accommodation and confinement damping"
    yield "", "with each: stretch, R_max, clock and scale" + real * bool(kinetic)
    yield from _under("ranges", map(_range, [*names, "stretch", *kinetic]))
    units = {"max_radius_um": ("R_max", "um"), "frame_interval_us": ("time between frames", "us")}
    trained = []
    for name, (low, high) in content["trained"].items():
        what, unit = units.get(name, (name.replace("_", " "), {"density": "kg/m3", "pressure": "Pa"}.get(name, "")))
        trained.append(f"{what.replace(' rmax', ' R_max')} {low:g} to {high:g} {unit}".rstrip())
    yield from _under("trained on", trained)
    how = content["training"]
    yield "", f"{how['samples']} recordings" + _counted(how, "curves", " simulated curves", " of ")
    yield "training", _time(how) + _counted(how, "held_out", " curves held out")
    yield "loss", f"{how['loss']:.4g} (-log density of the truth, curves held out)"
    for law in laws:
        each = ", ".join(f"{bubble} {loss:g}" for (of, bubble), loss in losses.items() if of == law)
        if each:
            yield "", f"{law} {each}"
    coverage = content.get("coverage", {})
    inside = {
        name: ", ".join(f"{value:.1%} in the {level} % interval" for level, value in share.items())
        for name, share in coverage.get("by_slot", {}).items()
    }
    yield from _under("coverage", [f"{name.replace('_', ' ')} {shares}" for name, shares in inside.items()])
    if "recordings" in coverage:
        yield "", f"of the truth of {coverage['recordings']} recordings, without simulations"


def _of_values(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    data, how, problem = content["data"], content["training"], content["problem"]
    answers = []
    for output in content["outputs"]:
        score = content["metrics"][output["name"]]
        off = f", median error {score['median_relative_error']:.1%}" if "median_relative_error" in score else ""
        answers.append(f"{_output_range(content, output)}, R2 {score['r2']:.4f} ({output['scale']} scale){off}")
    yield from _under("answers", answers)
    medium, camera = problem["medium"], problem["camera"]
    yield "law", f"{content['material']}, field's bubble"
    names = {output["name"] for output in content["outputs"]}
    inner = [f"{name} {low:g} to {high:g}" for name, (low, high) in problem["prior"].items() if name not in names]
    yield "trained on", ", ".join([f"R_max {1e6 * problem['reference_max_radius']:g} um", *inner])
    yield "", f"{camera['frames']} frames of {1e6 * camera['frame_interval']:g} us from R_max on"
    yield "", f"{medium.get('name') or 'a medium'}: {medium['density']:g} kg/m3, {medium['pressure']:g} Pa"
    parts = _counted(data, "validation", " to choose the epoch") + f", {data['test']} for the scores"
    yield "", f"{data['train']} simulated curves{parts}"
    passes = f"{how['epochs']} epochs, the best is {how['best_epoch']}" if "epochs" in how else ""
    yield "training", ", ".join(filter(None, [passes, _time(how)]))
    best = how["best_epoch"] - 1
    losses = [f"{part} {values[best]:.4g}" for part, values in content.get("history", {}).items() if len(values) > best]
    if losses:
        yield "loss", f"{', '.join(losses)} (mean square error, best epoch)"


def _under(title: str, lines: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Several lines with one title, which stands before the first."""
    for line in lines:
        yield title, line
        title = ""


def _origin(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    libraries = content.get("made_with") or content.get("versions") or {}
    origin = ", ".join([*([content["date"]] if "date" in content else []), *(f"{a} {b}" for a, b in libraries.items())])
    if origin:
        yield "made", origin
    if "license" in content:
        yield "license", content["license"]


def _range(name: str) -> str:
    from cavirheo.parameters import parameter_of

    parameter = parameter_of(name)
    if parameter.searched is None:
        return name
    low, high = (10.0**end for end in parameter.searched)
    return f"{name} {low:.3g} to {high:.3g}{'' if parameter.unit == '1' else ' ' + parameter.unit}"


def _counted(of: Mapping[str, Any], key: str, what: str, before: str = ", ") -> str:
    return f"{before}{of[key]}{what}" if key in of else ""


def _time(how: Mapping[str, Any]) -> str:
    """'4400 s (1.2 h) on cpu'."""
    if "seconds" not in how:
        return "time not on the card"
    return f"{how['seconds']:.0f} s ({how['seconds'] / 3600:.2g} h)" + _counted(how, "device", "", " on ")
