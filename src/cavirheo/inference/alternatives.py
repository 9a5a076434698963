"""What other models, and other modes of the same model, mean for an answer: a message each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.messages import Message
from cavirheo.parameters import of_the_law
from cavirheo.posterior import Checks, Evidence, OtherAnswer, Posterior, Verdict, intervals

LAPLACE = 5.0  # standard error of the log of Laplace's integral against that of draws (docs/validation.md)
LIMIT = 0.2  # prior probability that nothing resists in a real bubble: then it is the field's
SEEN = 1e-3  # probability of that, from which it counts
_Interval = tuple[float, float, float]  # 5 %, 50 %, 95 %
_FOLLOWED = ("ok", "undetermined")  # verdicts of answers that their simulation follows
DECISIVE = 3.0  # of log evidence (a factor of 20): a model so far above another is preferred, a nearer one possible


def contenders(evidence: Sequence[Evidence | None], sizes: Sequence[int]) -> list[int]:
    """Indices of the models that the evidence cannot tell from the best, the one with the fewest parameters first: the
    only rule by which models are chosen.

    A model is within reach if its log evidence lies below the largest by no more than DECISIVE and the standard error
    of the difference; of Laplace's integrals that is LAPLACE each.
    """
    known = {i: one for i, one in enumerate(evidence) if one is not None and np.isfinite(one.log)}
    if not known:
        return []
    top = max(known.values(), key=lambda one: one.log)
    near = [i for i, one in known.items() if one is top or not rejects(top.log - one.log, (one.error, top.error))]
    return sorted(near, key=lambda i: (sizes[i], -known[i].log))


def rejects(gain: float, errors: Iterable[float | None]) -> bool:
    """Whether a log evidence, of one shot or summed over shots, that is larger by `gain` rejects the smaller one.
    errors: the standard error of each term of the difference, None for a Laplace integral."""
    return gain > DECISIVE + float(np.linalg.norm([LAPLACE if error is None else error for error in errors]))


class Averaged(NamedTuple):
    """log_weight: (k + m,) of both models' draws, whose sum is the evidence. probability: of the limit."""

    log_weight: Floats
    evidence: Evidence
    probability: float


def averaged(log_weight: Floats, evidence: Evidence, limit_weight: Floats, limit: Evidence) -> Averaged:
    """The weighted draws (k,) of a model beside those (m,) of its limit, which has the prior probability LIMIT: each
    by the probability of its model (Hoeting et al. 1999, doi:10.1214/ss/1009212519)."""
    whole, part = np.log(1.0 - LIMIT) + evidence.log, np.log(LIMIT) + limit.log
    log = float(np.logaddexp(whole, part))
    probability = float(np.exp(part - log))
    both = [log_weight - log_sum(log_weight) + whole, limit_weight - log_sum(limit_weight) + part]
    errors = evidence.error, limit.error
    error = None if None in errors else float(np.hypot(*np.array(errors) * (1.0 - probability, probability)))
    return Averaged(np.concatenate(both), Evidence(log, error), probability)


def judged(answer: Posterior, said: Iterable[Message] = ()) -> Checks:
    """Its checks with these messages and those of `compared`, each once. The verdict of an answer that its simulation
    follows is "other_model_preferred" where the evidence rejects its model."""
    checks, here = answer.checks, itself(answer)
    rejected = any(_surely_above(one, here) for one in _others(answer))
    verdict: Verdict = "other_model_preferred" if rejected and checks.verdict in _FOLLOWED else checks.verdict
    new = [message for message in (*said, *compared(answer)) if message not in checks.messages]
    told = [*new, *checks.messages] if verdict == "other_model_preferred" else [*checks.messages, *new]
    return replace(checks, verdict=verdict, messages=tuple(told))


def compared(answer: Posterior) -> list[Message]:
    """A message on another model if the evidence prefers it, whatever the errors, or if another bubble that the
    evidence does not reject gives a G or a viscosity whose 90 % interval does not meet the answer's; and one on each
    other mode of the same model whose evidence is not smaller by more than DECISIVE and whose interval of a parameter
    of the law does not meet the answer's.

    Of several such models the one with the largest evidence is named, by its best mode.
    """
    here = itself(answer)
    modes = [one for one in answer.others if model_of(one) == model_of(here)]
    rivals = [one for one in _others(answer) if _surely_above(one, here) or _other_bubble_disagrees(one, here)]
    said = [_sides(here, max(rivals, key=_log))] if rivals else []
    return said + [
        Message("mode.other", _beside(one, here, stretch=True))
        for one in modes
        if _above(one, here) >= -DECISIVE and _apart(_ends(one), _ends(here))
    ]


