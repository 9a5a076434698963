"""Messages on what other models, and other modes of the same model, mean for an answer; and the average of the answers
of several laws for one curve, weighted by their evidence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.messages import Message, message_of_bound
from cavirheo.parameters import LOG10, is_law_parameter, natural_name, parameter_of, units
from cavirheo.posterior import Checks, Evidence, OtherAnswer, Posterior, Verdict, intervals

LAPLACE_ERROR = 5.0  # standard error of the log of Laplace's integral, compared with that of draws (docs/validation.md)
LIMIT_PRIOR = 0.2  # prior probability that a real bubble has no damping and condenses instantly: it is then the field's
LEAST_PROBABILITY = 1e-3  # probability of a model below which it does not count
_Interval = tuple[float, float, float]  # 5 %, 50 %, 95 %
_FITTING = ("ok", "undetermined")  # verdicts of answers whose simulation follows the measurement
MIN_ELASTIC = 0.05  # probability of the laws with a shear modulus above which the average has one
_MODULUS = LOG10 + "shear_modulus"
# the viscosity of a law with an exponent is its viscosity at 1e5 1/s
_EQUIVALENT = {"viscosity": "reference_viscosity", "reference_viscosity": "viscosity"}
_NEWTONIAN = {"exponent": 0.0}  # log10 of its value in a law without it; other parameters: the low end of their range
DECISIVE = 3.0  # log evidence (a factor of 20) by which a model must be larger to be preferred; below, it is possible


def contenders(evidences: Sequence[Evidence | None], sizes: Sequence[int]) -> list[int]:
    """Indices of the models that the evidence cannot distinguish from the best one, those with the fewest parameters
    first. All choices of models use this rule. The log evidence of these models is below the largest one by no more
    than DECISIVE plus the standard error of the difference; a Laplace integral has the error LAPLACE_ERROR."""
    valid = {i: evidence for i, evidence in enumerate(evidences) if evidence is not None and np.isfinite(evidence.log)}
    if not valid:
        return []
    top = max(valid.values(), key=lambda evidence: evidence.log)
    close = [i for i in valid if valid[i] is top or not rejects(top.log - valid[i].log, (valid[i].error, top.error))]
    return sorted(close, key=lambda i: (sizes[i], -valid[i].log))


def rejects(gain: float, errors: Iterable[float | None]) -> bool:
    """Whether a model whose log evidence, of one shot or summed over shots, is larger by `gain` rejects the other
    model. errors: the standard error of each term of the difference, None for a Laplace integral."""
    return gain > DECISIVE + float(np.linalg.norm([LAPLACE_ERROR if error is None else error for error in errors]))


class Averaged(NamedTuple):
    """The average of a model and its limit. log_weight: (k + m,) of the draws of both; the weights sum to the evidence.
    probability: that of the limit."""

    log_weight: Floats
    evidence: Evidence
    probability: float


def averaged(log_weight: Floats, evidence: Evidence, limit_weight: Floats, limit: Evidence) -> Averaged:
    """Combine the weighted draws (k,) of a model with those (m,) of its limit, whose prior probability is LIMIT_PRIOR:
    each model by its posterior probability (Hoeting et al. 1999, doi:10.1214/ss/1009212519)."""
    whole, part = np.log(1.0 - LIMIT_PRIOR) + evidence.log, np.log(LIMIT_PRIOR) + limit.log
    log = float(np.logaddexp(whole, part))
    probability = float(np.exp(part - log))
    both = [log_weight - log_sum(log_weight) + whole, limit_weight - log_sum(limit_weight) + part]
    errors = evidence.error, limit.error
    error = None if None in errors else float(np.hypot(*np.array(errors) * (1.0 - probability, probability)))
    return Averaged(np.concatenate(both), Evidence(log, error), probability)


def judged(answer: Posterior, messages: Iterable[Message] = ()) -> Checks:
    """The checks of an answer with these messages and those of `rival_messages`, each once. The verdict is
    "other_model_preferred" if the evidence rejects the model of an answer whose simulation follows the measurement."""
    checks, this = answer.checks, as_alternative(answer)
    rejected = any(_rejects(rival, this) for rival in _rivals(answer))
    verdict: Verdict = "other_model_preferred" if rejected and checks.verdict in _FITTING else checks.verdict
    new = [message for message in (*messages, *rival_messages(answer)) if message not in checks.messages]
    ordered = [*new, *checks.messages] if verdict == "other_model_preferred" else [*checks.messages, *new]
    return replace(checks, verdict=verdict, messages=tuple(ordered))


def rival_messages(answer: Posterior) -> list[Message]:
    """Messages on other models and modes. One is on the model with the largest evidence of those that reject the
    answer's, and of those with the same law and another bubble whose log evidence is not smaller by more than DECISIVE
    and whose 90 % interval of a parameter of the law does not overlap the answer's. Other modes of the answer's model
    have a message under the last two conditions."""
    this, messages = as_alternative(answer), list[Message]()

    def other_bubble_disagrees(rival: OtherAnswer) -> bool:
        possible = rival.material == this.material and rival.bubble != this.bubble
        return possible and not _gain(rival, this) < -DECISIVE and _disjoint(rival.intervals, this.intervals)

    rivals = [rival for rival in _rivals(answer) if _rejects(rival, this) or other_bubble_disagrees(rival)]
    if rivals:
        best = max(rivals, key=_log)
        code = "model.rejected" if _rejects(best, this) else "model.possible"
        messages.append(Message(code, _describe_pair(best, this)))
    return messages + [
        Message("mode.other", _describe_pair(mode, this, stretch=True))
        for mode in answer.others
        if model_of(mode) == model_of(this) and _gain(mode, this) >= -DECISIVE and _disjoint(_ends(mode), _ends(this))
    ]


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


def _described(model: OtherAnswer, *, stretch: bool = False) -> dict[str, Any]:
    """The description of a model in a message: its law, its bubble in words, and the values of the law's parameters."""
    ends = {
        name: value for name, value in _ends(model).items() if is_law_parameter(name) or (stretch and name == "stretch")
    }
    return {"material": model.material, "bubble": model.bubble.title, "values": ends, "interval": bool(model.intervals)}


