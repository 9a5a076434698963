"""What other models, and other valleys of the same model, mean for an answer: a sentence each, for its message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cavirheo.parameters import of_the_law
from cavirheo.posterior import Evidence, OtherAnswer, Posterior, in_words, intervals

LAPLACE = 5.0  # standard error of the log of Laplace's integral against that of draws (benchmarks/evidence.md)
_Interval = tuple[float, float, float]  # 5 %, 50 %, 95 %
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

    def reach(one: Evidence) -> float:
        first, second = (LAPLACE if error is None else error for error in (one.error, top.error))
        return DECISIVE + (0.0 if one is top else float(np.hypot(first, second)))

    near = [i for i, one in known.items() if top.log - one.log <= reach(one)]
    return sorted(near, key=lambda i: (sizes[i], -known[i].log))


def compared(answer: Posterior) -> list[str]:
    """A sentence on another model if its evidence is larger by more than DECISIVE, or if another bubble that the
    evidence does not reject gives a G or a viscosity whose 90 % interval does not meet the answer's; and one on each
    other valley of the same model whose evidence is not smaller by more than DECISIVE.

    Of several such models the one with the largest evidence is named, by its best valley.
    """
    here = itself(answer)
    valleys = [one for one in answer.others if model_of(one) == model_of(here)]
    best: dict[tuple[str, str], OtherAnswer] = {}
    for one in sorted(answer.others, key=_log):
        best[model_of(one)] = one
    best.pop(model_of(here), None)
    rivals = [one for one in best.values() if _surely_above(one, here) or _other_bubble_disagrees(one, here)]
    said = [_sides(here, max(rivals, key=_log))] if rivals else []
    return said + [
        f"two solutions of the same model: {_values(here, stretch=True)}, or {_values(one, stretch=True)}"
        + _verdict(one, here)
        for one in valleys
        if _above(one, here) >= -DECISIVE and _elsewhere(one, here)
    ]


def chosen_among(answer: Posterior, candidates: Iterable[Posterior]) -> list[str]:
    """A sentence on what the evidence says of the models that the answer was chosen from, if there are others."""
    here = itself(answer)
    rivals = [one for one in map(itself, candidates) if model_of(one) != model_of(here) and one.evidence]
    if not (rivals and here.evidence):
        return []
    rivals.sort(key=_log, reverse=True)
    tells = {
        "law": any(one.material != here.material for one in rivals),
        "bubble": any(one.bubble.name != here.bubble.name for one in rivals),
    }
    parts: dict[str, list[str]] = {"possible, too": [], "rejected": []}
    for one in rivals:
        gain = _above(one, here)
        parts["rejected" if gain < -DECISIVE else "possible, too"].append(f"{_named(one, **tells)} (e^{gain:.0f})")
    said = [f"{words}: {'; '.join(some)}" for words, some in parts.items() if some]
    return [f"chosen by evidence: {_named(here, **tells)}; {'; '.join(said)}"]


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


def _above(one: OtherAnswer, other: OtherAnswer) -> float:
    """How far its log evidence lies above that of the other; NaN where one has none."""
    return one.evidence.log - other.evidence.log if one.evidence and other.evidence else float("nan")


def _surely_above(one: OtherAnswer, other: OtherAnswer) -> bool:
    """By more than DECISIVE, whatever the error of its evidence."""
    return _above(one, other) > DECISIVE + ((one.evidence and one.evidence.error) or 0.0)


def _other_bubble_disagrees(one: OtherAnswer, here: OtherAnswer) -> bool:
    """Whether only the bubble differs, is not rejected, and a parameter of the law lies beyond both intervals."""
    if one.material != here.material or one.bubble == here.bubble or _above(one, here) < -DECISIVE:
        return False
    shared = [name for name in one.intervals if name in here.intervals and of_the_law(name)]
    pairs = [(one.intervals[name], here.intervals[name]) for name in shared]
    return _apart(pairs)


def _apart(pairs: Iterable[tuple[_Interval, _Interval]]) -> bool:
    """Whether two intervals of a pair do not meet."""
    return any(a[2] < b[0] or b[2] < a[0] for a, b in pairs)


def _elsewhere(one: OtherAnswer, here: OtherAnswer) -> bool:
    """Whether a valley is another solution for its reader: an interval beyond the answer's, or none to compare."""
    shared = [(one.intervals[name], here.intervals[name]) for name in one.intervals if name in here.intervals]
    return not shared or _apart(shared)


def _sides(here: OtherAnswer, there: OtherAnswer) -> str:
    """Each by what tells them apart, law or bubble, and its values."""
    tells: dict[str, bool] = {"law": here.material != there.material, "bubble": here.bubble.name != there.bubble.name}
    return ", but ".join(f"{_named(one, **tells)}: {_values(one)}" for one in (here, there)) + _verdict(there, here)


def _named(one: OtherAnswer, *, law: bool, bubble: bool) -> str:
    """By its law, by the words for its bubble, or both."""
    return ", ".join([one.material] * law + [one.bubble.title] * bubble)


def _values(one: OtherAnswer, *, stretch: bool = False) -> str:
    told = one.intervals or {name: (value, value, value) for name, value in one.best.items()}
    shown = {name: ends for name, ends in told.items() if of_the_law(name) or (stretch and name == "stretch")}
    words = ", ".join(in_words(name, ends) for name, ends in shown.items())
    return words if one.intervals else f"{words} (no interval)"


def _verdict(there: OtherAnswer, here: OtherAnswer) -> str:
    """'; evidence e^12 for the second'; nothing where one has no evidence."""
    gain = _above(there, here)
    rough = "about " * bool(there.evidence and (there.evidence.error or 0.0) >= DECISIVE)
    if abs(gain) < 0.5:
        return f"; evidence {rough}equal"
    return f"; evidence {rough}e^{abs(gain):.0f} for the {'second' if gain > 0 else 'first'}" if gain == gain else ""