def _others(answer: Posterior) -> list[OtherAnswer]:
    """Of each other model the mode with the largest evidence."""
    best = {model_of(one): one for one in sorted(answer.others, key=_log)}
    best.pop(model_of(answer), None)
    return list(best.values())


def chosen_among(answer: Posterior, candidates: Iterable[Posterior]) -> list[Message]:
    """A message on what the evidence says of the models that the answer was chosen from, if there are others."""
    here = itself(answer)
    rivals = [one for one in map(itself, candidates) if model_of(one) != model_of(here) and one.evidence]
    if not (rivals and here.evidence):
        return []
    rivals.sort(key=_log, reverse=True)
    found = []
    for one in rivals:
        gain = _above(one, here)
        found.append({**_described(one), "gain": gain, "equal": equal(gain), "rejected": gain < -DECISIVE})
    return [Message("model.chosen", {"here": _described(here), "rivals": found})]


def itself(answer: Posterior) -> OtherAnswer:
    """An answer as one beside that of another model."""
    told = intervals(answer.names, answer.theta, answer.log_weight)
    rmse = answer.checks.rmse_over_rmax
    return OtherAnswer(answer.material, answer.bubble, answer.best, told, answer.evidence, rmse)


def model_of(one: OtherAnswer | Posterior) -> tuple[str, str]:
    """Law and model of the bubble, by which answers are of one model."""
    return one.material, one.bubble.name


def _log(one: OtherAnswer) -> float:
    return one.evidence.log if one.evidence else -float("inf")


def equal(gain: float) -> bool:
    """Whether two models that differ by so much of log evidence are equally likely, as far as a reader is concerned."""
    return abs(gain) < 1.0


def _above(one: OtherAnswer, other: OtherAnswer) -> float:
    """How far its log evidence lies above that of the other; NaN where one has none."""
    return one.evidence.log - other.evidence.log if one.evidence and other.evidence else float("nan")


def _surely_above(one: OtherAnswer, other: OtherAnswer) -> bool:
    """Whether the evidence rejects the other beside this one, by the rule of `contenders`."""
    if not (one.evidence and other.evidence):
        return False
    return rejects(_above(one, other), (one.evidence.error, other.evidence.error))


def _other_bubble_disagrees(one: OtherAnswer, here: OtherAnswer) -> bool:
    """Whether only the bubble differs, is not rejected, and a parameter of the law lies beyond both intervals."""
    if one.material != here.material or one.bubble == here.bubble or _above(one, here) < -DECISIVE:
        return False
    return _apart(one.intervals, here.intervals)


def _apart(one: Mapping[str, _Interval], other: Mapping[str, _Interval]) -> bool:
    """Whether two intervals of a parameter of the law do not meet."""
    pairs = [(one[name], other[name]) for name in one if name in other and of_the_law(name)]
    return any(a[2] < b[0] or b[2] < a[0] for a, b in pairs)


def _sides(here: OtherAnswer, there: OtherAnswer) -> Message:
    """Both with their values; which is preferred, and by how much."""
    code = "model.rejected" if _surely_above(there, here) else "model.possible"
    return Message(code, _beside(there, here))


def _described(one: OtherAnswer, *, stretch: bool = False) -> dict[str, Any]:
    """A model in a message: its law, its bubble in words, and the values of the law's parameters."""
    ends = {name: value for name, value in _ends(one).items() if of_the_law(name) or (stretch and name == "stretch")}
    return {"material": one.material, "bubble": one.bubble.title, "values": ends, "interval": bool(one.intervals)}


def _beside(there: OtherAnswer, here: OtherAnswer, *, stretch: bool = False) -> dict[str, Any]:
    """Both in a message, and how far the log evidence of the first lies above the other's (`rough`: roughly known)."""
    gain = _above(there, here)
    return {
        "there": _described(there, stretch=stretch),
        "here": _described(here, stretch=stretch),
        "gain": gain if gain == gain else None,
        "equal": equal(gain),
        "rough": bool(there.evidence and (there.evidence.error or 0.0) >= DECISIVE),
    }


def _ends(one: OtherAnswer) -> Mapping[str, _Interval]:
    """Its intervals; without any, each best value as both ends of one."""
    return one.intervals or {name: (value, value, value) for name, value in one.best.items()}
