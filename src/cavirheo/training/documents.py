"""metrics.json of `cavirheo evaluate`, and result.json of a training run."""

from __future__ import annotations

from typing import Any, Literal

from cavirheo.writing.document import Document


class Metrics(Document):
    """How good a model is on simulated curves.

    Attributes:
        model: name of the network.
        data: which set it was judged on.
        part: "test", the test part of the set that it was trained on, or "all" curves of another set.
        curves: how many.
        failures: of simulations of the set, by reason.
        outputs: what the network answers.
        metrics: of each output, in the scale of the prior.
        breakdown: of each output, where in the prior its error sits.
        robustness: from worse recordings; null where that was not asked for.
        figures: names of their files.
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
    robustness: dict[str, Any] | None = None
    figures: list[str] = []


class TrainingRun(Document):
    """A finished training of a network.

    Attributes:
        epochs: how often it was validated: a pass over the set, or some steps of a posterior network.
        best_epoch: of which the weights are.
        best_validation_loss: of that epoch.
        seconds: wall time of all epochs.
        device: where it was trained.
        parameters: how many weights.
        history: losses of each epoch, by part.
        problem_id: of what a network that gives values was trained on.
        outputs: what it answers.
        data: the set and its parts.
        metrics: of each output on the test part.
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


def print_metrics(document: Metrics) -> None:
    """The tables of evaluation.md."""
    from cavirheo.training.evaluate import markdown

    print(markdown(document.model_dump()))


def print_run(document: TrainingRun) -> None:
    """How long it took, and how good it is on its test part."""
    print(f"{document.epochs} epochs in {document.seconds:.0f} s on {document.device}; best: {document.best_epoch}")
    for name, score in document.metrics.items():
        print(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
