"""How good a trained network is: metrics of its values, and the document of a training. Torch is not needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import to_natural
from cavirheo.writing import terminal
from cavirheo.writing.document import Document


class TrainingRun(Document):
    """A finished training of a network.

    Attributes:
        epochs: number of epochs, each of which ends with a validation; an epoch is a pass over the training part, or
            500 steps for an emulator.
        best_epoch: number of the epoch, from 1, whose weights are exported.
        best_validation_loss: loss of these weights on the validation part; for an emulator the median error.
        seconds: wall time of all epochs, s.
        device: processor or GPU of the training.
        parameters: number of weights of the network.
        history: losses of each epoch, by part ("train", "validation"); for an emulator median errors.
        problem_id: identifier of the training problem; empty for an emulator.
        outputs: names of the network's outputs, in the scale of the prior; empty for an emulator.
        data: origin of the training set, and number of curves in each part.
        metrics: accuracy of each output on the test part; empty for an emulator.
        errors: of an emulator, RMS error of frames over R_max on the test part: "median", "p90", "p95", "p99".
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
    errors: dict[str, float] = {}


def print_run(document: TrainingRun) -> None:
    """Print the duration of the training and the errors on the test part."""
    where = f"on {document.device}; best: {document.best_epoch}"
    terminal.write(f"{document.epochs} epochs in {document.seconds:.0f} s {where}")
    for name, score in document.metrics.items():
        terminal.write(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
    if document.errors:
        terminal.write(
            f"error of the frames on bubbles that were never shown, over R_max: {quantiles(document.errors)}"
        )


def quantiles(errors: Mapping[str, float]) -> str:
    """Quantiles of the errors of an emulator as text."""
    words = {"median": "median", "p90": "90 % below", "p95": "95 % below", "p99": "99 % below"}
    return ", ".join(f"{words[name]} {value:.2%}" for name, value in errors.items())


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.

    Raises InputError: fewer than 2 curves, or shapes that do not fit.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    if truth.shape != predicted.shape or truth.shape != (max(len(truth), 2), len(names)):
        message = f"need truth and prediction of 2 curves or more for {', '.join(names)}, got shapes {truth.shape} and "
        raise InputError(f"{message}{predicted.shape}", "metrics.shape")
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        scales = {"prior": (t, p), "natural": (to_natural(name, t), to_natural(name, p))}
        result[name] = {key: float(formula(*scales[scale])) for key, (scale, formula) in METRICS.items()}
    return result


def _r2(truth: Floats, predicted: Floats) -> float:
    """Coefficient of determination: 1 - sum of squared errors / sum of squared deviations from the mean."""
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))


# scale, and formula for truth t and prediction p
METRICS: dict[str, tuple[str, Callable[[Floats, Floats], Any]]] = {
    "r2": ("prior", _r2),
    "r2_natural": ("natural", _r2),
    "median_absolute_error": ("prior", lambda t, p: np.median(np.abs(p - t))),
    "median_relative_error": ("natural", lambda t, p: np.median(np.abs(p / t - 1.0))),
}