def _describe_pair(rival: OtherAnswer, this: OtherAnswer, *, stretch: bool = False) -> dict[str, Any]:
    """Two models in a message, and the log evidence of the first minus the second's (`rough`: known only roughly)."""
    gain = _gain(rival, this)
    return {
        "rival": _described(rival, stretch=stretch),
        "this": _described(this, stretch=stretch),
        "gain": gain if gain == gain else None,
        "equal": equal_odds(gain),
        "rough": bool(rival.evidence and (rival.evidence.error or 0.0) >= DECISIVE),
    }


def _ends(model: OtherAnswer) -> Mapping[str, _Interval]:
    """The intervals of a model; if it has none, each best value as both ends of an interval."""
    return model.intervals or {name: (value, value, value) for name, value in model.best.items()}


def comparable(answers: Sequence[Posterior]) -> bool:
    """Whether answers are of different laws with one bubble, with draws and with evidences whose errors are known."""
    laws = {answer.material for answer in answers}
    usable = all(answer.evidence and answer.evidence.error is not None and len(answer.theta) > 1 for answer in answers)
    return len(laws) == len(answers) > 1 and len({answer.bubble for answer in answers}) == 1 and usable


def averaged_over_laws(answers: Sequence[Posterior]) -> Posterior:
    """The average over laws: the answer of the likeliest law with the draws of all laws, each weighted by its posterior
    probability. All laws have the same prior probability (Hoeting et al. 1999, doi:10.1214/ss/1009212519). A parameter
    that a law lacks has the value at which the likeliest law becomes that law: no modulus, an exponent of 1. The
    average has a modulus if the laws with one have a probability above MIN_ELASTIC. answers: must be `comparable`;
    `laws` has each of them."""
    logs = np.array([answer.evidence.log for answer in answers if answer.evidence])
    share = dict(zip((answer.material for answer in answers), np.exp(logs - log_sum(logs)).tolist(), strict=True))
    top = max(answers, key=lambda answer: share[answer.material])
    counted = [answer for answer in answers if share[answer.material] > LEAST_PROBABILITY]
    elastic = sum(share[answer.material] for answer in counted if _MODULUS in answer.names)
    names, prior = top.names, dict(top.prior)
    if _MODULUS not in names and elastic > MIN_ELASTIC:
        names = (_MODULUS, *names)
        prior[_MODULUS] = next(answer.prior[_MODULUS] for answer in counted if _MODULUS in answer.prior)
    theta = np.concatenate([_convert_draws(answer, names, prior) for answer in counted])
    weight = np.concatenate([np.log(answer.weights + 1e-300) + np.log(share[answer.material]) for answer in counted])
    rivals = [replace(as_alternative(answer), weight=share[answer.material]) for answer in answers if answer is not top]
    laws = {answer.material: answer for answer in counted}
    models = {model_of(rival) for rival in rivals}
    of_top = (replace(mode, weight=share[top.material] * mode.weight) for mode in top.others)
    alternatives = (*(mode for mode in of_top if model_of(mode) not in models), *rivals)
    average = replace(
        top, names=names, units=units(names), theta=theta, log_weight=weight, log_q=None, others=alternatives,
        prior=prior, laws=laws,
    )  # fmt: skip
    return replace(average, checks=_checks(average, share))


