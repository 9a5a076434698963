"""How good an exported model is on curves whose truth is known: numbers, tables and pictures. No torch here."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import InputError
from cavirheo.inference.model import card as read_card
from cavirheo.inference.model import predict
from cavirheo.training import figures
from cavirheo.training.breakdown import breakdown
from cavirheo.training.dataset import Dataset, load
from cavirheo.training.metrics import metrics
from cavirheo.training.robustness import ANSWERS, RECORDINGS, robustness
from cavirheo.training.tables import markdown
from cavirheo.writing.terminal import bar


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
        InputError: the set has no truth for an output of the model, or another camera grid; it shares draws with the
            training set without being the whole of it; fewer than 2 curves; no matplotlib for the figures.
    """
    path = Path(model)
    card, data = read_card(path), load(data_dir)
    names = [output["name"] for output in card["outputs"]]
    columns = _columns(names, card, data)
    own = _same_bubbles(card, data)
    chosen = data.split(card["training"]["seed"]).test if own else np.flatnonzero(data.ok)
    theta = data.theta[chosen]
    truth, predicted = theta[:, columns], predict(path, data.radius[chosen])
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
        "outputs": names,
        "metrics": metrics(names, truth, predicted),
        "breakdown": breakdown(names, data.problem.prior, theta, predicted - truth),
        "robustness": None,
        "figures": [],
    }
    if robust:
        total = len(RECORDINGS) * min(answers, len(chosen))
        with bar("filming, answering", total, shown=progress) as advance:
            result["robustness"] = robustness(
                path, data, chosen, answers=answers, seed=seed, workers=workers, done=advance
            )
    if out_dir is not None:
        folder = Path(out_dir)
        folder.mkdir(parents=True, exist_ok=True)
        result["figures"] = figures.draw(folder, card, result, truth, predicted)
        (folder / "metrics.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        (folder / "evaluation.md").write_text(markdown(result), encoding="utf-8")
    return result


def _same_bubbles(card: Mapping[str, Any], data: Dataset) -> bool:
    """Whether the set holds the draws of the model's training set, by whichever version of the solver."""
    trained = card["data"]
    if data.sha256 == trained["sha256"]:
        return True
    if data.seed != trained["seed"] or data.problem.to_dict()["prior"] != card["problem"]["prior"]:
        return False
    if len(data.theta) != trained["n"]:
        raise InputError(
            f"the set has the prior and the seed ({data.seed}) of the model's training set but {len(data.theta)} "
            f"curves instead of {trained['n']}: some of them were trained on; generate it with another --seed"
        )
    return True


def _columns(names: Sequence[str], card: Mapping[str, Any], data: Dataset) -> NDArray[np.int64]:
    known = data.problem.prior.names
    if missing := [name for name in names if name not in known]:
        raise InputError(f"the set has no {', '.join(missing)}, which the model answers; it has {', '.join(known)}")
    here = data.problem.to_dict()
    for part in ("camera", "reference_max_radius"):
        if here[part] != card["problem"][part]:
            raise InputError(f"the model needs {part} {card['problem'][part]}, the set was made with {here[part]}")
    return np.array([known.index(name) for name in names])
