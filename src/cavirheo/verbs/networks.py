"""`cavirheo models`, `generate`, `train` and `evaluate`: the shipped networks, and how a network is made."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import InputError, require
from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run
from cavirheo.writing.digits import printable


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.model import card, shipped

    for name, path in shipped().items():
        print(printable("\n".join(summary(name, card(path)))))


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
    run, seed = Run(quiet=quiet), content.data.seed if seed is None else seed
    how: dict[str, Any] = {"seed": seed, "workers": workers, "shard": (part, parts), "progress": not quiet}
    with connected(scheduler, run.say) as executor:
        written = dataset.generate(content.problem, n or content.data.n, out, executor=executor, **how)
    run.say(f"{written.curves} curves in {out}: {written.written} files written, {written.skipped} already there")
    if written.simulated:
        rate = written.simulated / written.seconds
        run.say(f"{written.simulated} simulated in {written.seconds:.0f} s ({rate:.0f} per s)")
    for status, count in written.failures.items():
        run.say(f"{count} failed: {status}")


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
        from cavirheo.training import train as training
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install cavirheo with the extra [train]") from error
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        result = training.train(content, data, out, device=device, threads=threads, progress=not quiet)
        path = training.export(content, out, out)
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
class Evaluate(options.Verb):
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""

    model: Annotated[str, argument("MODEL", "a shipped model or an .onnx file", autocompletion=completion.model_names)]
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")]
    out: options.Out = Path("cavirheo-evaluation")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference.model import path_of
        from cavirheo.training.evaluate import evaluate as judge
        from cavirheo.training.evaluate import markdown

        metrics = judge(path_of(self.model), self.data, self.out, command=run.command, date=run.date)
        if not run.quiet:
            print(markdown(metrics))
        run.say(f"written to {self.out}")


def summary(name: str, content: dict[str, Any]) -> list[str]:
    """What a model answers, for which recordings, and how well, by its card. Raises KeyError, TypeError, ValueError:
    the card lacks something that every card has."""
    if content["kind"] == "posterior":
        from cavirheo.inference.model import PosteriorCard
        from cavirheo.inference.posterior_network import describe

        return [f"{name}: draws of the parameters, for any camera", *describe(PosteriorCard.model_validate(content))]
    lines = [f"{name}: {content['material']}, one value each without an interval"]
    for output in content["outputs"]:
        score = content["metrics"][output["name"]]["r2"]
        low, high = content["problem"]["prior"][output["name"]]
        if output["scale"] == "log10":
            low, high = 10**low, 10**high
        values = f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"
        lines.append(f"  {values:40s} R2 {score:.4f} ({output['scale']} scale, {content['data']['test']} test curves)")
    return [*lines, f"  trained on {content['data']['train']} simulated curves"]


def explain(path: Path) -> None:
    """Print a model's summary, who made it with what, and its files. Raises InputError: no model, or its card lacks
    what every card has."""
    from cavirheo.inference.model import card
    from cavirheo.verbs.machine import checksum

    content = card(path)
    libraries = content.get("made_with") or content.get("versions") or {}
    origin = [content.get("date", ""), *(f"{library} {version}" for library, version in libraries.items())]
    weights = content.get("network", {}).get("parameters")
    size = f"{path.stat().st_size / 1e6:.3g} MB" + (f", {weights} weights" if weights else "")
    try:
        lines = [
            *summary(path.stem, content),
            f"  made {', '.join(filter(None, origin))}; license: {content.get('license', 'not on the card')}",
            f"  file {path}, {size}, sha256 {checksum(path)}",
            f"  card {path.with_suffix('.json')}: priors, training, losses and scores in full",
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the card of {path} lacks what it should say: {error!r}", "model.card") from None
    print(printable("\n".join(lines)))
