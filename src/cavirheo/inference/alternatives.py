"""Which models the evidence rejects, and messages on what other models mean for an answer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cavirheo.messages import Message
from cavirheo.parameters import is_law_parameter
from cavirheo.posterior import Evidence, OtherAnswer, Posterior, intervals

DECISIVE = 3.0  # log evidence (a factor of 20) by which a model must be larger to be preferred; below, it is possible


def contenders(evidences: Sequence[Evidence | None], sizes: Sequence[int]) -> list[int]:
    """Indices of the models that the evidence cannot distinguish from the best one, those with the fewest parameters
    first. All choices of models use this rule. The log evidence of these models is below the largest one by no more
    than DECISIVE plus the standard error of the difference."""
    valid = {i: evidence for i, evidence in enumerate(evidences) if evidence is not None and np.isfinite(evidence.log)}
    if not valid:
        return []
    top = max(valid.values(), key=lambda evidence: evidence.log)
    close = [i for i in valid if valid[i] is top or not rejects(top.log - valid[i].log, (valid[i].error, top.error))]
    return sorted(close, key=lambda i: (sizes[i], -valid[i].log))


def rejects(gain: float, errors: Iterable[float | None]) -> bool:
    """Whether a model whose log evidence, of one shot or summed over shots, is larger by `gain` rejects the other
    model. errors: the standard error of each term of the difference."""
    return gain > DECISIVE + float(np.linalg.norm([error or 0.0 for error in errors]))


def rejection_messages(answer: Posterior) -> list[Message]:
    """A message on the other model with the largest evidence, if its evidence rejects that of the answer."""
    this = as_alternative(answer)
    rivals = [rival for rival in answer.others if model_of(rival) != model_of(this) and rival.evidence]
    best = max(rivals, key=_log, default=None)
    if best is None or not (best.evidence and this.evidence):
        return []
    gain, errors = _log(best) - _log(this), (best.evidence.error, this.evidence.error)
    if not rejects(gain, errors):
        return []
    values = {"rival": _described(best), "this": _described(this), "gain": gain}
    return [Message("model.rejected", {**values, "rough": (best.evidence.error or 0.0) >= DECISIVE})]


def choice_messages(answer: Posterior, candidates: Iterable[Posterior]) -> list[Message]:
    """A message that compares the evidence of the models among which the answer was chosen, if there are others."""
    this = as_alternative(answer)
    rivals = [mode for mode in map(as_alternative, candidates) if model_of(mode) != model_of(this) and mode.evidence]
    if not (rivals and this.evidence):
        return []
    described = []
    for rival in sorted(rivals, key=_log, reverse=True):
        gain = _log(rival) - _log(this)
        described.append({**_described(rival), "gain": gain, "equal": abs(gain) < 1.0, "rejected": gain < -DECISIVE})
    return [Message("model.chosen", {"this": _described(this), "rivals": described})]


def as_alternative(answer: Posterior) -> OtherAnswer:
    """An answer in the form of the alternatives to another answer."""
    ends = intervals(answer.names, answer.theta, answer.log_weight)
    rmse = answer.checks.rmse_over_rmax
    return OtherAnswer(answer.material, answer.bubble, answer.best, ends, answer.evidence, rmse)


def model_of(answer: OtherAnswer | Posterior) -> tuple[str, str]:
    """Law and name of the bubble; answers for which both are the same are answers of one model."""
    return answer.material, answer.bubble.name


def _log(model: OtherAnswer) -> float:
    return model.evidence.log if model.evidence else -float("inf")


def _described(model: OtherAnswer) -> dict[str, Any]:
    """The description of a model in a message: its law, its bubble in words, and the values of the law's parameters."""
    ends = model.intervals or {name: (value, value, value) for name, value in model.best.items()}
    values = {name: value for name, value in ends.items() if is_law_parameter(name)}
    title = {"material": model.material, "bubble": model.bubble.title}
    return {**title, "values": values, "interval": bool(model.intervals)}
