"""How good an exported model is on curves whose truth is known: numbers and pictures. No torch here."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.errors import InputError
from cavirheo.inference.model import card as read_card
from cavirheo.inference.model import predict
from cavirheo.problem import LOG10, natural_name, unit
from cavirheo.training.dataset import Dataset, load

Floats = NDArray[np.float64]


def r2(truth: ArrayLike, predicted: ArrayLike) -> float:
    """Coefficient of determination, 1 - sum of squared errors over that of the mean as predictor."""
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    if truth.shape != predicted.shape or truth.ndim != 2 or truth.shape[1] != len(names) or len(truth) < 2:
        raise InputError(
            f"need truth and prediction of at least 2 curves for {', '.join(names)}, "
            f"got shapes {truth.shape} and {predicted.shape}"
        )
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        t_natural, p_natural = _natural(name, t), _natural(name, p)
        result[name] = {
            "r2": r2(t, p),
            "r2_natural": r2(t_natural, p_natural),
            "median_absolute_error": float(np.median(np.abs(p - t))),
            "rmse": float(np.sqrt(np.mean((p - t) ** 2))),
            "bias": float(np.mean(p - t)),
            "median_relative_error": float(np.median(np.abs(p_natural / t_natural - 1.0))),
        }
    return result


def evaluate(model: str | Path, data_dir: str | Path, out_dir: str | Path | None = None) -> dict[str, Any]:
    """Judge an exported model (.onnx with its card) on a set, and draw the paper's figures into `out_dir`.

    On the very set that it was trained on only the test part counts; on any other, every usable curve.

    Returns:
        {"model", "data", "part", "curves", "failures", "metrics", "figures"}, as in `out_dir`/metrics.json.

    Raises:
        InputError: the set has no truth for an output of the model, or another camera grid.
    """
    card, data = read_card(Path(model)), load(data_dir)
    names = [output["name"] for output in card["outputs"]]
    columns = _columns(names, card, data)
    if own := data.sha256 == card["data"]["sha256"]:
        chosen = data.split(card["training"]["seed"]).test
    else:
        chosen = np.flatnonzero(data.ok)
    truth = data.theta[np.ix_(chosen, columns)]
    predicted = predict(model, data.radius[chosen])
    result: dict[str, Any] = {
        "model": card["name"],
        "data": {
            "path": str(data_dir),
            "problem_id": data.problem.id,
            "seed": data.seed,
            "sha256": data.sha256,
        },
        "part": "test" if own else "all",
        "curves": len(chosen),
        "failures": data.failures,
        "metrics": metrics(names, truth, predicted),
        "figures": [],
    }
    if out_dir is not None:
        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        result["figures"] = draw(folder, names, truth, predicted, card.get("history", {}))
        (folder / "metrics.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result


def draw(
    folder: Path,
    names: Sequence[str],
    truth: Floats,
    predicted: Floats,
    history: Mapping[str, Sequence[float]],
) -> list[str]:
    """Draw loss.png, predicted.png and error.png into the folder; the names of the files drawn.

    Raises InputError if matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("the figures need matplotlib: pip install 'cavirheo[plot]'") from error

    drawn = []

    def save(figure: Any, name: str) -> None:
        figure.savefig(folder / name, dpi=150)
        drawn.append(name)

    if history:
        figure = Figure(figsize=(5, 3.6), layout="constrained")
        axes = figure.subplots()
        for part in ("train", "validation"):
            axes.semilogy(np.arange(1, len(history[part]) + 1), history[part], label=part)
        axes.set(xlabel="epoch", ylabel="mean squared error (standardised)")
        axes.legend(frameon=False)
        save(figure, "loss.png")

    size = (4.4 * len(names), 4.0)
    figure, errors = Figure(figsize=size, layout="constrained"), Figure(figsize=size, layout="constrained")
    for axes, error_axes, name, t, p in zip(
        figure.subplots(1, len(names), squeeze=False)[0],
        errors.subplots(1, len(names), squeeze=False)[0],
        names,
        truth.T,
        predicted.T,
        strict=True,
    ):
        t_natural, p_natural = _natural(name, t), _natural(name, p)
        label = f"{natural_name(name).replace('_', ' ')} ({unit(name)})"
        scale = "log" if name.startswith(LOG10) else "linear"
        ends = [t_natural.min(), t_natural.max()]
        axes.plot(ends, ends, color="0.6", lw=1)
        axes.plot(t_natural, p_natural, ".", ms=3, alpha=0.5)
        axes.set(xlabel=f"true {label}", ylabel=f"predicted {label}", xscale=scale, yscale=scale)
        axes.set_title(f"R² = {r2(t, p):.4f}" + (" (log10)" if scale == "log" else ""), fontsize=10)
        error_axes.axhline(0, color="0.6", lw=1)
        error_axes.plot(t_natural, 100 * (p_natural / t_natural - 1), ".", ms=3, alpha=0.5)
        error_axes.set(xlabel=f"true {label}", ylabel="relative error (%)", xscale=scale)
        error_axes.set_yscale("symlog", linthresh=10)
    save(figure, "predicted.png")
    save(errors, "error.png")
    return drawn


def _columns(names: Sequence[str], card: Mapping[str, Any], data: Dataset) -> NDArray[np.int64]:
    known = data.problem.prior.names
    if missing := [name for name in names if name not in known]:
        raise InputError(f"the set has no {', '.join(missing)}, which the model answers; it has {', '.join(known)}")
    here = data.problem.to_dict()
    for part in ("camera", "reference_max_radius"):
        if here[part] != card["problem"][part]:
            raise InputError(f"the model needs {part} {card['problem'][part]}, the set was made with {here[part]}")
    return np.array([known.index(name) for name in names])


def _natural(name: str, values: Floats) -> Floats:
    return np.asarray(10.0**values if name.startswith(LOG10) else values)
