"""How good an exported model is on curves with known true values: numbers, tables, pictures. Torch is not needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.inference.model import Network
from cavirheo.parameters import LOG10, natural_name, parameter_of, to_natural
from cavirheo.prior import Prior
from cavirheo.training.dataset import Dataset, load
from cavirheo.training.recipe import difference
from cavirheo.writing import style, terminal
from cavirheo.writing.document import Document, Outputs, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE = "predicted.png"
BINS = 4  # of a parameter whose prior is not logarithmic; a logarithmic one has a bin for each decade
_ROW_COLUMNS = {  # heading and format of each column
    "low": ("from", "g"),
    "high": ("to", "g"),
    "curves": ("curves", "d"),
    "bias": ("bias", "+.3f"),
    "rmse": ("RMSE", ".3f"),
    "share": ("part of all squared error", ".0%"),
}


class Metrics(Document):
    """The accuracy of a network on simulated curves.

    Attributes:
        model: name of the network.
        data: path, problem, seed and SHA-256 of the set of curves.
        part: "test": the test part of the network's training set; "all": all usable curves of another set.
        curves: number of curves on which the network was judged.
        failures: number of failed simulations in the set, by reason.
        outputs: names of the network's outputs, in the scale of the prior.
        metrics: accuracy of each output. Errors are in the scale of the prior (decades for log10 names); `r2_natural`
            and `median_relative_error` are of the natural values.
        breakdown: errors of each output in bins of the true value of each parameter.
        figures: names of the figure files.
    """

    kind: Literal["metrics"] = "metrics"
    model: str
    data: dict[str, Any]
    part: str
    curves: int
    failures: dict[str, int]
    outputs: list[str]
    metrics: dict[str, Any]
    breakdown: dict[str, Any]
    figures: list[str] = []


class TrainingRun(Document):
    """A finished training of a network.

    Attributes:
        epochs: number of epochs, each of which ends with a validation; an epoch is a pass over the training part, or
            800 steps for a posterior network.
        best_epoch: number of the epoch, from 1, whose weights are exported.
        best_validation_loss: loss of these weights on the validation part.
        seconds: wall time of all epochs, s.
        device: processor or GPU of the training.
        parameters: number of weights of the network.
        history: losses of each epoch, by part ("train", "validation").
        problem_id: identifier of the training problem; empty for a posterior network.
        outputs: names of the network's outputs, in the scale of the prior; empty for a posterior network.
        data: origin of the training set, and number of curves in each part; empty for a posterior network.
        metrics: accuracy of each output on the test part; empty for a posterior network.
    """

    kind: Literal["training"] = "training"
    epochs: int
    best_epoch: int
    best_validation_loss: float
    seconds: float
    device: str
    parameters: int
    history: dict[str, list[float]]
    problem_id: str = ""
    outputs: list[str] = []
    data: dict[str, Any] = {}
    metrics: dict[str, dict[str, float]] = {}


def evaluate(model: Path, data_dir: Path, out_dir: Path | None = None, **head: Any) -> dict[str, Any]:
    """Judge an exported model (.onnx with its card) on a set; tables and the paper's figure go into `out_dir`.

    Of the training set of the model, or of a set of the same draws that was simulated again, only the test part is
    used; of any other set every usable curve. head: `command` and `date` of the document.

    Returns:
        The content of `out_dir`/metrics.json.

    Raises:
        InputError: the set is of another problem than the model (law, parameters, medium, grid of times, R_max), where
            other ranges of the prior are allowed; it has the draws of the training set, but another number of curves;
            or it has fewer than 2 curves.
    """
    outputs = Outputs(out_dir, "metrics.json", "evaluation.md", PICTURE) if out_dir is not None else None
    network, data = Network(model), load(data_dir)
    is_training_set = _trained_on(network, data)
    chosen = data.split(network.card["training"]["seed"])["test"] if is_training_set else np.flatnonzero(data.ok)
    names, theta = network.outputs, data.theta[chosen]
    truth, predicted = data.truth(names)[chosen], network(data.radius[chosen])
    document = Metrics(
        **{"command": "in Python", **head},
        model=network.card["name"],
        data={"path": str(data_dir), "problem_id": data.problem.id, "seed": data.seed, "sha256": data.sha256},
        part="test" if is_training_set else "all",
        curves=len(chosen),
        failures=data.failures,
        outputs=list(names),
        metrics=metrics(names, truth, predicted),
        breakdown=breakdown(names, data.problem.prior, theta, predicted - truth),
        notes=_other_ranges(network, data, theta),
    )
    if outputs is not None:
        drawing = style.save, draw, document.metrics, truth, predicted
        failed = outputs.write_picture(PICTURE, *drawing) if style.available() else [style.NO_PICTURES]
        document.figures, document.notes = [PICTURE] * (not failed), document.notes + failed
        outputs.write("metrics.json", write_json, document)
        outputs.write("evaluation.md", Path.write_text, markdown(document.model_dump()), encoding="utf-8")
        outputs.finish()
    return document.model_dump(by_alias=True)


def _comparable_problem(whole: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a problem that must be the model's: all but the ranges of the prior and the name of the medium."""
    return dict(whole) | {"prior": sorted(whole["prior"]), "medium": whole["medium"] | {"name": ""}}


