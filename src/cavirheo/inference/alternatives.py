"""Which models the evidence rejects, and messages on what other models mean for an answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cavirheo.messages import Message
from cavirheo.parameters import is_law_parameter
from cavirheo.posterior import Checks, Evidence, OtherAnswer, Posterior, intervals

_Interval = tuple[float, float, float]  # 5 %, 50 %, 95 %
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


def with_rivals(answer: Posterior, messages: Iterable[Message] = ()) -> Checks:
    """The checks of an answer with these messages and those of `rival_messages`, each once. The verdict stays."""
    checks = answer.checks
    new = [message for message in (*messages, *rival_messages(answer)) if message not in checks.messages]
    return replace(checks, messages=(*checks.messages, *new))


def rival_messages(answer: Posterior) -> list[Message]:
    """A message on another model: the model with the largest evidence of those that reject the
    answer's, and of those with the same law and another bubble whose log evidence is not smaller by more than DECISIVE
    and whose 90 % interval of a parameter of the law does not overlap the answer's."""
    this, messages = as_alternative(answer), list[Message]()

    def other_bubble_disagrees(rival: OtherAnswer) -> bool:
        possible = rival.material == this.material and rival.bubble != this.bubble
        return possible and not _gain(rival, this) < -DECISIVE and _disjoint(rival.intervals, this.intervals)

    rivals = [rival for rival in _rivals(answer) if _rejects(rival, this) or other_bubble_disagrees(rival)]
    if rivals:
        best = max(rivals, key=_log)
        code = "model.rejected" if _rejects(best, this) else "model.possible"
        messages.append(Message(code, _describe_pair(best, this)))
    return messages


def _rivals(answer: Posterior) -> list[OtherAnswer]:
    """The mode with the largest evidence of each other model."""
    best = {model_of(mode): mode for mode in sorted(answer.others, key=_log)}
    best.pop(model_of(answer), None)
    return list(best.values())


def choice_messages(answer: Posterior, candidates: Iterable[Posterior]) -> list[Message]:
    """A message that compares the evidence of the models among which the answer was chosen, if there are others."""
    this = as_alternative(answer)
    rivals = [mode for mode in map(as_alternative, candidates) if model_of(mode) != model_of(this) and mode.evidence]
    if not (rivals and this.evidence):
        return []
    described = []
    for rival in sorted(rivals, key=_log, reverse=True):
        gain = _gain(rival, this)
        described.append({**_described(rival), "gain": gain, "equal": equal_odds(gain), "rejected": gain < -DECISIVE})
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


def equal_odds(gain: float) -> bool:
    """Whether two models whose log evidences differ by `gain` are called equally likely."""
    return abs(gain) < 1.0


def _gain(first: OtherAnswer, second: OtherAnswer) -> float:
    """The log evidence of the first model minus that of the second; NaN if one of them has none."""
    return first.evidence.log - second.evidence.log if first.evidence and second.evidence else float("nan")


def _rejects(first: OtherAnswer, second: OtherAnswer) -> bool:
    """Whether the evidence of the first model rejects the second, by the rule of `contenders`."""
    return rejects(_gain(first, second), [model.evidence.error for model in (first, second) if model.evidence])


def _disjoint(first: Mapping[str, _Interval], second: Mapping[str, _Interval]) -> bool:
    """Whether the two intervals of any parameter of the law do not overlap."""
    pairs = [(first[name], second[name]) for name in first if name in second and is_law_parameter(name)]
    return any(a[2] < b[0] or b[2] < a[0] for a, b in pairs)


def _described(model: OtherAnswer) -> dict[str, Any]:
    """The description of a model in a message: its law, its bubble in words, and the values of the law's parameters."""
    ends = {name: value for name, value in _ends(model).items() if is_law_parameter(name)}
    return {"material": model.material, "bubble": model.bubble.title, "values": ends, "interval": bool(model.intervals)}


def _describe_pair(rival: OtherAnswer, this: OtherAnswer) -> dict[str, Any]:
    """Two models in a message, and the log evidence of the first minus the second's (`rough`: known only roughly)."""
    gain = _gain(rival, this)
    return {
        "rival": _described(rival),
        "this": _described(this),
        "gain": gain if gain == gain else None,
        "equal": equal_odds(gain),
        "rough": bool(rival.evidence and (rival.evidence.error or 0.0) >= DECISIVE),
    }


def _ends(model: OtherAnswer) -> Mapping[str, _Interval]:
    """The intervals of a model; if it has none, each best value as both ends of an interval."""
    return model.intervals or {name: (value, value, value) for name, value in model.best.items()}
