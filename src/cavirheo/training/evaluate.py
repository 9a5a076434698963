"""How good an exported model is on curves whose truth is known: numbers, tables and pictures. No torch here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.inference.model import Network
from cavirheo.parallel import Executor
from cavirheo.parameters import LOG10, natural_name, parameter_of
from cavirheo.training import figures
from cavirheo.training.dataset import Dataset, load
from cavirheo.training.documents import Metrics
from cavirheo.training.metrics import breakdown, metrics
from cavirheo.training.recipe import difference
from cavirheo.training.robustness import robustness
from cavirheo.writing.document import Outputs, write_json
from cavirheo.writing.style import available

# heading and format of each column
METRICS = {
    "r2": ("R²", ".4f"),
    "r2_natural": ("R² of the natural value", ".4f"),
    "median_absolute_error": ("median error", ".3f"),
    "p90_absolute_error": ("90 % below", ".3f"),
    "rmse": ("RMSE", ".3f"),
    "bias": ("bias", "+.3f"),
    "median_relative_error": ("median relative error", ".1%"),
}
_ROW = {
    "low": ("from", "g"),
    "high": ("to", "g"),
    "curves": ("curves", "d"),
    "bias": ("bias", "+.3f"),
    "rmse": ("RMSE", ".3f"),
    "share": ("part of all squared error", ".0%"),
}


def evaluate(
    model: Path,
    data_dir: Path,
    out_dir: Path | None = None,
    *,
    robust: bool = False,
    progress: bool = True,
    executor: Executor | None = None,
    **head: Any,
) -> dict[str, Any]:
    """Judge an exported model (.onnx with its card) on a set; tables and the paper's figures go into `out_dir`.

    On the set that it was trained on, or one of the same draws made anew, only the test part counts; on any other,
    every usable curve. `robust` films the curves anew (robustness.py): minutes of simulation, the answers found by
    the executor if one is given. head: `command` and `date` of the document.

    Returns:
        What `out_dir`/metrics.json holds; robustness is None unless asked for.

    Raises:
        InputError: the set is of another problem than the model (law, parameters, medium, grid of times, R_max), other
            ranges of its prior apart; it shares draws with the training set without being the whole of it; fewer than
            2 curves.
    """
    outputs = Outputs(out_dir, "metrics.json", "evaluation.md", *figures.NAMES) if out_dir is not None else None
    network, data = Network(model), load(data_dir)
    of_training = _trained_on(network, data)
    chosen = data.split(network.card["training"]["seed"])["test"] if of_training else np.flatnonzero(data.ok)
    names, theta = network.outputs, data.theta[chosen]
    truth, predicted = data.truth(names)[chosen], network(data.radius[chosen])
    result: dict[str, Any] = {
        "command": "in Python",
        **head,
        "model": network.card["name"],
        "data": {"path": str(data_dir), "problem_id": data.problem.id, "seed": data.seed, "sha256": data.sha256},
        "part": "test" if of_training else "all",
        "curves": len(chosen),
        "failures": data.failures,
        "outputs": list(names),
        "metrics": metrics(names, truth, predicted),
        "breakdown": breakdown(names, data.problem.prior, theta, predicted - truth),
        "robustness": robustness(network, data, chosen, progress, executor) if robust else None,
        "figures": [],
        "notes": _other_ranges(network, data, theta),
    }
    if outputs is not None:
        if available():
            result["figures"] = figures.draw(outputs, network.card, result, truth, predicted)
        else:
            result["notes"].append("no figures, which need matplotlib: pip install 'cavirheo[plot]'")
        outputs.write("metrics.json", write_json, Metrics(**result))
        outputs.write("evaluation.md", Path.write_text, markdown(result), encoding="utf-8")
        outputs.finish()
    return Metrics(**result).model_dump(by_alias=True)


def _problem(whole: Mapping[str, Any]) -> dict[str, Any]:
    """Of a problem what a model cannot do without: all but the ranges of the prior and the name of the medium."""
    return dict(whole) | {"prior": sorted(whole["prior"]), "medium": whole["medium"] | {"name": ""}}


def _trained_on(network: Network, data: Dataset) -> bool:
    """Whether the set holds the draws of the model's training set, by whichever version of the solver.

    Raises InputError: a set of another problem, or some of those draws only.
    """
    trained, problem, needed = network.card["data"], data.problem.to_dict(), network.problem.to_dict()
    if change := difference(_problem(problem), _problem(needed)):
        hint = "judge it on a set of its own recipe, or choose a model of this one"
        raise InputError(f"the set is not of the problem of {network.name}: {change}; {hint}", "evaluate.problem")
    if data.sha256 == trained["sha256"]:
        return True
    if (data.seed, problem["prior"]) != (trained["seed"], needed["prior"]):
        return False
    message = f"{len(data.theta)} curves with prior and seed ({data.seed}) of the model's training set of "
    message += f"{trained['n']}: some of them were trained on; generate them with another --seed"
    require(len(data.theta) == trained["n"], message, "evaluate.trained_on")
    return True


def _other_ranges(network: Network, data: Dataset, theta: Floats) -> list[str]:
    """What is to be said where the set is drawn from other ranges than those that the model was trained in."""
    trained, prior = network.problem.prior, data.problem.prior
    ranges, outside = [], np.zeros(len(theta), dtype=bool)
    for name, values in zip(prior.names, theta.T, strict=True):
        (low, high), (a, b) = trained.bounds(name), prior.bounds(name)
        outside |= (values < low) | (values > high)
        ranges += [f"{name} {a:g} to {b:g} (trained in {low:g} to {high:g})"] * ((a, b) != (low, high))
    message = f"the set has other ranges than the model's: {', '.join(ranges)}; {outside.sum()} of {len(theta)} curves"
    return [f"{message} lie outside, and R² depends on the range"] if ranges else []


def markdown(result: Mapping[str, Any]) -> str:
    """Tables of an `evaluate` result: metrics, where the squared error sits, and robustness where it was asked for."""
    outputs, robust = {name: label(name) for name in result["outputs"]}, result["robustness"]
    which = "the test part of its own training set" if result["part"] == "test" else "a set it was not trained on"
    text = [f"# {result['model']} on {result['curves']} curves, {which}", ""]
    text += [f"Note: {note}." for note in result["notes"]]
    text += ["Errors of log10 quantities are in decades.", ""]
    text += _table(
        ["output", *_heads(METRICS)], [[outputs[k], *_formatted(result["metrics"][k], METRICS)] for k in outputs]
    )
    for name, words in outputs.items():
        text += ["", f"## Where the error of {words} sits", ""]
        parameters = result["breakdown"][name]["by_parameter"]
        lines = [[label(key), *_formatted(row, _ROW)] for key, rows in parameters.items() for row in rows]
        text += _table(["true value of", *_heads(_ROW)], lines)
    if robust is None:
        return "\n".join(text) + "\n"
    ways = {
        "network": f"network alone, {robust['curves']} curves",
        "network_same_curves": f"network alone, {robust['answers']} of them",
        "answer": f"answer of `cavirheo infer`, the same {robust['answers']}",
        "answer_ok": "of these, answers with the verdict ok",
    }
    filmed = {row["recording"]["name"]: row for row in robust["rows"]}
    for (name, words), (way, title) in product(outputs.items(), ways.items()):
        text += ["", f"## {words} from worse recordings: {title}", ""]
        lines = []
        for how, row in filmed.items():
            score = row[way]
            counts = _formatted((score["metrics"] or {}).get(name), METRICS)
            lines.append([how, *counts, str(score["curves"] - score["failed"])])
        text += _table(["recording", *_heads(METRICS), "answered"], lines)
    verdicts = {how: row["answer"]["verdicts"] for how, row in filmed.items()}
    kinds = sorted({kind for counts in verdicts.values() for kind in counts})
    lines = [[how, *(str(counts.get(kind, 0)) for kind in kinds)] for how, counts in verdicts.items()]
    text += ["", "## Verdicts on the answers", "", *_table(["recording", *kinds], lines)]
    return "\n".join(text) + "\n"


def label(name: str) -> str:
    """A name in the prior's scale for people: log10_viscosity -> log10 viscosity (Pa s)."""
    words, unit = natural_name(name).replace("_", " "), parameter_of(name).unit
    return f"{'log10 ' if name.startswith(LOG10) else ''}{words}{'' if unit == '1' else f' ({unit})'}"


def _heads(columns: Mapping[str, tuple[str, str]]) -> list[str]:
    return [heading for heading, _ in columns.values()]


def _formatted(values: Mapping[str, float | None] | None, columns: Mapping[str, tuple[str, str]]) -> list[str]:
    chosen = {key: values[key] if values else None for key in columns}
    return ["-" if value is None else format(value, columns[key][1]) for key, value in chosen.items()]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table whose columns also stand under each other in a terminal."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    rule = ["-" * (widths[0] + 1), *("-" * width + ":" for width in widths[1:])]
    form = " | ".join(f"{{:{'>' if k else '<'}{width}}}" for k, width in enumerate(widths))
    return [f"| {form.format(*head)} |", f"|-{'|-'.join(rule)}|", *(f"| {form.format(*row)} |" for row in rows)]