def _trained_on(network: Network, data: Dataset) -> bool:
    """Whether the set has the draws of the model's training set, whatever the version of the solver.

    Raises InputError: the set is of another problem, or has these draws with another number of curves.
    """
    trained, problem, needed = network.card["data"], data.problem.to_dict(), network.problem.to_dict()
    if change := difference(_comparable_problem(problem), _comparable_problem(needed)):
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
    """A list with a note if the set is drawn from other ranges than the model's training set; else an empty list."""
    trained, prior = network.problem.prior, data.problem.prior
    ranges, outside = [], np.zeros(len(theta), dtype=bool)
    for name, values in zip(prior.names, theta.T, strict=True):
        (low, high), (a, b) = trained.bounds(name), prior.bounds(name)
        outside |= (values < low) | (values > high)
        ranges += [f"{name} {a:g} to {b:g} (trained in {low:g} to {high:g})"] * ((a, b) != (low, high))
    message = f"the set has other ranges than the model's: {', '.join(ranges)}; {outside.sum()} of {len(theta)} curves"
    return [f"{message} lie outside, and R² depends on the range"] if ranges else []


def markdown(result: Mapping[str, Any]) -> str:
    """Tables of an `evaluate` result: metrics, and the squared error by bins of the true values."""
    outputs = {name: label(name) for name in result["outputs"]}
    which = "the test part of its own training set" if result["part"] == "test" else "a set it was not trained on"
    text = [f"# {result['model']} on {result['curves']} curves, {which}", ""]
    text += [f"Note: {note}." for note in result["notes"]]
    text += ["Errors of log10 quantities are in decades.", ""]
    text += _table("output", METRICS, [(words, result["metrics"][name]) for name, words in outputs.items()])
    for name, words in outputs.items():
        text += ["", f"## Where the error of {words} sits", ""]
        bins = result["breakdown"][name].items()
        text += _table("true value of", _ROW_COLUMNS, [(label(key), row) for key, rows in bins for row in rows])
    return "\n".join(text) + "\n"


def draw(outputs: Mapping[str, Mapping[str, float]], truth: Floats, predicted: Floats) -> Figure:
    """Plot predicted over true values (curves, outputs), in the prior's scale. outputs: metrics of each output."""
    figure = style.new_figure(4.4, 4.3 * len(outputs))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(1, len(outputs), squeeze=False)[0]
    for axes, name, *columns in zip(panels, outputs, truth.T, predicted.T, strict=True):
        t, p = (to_natural(name, column) for column in columns)
        logarithmic, symbol = name.startswith(LOG10), parameter_of(name).symbol
        words = label(natural_name(name), symbol)
        ends = [min(t.min(), p.min()), max(t.max(), p.max())]
        axes.plot(t, p, marker=".", ls="", ms=3.5, mew=0, color=style.BLUE, alpha=0.5)
        axes.plot(ends, ends, color=style.INK, lw=1, label="predicted = true", zorder=1)
        scale = "log" if logarithmic else "linear"
        axes.set(xlabel=f"true {words}", ylabel=f"predicted {words}", xscale=scale, yscale=scale)
        axes.set(xlim=axes.get_ylim(), box_aspect=1)
        axes.set_title(f"R² = {outputs[name]['r2']:.4f}" + " of the logarithm" * logarithmic, fontsize=10)
        axes.legend(loc="upper left", frameon=False, fontsize=9)
    return figure


def label(name: str, symbol: str = "") -> str:
    """Readable form of a name in the prior's scale: log10_viscosity -> log10 viscosity (Pa s)."""
    words, unit = natural_name(name).replace("_", " "), parameter_of(name).unit
    return "log10 " * name.startswith(LOG10) + words + f" {symbol}" * bool(symbol) + f" ({unit})" * (unit != "1")