def _checks(answer: Posterior, share: dict[str, float]) -> Checks:
    """The checks of the likeliest law, but with the bounds of the average, and with the probabilities of all laws."""
    checks, ends = answer.checks, intervals(answer.names, answer.theta, answer.log_weight)
    inferred = {name: answer.bound(name) for name in ends if is_law_parameter(name) or name == "stretch"}
    bounds = [message_of_bound(name, bound, ends[name]) for name, bound in inferred.items() if bound]
    verdict: Verdict = "undetermined" if bounds else "ok"
    without_bounds = [message for message in checks.messages if not message.code.startswith("bound.")]
    return replace(
        checks,
        verdict=verdict if checks.verdict in _FITTING else checks.verdict,
        messages=(*bounds, *without_bounds, Message("model.averaged", {"laws": share})),
    )


def keep_one_law(answers: Sequence[Posterior]) -> list[Posterior]:
    """The answers of shots of one material, with each average over laws replaced by its answer for one law: that with
    the largest evidence of all these shots together. A shot without draws of this law keeps its answer."""
    several, evidences = [answer for answer in answers if answer.laws], list[dict[str, float]]()
    for answer in several:
        of_modes = {m.material: m.evidence.log for m in answer.others if m.evidence and m.bubble == answer.bubble}
        evidences.append(of_modes | {law: part.evidence.log for law, part in answer.laws.items() if part.evidence})
    laws = {law for answer in several for law in answer.laws}
    total = {law: sum(logs.get(law, min(logs.values())) for logs in evidences) for law in sorted(laws)}
    best = max(total, key=lambda law: total[law], default="")
    return [answer.laws.get(best, answer) for answer in answers]


def _convert_draws(answer: Posterior, names: Sequence[str], prior: dict[str, tuple[float, ...]]) -> Floats:
    """Draws (draws, names) of an answer, in the parameters of another law."""
    columns = []
    for name in names:
        natural = natural_name(name)
        column = name if name in answer.names else LOG10 + _EQUIVALENT.get(natural, natural)
        if column in answer.names:
            columns.append(answer.theta[:, answer.names.index(column)])
        else:
            assert is_law_parameter(name)
            low, *_ = prior.get(name) or parameter_of(name).search_range or (0.0,)
            columns.append(np.full(len(answer.theta), _NEWTONIAN.get(natural, low)))
    return np.column_stack(columns)
