"""How good an exported model is on curves whose truth is known: numbers, tables and pictures. No torch here."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.errors import InputError
from cavirheo.inference.model import Network
from cavirheo.parameters import LOG10, about, natural_name
from cavirheo.training import figures
from cavirheo.training.dataset import Dataset, load
from cavirheo.training.metrics import breakdown, metrics
from cavirheo.training.robustness import ANSWERS, RECORDINGS, robustness
from cavirheo.writing.document import into
from cavirheo.writing.terminal import bar

METRICS = {  # heading and format of each
    "r2": ("R²", ".4f"),
    "r2_natural": ("R² of the natural value", ".4f"),
    "median_absolute_error": ("median error", ".3f"),
    "p90_absolute_error": ("90 % below", ".3f"),
    "rmse": ("RMSE", ".3f"),
    "bias": ("bias", "+.3f"),
    "median_relative_error": ("median relative error", ".1%"),
}


def evaluate(
    model: str | Path,
    data_dir: str | Path,
    out_dir: str | Path | None = None,
    *,
    robust: bool = False,
    answers: int = ANSWERS,
    seed: int = 0,
    workers: int | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Judge an exported model (.onnx with its card) on a set; tables and the paper's figures go into `out_dir`.

    On the set that it was trained on, or one of the same draws made anew, only the test part counts; on any other,
    every usable curve. `robust` films the curves anew with noise, other frame rates and gaps (training/robustness.py),
    minutes of simulation; `answers`, `seed`, `workers` and `progress` are of that.

    Returns:
        {"model", "data", "part", "curves", "failures", "outputs", "metrics", "breakdown", "robustness", "figures"}, as
        in `out_dir`/metrics.json; robustness is None unless asked for.

    Raises:
        InputError: the set has no truth for an output of the model, or another grid of times; it shares draws with
            the training set without being the whole of it; fewer than 2 curves; no matplotlib for the figures.
    """
    network, data = Network(Path(model)), load(data_dir)
    _check_fits(network, data)
    own = _same_bubbles(network, data)
    chosen = data.split(network.card["training"]["seed"])["test"] if own else np.flatnonzero(data.ok)
    names, prior, theta = network.outputs, data.problem.prior, data.theta[chosen]
    truth, predicted = theta[:, [prior.names.index(name) for name in names]], network(data.radius[chosen])
    result: dict[str, Any] = {
        "model": network.card["name"],
        "data": {"path": str(data_dir), "problem_id": data.problem.id, "seed": data.seed, "sha256": data.sha256},
        "part": "test" if own else "all",
        "curves": len(chosen),
        "failures": data.failures,
        "outputs": list(names),
        "metrics": metrics(names, truth, predicted),
        "breakdown": breakdown(names, prior, theta, predicted - truth),
        "robustness": None,
        "figures": [],
    }
    if robust:
        total = len(RECORDINGS) * min(answers, len(chosen))
        with bar("filming, answering", total, shown=progress) as advance:
            result["robustness"] = robustness(
                network, data, chosen, answers=answers, seed=seed, workers=workers, done=advance
            )
    if out_dir is not None:
        with into(out_dir) as folder:
            result["figures"] = figures.draw(folder, network.card, result, truth, predicted)
            (folder / "metrics.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
            (folder / "evaluation.md").write_text(markdown(result), encoding="utf-8")
    return result


def _check_fits(network: Network, data: Dataset) -> None:
    """Raises InputError: the set has no truth for an output, or its curves are not what the network reads."""
    known = data.problem.prior.names
    if missing := [name for name in network.outputs if name not in known]:
        raise InputError(f"the set has no {', '.join(missing)}, which the model answers; it has {', '.join(known)}")
    here, needed = data.problem.to_dict(), network.problem.to_dict()
    for part in ("camera", "reference_max_radius"):
        if here[part] != needed[part]:
            message = f"the model needs {part} {needed[part]}, the set was made with {here[part]}"
            raise InputError(message, "evaluate.grid")


def _same_bubbles(network: Network, data: Dataset) -> bool:
    """Whether the set holds the draws of the model's training set, by whichever version of the solver."""
    trained = network.card["data"]
    if data.sha256 == trained["sha256"]:
        return True
    if data.seed != trained["seed"] or data.problem.prior.to_dict() != network.problem.prior.to_dict():
        return False
    if len(data.theta) != trained["n"]:
        raise InputError(
            f"the set has the prior and the seed ({data.seed}) of the model's training set but {len(data.theta)} "
            f"curves instead of {trained['n']}: some of them were trained on; generate it with another --seed",
            "evaluate.trained_on",
        )
    return True


def markdown(result: Mapping[str, Any]) -> str:
    """Tables of an `evaluate` result: metrics, where the squared error sits, and robustness where it was asked for."""
    outputs, heads = result["outputs"], [heading for heading, _ in METRICS.values()]
    which = "the test part of its own training set" if result["part"] == "test" else "a set it was not trained on"
    text = [f"# {result['model']} on {result['curves']} curves, {which}", ""]
    text += ["Errors of log10 quantities are in decades.", ""]
    text += _table(["output", *heads], [[label(name), *_cells(result["metrics"][name])] for name in outputs])
    for name in outputs:
        text += ["", f"## Where the error of {label(name)} sits", ""]
        text += _table(
            ["true value of", "from", "to", "curves", "bias", "RMSE", "part of all squared error"],
            [
                [
                    *(label(parameter), f"{row['low']:g}", f"{row['high']:g}", str(row["curves"])),
                    *(_number(row["bias"], "+.3f"), _number(row["rmse"], ".3f"), f"{row['share']:.0%}"),
                ]
                for parameter, rows in result["breakdown"][name]["by_parameter"].items()
                for row in rows
            ],
        )
    if robust := result["robustness"]:
        ways = {
            "network": f"network alone, {robust['curves']} curves",
            "network_same_curves": f"network alone, {robust['answers']} of them",
            "answer": f"answer of `cavirheo infer`, the same {robust['answers']}",
            "answer_ok": "of these, answers with the verdict ok",
        }
        filmed = [(row["recording"]["name"], row) for row in robust["rows"]]
        for name in outputs:
            for way, title in ways.items():
                text += ["", f"## {label(name)} from worse recordings: {title}", ""]
                rows = [
                    [how, *_cells((row[way]["metrics"] or {}).get(name)), str(row[way]["curves"] - row[way]["failed"])]
                    for how, row in filmed
                ]
                text += _table(["recording", *heads, "answered"], rows)
        text += ["", "## Verdicts on the answers", ""]
        kinds = sorted({kind for _, row in filmed for kind in row["answer"]["verdicts"]})
        verdicts = [[how, *(str(row["answer"]["verdicts"].get(kind, 0)) for kind in kinds)] for how, row in filmed]
        text += _table(["recording", *kinds], verdicts)
    return "\n".join(text) + "\n"


def label(name: str) -> str:
    """A name in the prior's scale for people: log10_viscosity -> log10 viscosity (Pa s)."""
    words, unit = natural_name(name).replace("_", " "), about(name).unit
    return f"{'log10 ' if name.startswith(LOG10) else ''}{words}{'' if unit == '1' else f' ({unit})'}"


def _cells(values: Mapping[str, float] | None) -> list[str]:
    """One for each of METRICS."""
    return [_number(values[key] if values else None, form) for key, (_, form) in METRICS.items()]


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table whose columns also stand under each other in a terminal."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        padded = [cells[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(cells[1:], widths[1:], strict=True))]
        return "| " + " | ".join(padded) + " |"

    rule = "|" + "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])]) + "|"
    return [line(head), rule, *map(line, rows)]