def _table(
    first: str, columns: Mapping[str, Sequence[Any]], rows: Sequence[tuple[str, Mapping[str, Any]]]
) -> list[str]:
    """Lines of a Markdown table whose columns are aligned, so that it can be read in a terminal, too."""
    texts = [[first, *(heading for heading, *_ in columns.values())]]
    for name, values in rows:
        numbers = ["-" if values[key] is None else format(values[key], form) for key, (_, form, *_) in columns.items()]
        texts.append([name, *numbers])
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    rule = ["-" * (widths[0] + 1), *("-" * width + ":" for width in widths[1:])]
    form = " | ".join(f"{{:{'>' if k else '<'}{width}}}" for k, width in enumerate(widths))
    head, *lines = (f"| {form.format(*row)} |" for row in texts)
    return [head, f"|-{'|-'.join(rule)}|", *lines]


def print_metrics(document: Metrics) -> None:
    """Print the tables of evaluation.md."""
    terminal.write(markdown(document.model_dump()))


def print_run(document: TrainingRun) -> None:
    """Print the duration of the training and the errors on the test part."""
    where = f"on {document.device}; best: {document.best_epoch}"
    terminal.write(f"{document.epochs} epochs in {document.seconds:.0f} s {where}")
    for name, score in document.metrics.items():
        terminal.write(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.

    Raises InputError: fewer than 2 curves, or shapes that do not fit.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    fine = truth.shape == predicted.shape == (max(len(truth), 2), len(names))
    shapes = f"got shapes {truth.shape} and {predicted.shape}"
    require(fine, f"need truth and prediction of 2 curves or more for {', '.join(names)}, {shapes}", "metrics.shape")
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        scales = {"prior": (t, p), "natural": (to_natural(name, t), to_natural(name, p))}
        result[name] = {key: float(formula(*scales[scale])) for key, (*_, scale, formula) in METRICS.items()}
    return result


def breakdown(outputs: Sequence[str], prior: Prior, theta: Floats, error: Floats) -> dict[str, Any]:
    """Errors (curves, outputs) by bins of the true theta (curves, parameters), in the prior's scale.

    Returns:
        By output and parameter, a row for each bin of the true value: {"low", "high", "curves", "bias", "rmse",
        "share"}; share: part of the sum of squared errors of the output. bias and rmse of an empty bin are None.
    """
    result: dict[str, Any] = {output: {} for output in outputs}
    for name, low, high, values in zip(prior.names, prior.low, prior.high, theta.T, strict=True):
        count = max(1, round(high - low)) if name.startswith(LOG10) else BINS
        edges = np.linspace(low, high, count + 1)
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
        for output, e in zip(outputs, error.T, strict=True):
            total = max(np.sum(e**2), np.finfo(float).tiny)
            rows = result[output][name] = []
            for k, (first, last) in enumerate(pairwise(edges.tolist())):
                in_bin = e[place == k]
                bias, rmse = (float(in_bin.mean()), float(np.sqrt(np.mean(in_bin**2)))) if len(in_bin) else (None, None)
                row = {"low": first, "high": last, "curves": len(in_bin), "bias": bias, "rmse": rmse}
                rows.append(row | {"share": float(np.sum(in_bin**2) / total)})
    return result


def _r2(truth: Floats, predicted: Floats) -> float:
    """Coefficient of determination: 1 - sum of squared errors / sum of squared deviations from the mean."""
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))


# heading, format, scale, and formula for truth t and prediction p
METRICS: dict[str, tuple[str, str, str, Callable[[Floats, Floats], Any]]] = {
    "r2": ("R²", ".4f", "prior", _r2),
    "r2_natural": ("R² of the natural value", ".4f", "natural", _r2),
    "median_absolute_error": ("median error", ".3f", "prior", lambda t, p: np.median(np.abs(p - t))),
    "p90_absolute_error": ("90 % below", ".3f", "prior", lambda t, p: np.quantile(np.abs(p - t), 0.9)),
    "rmse": ("RMSE", ".3f", "prior", lambda t, p: np.sqrt(np.mean((p - t) ** 2))),
    "bias": ("bias", "+.3f", "prior", lambda t, p: np.mean(p - t)),
    "median_relative_error": ("median relative error", ".1%", "natural", lambda t, p: np.median(np.abs(p / t - 1.0))),
}
