"""Which models the evidence rejects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cavirheo.posterior import Evidence, Posterior

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


def model_of(answer: Posterior) -> tuple[str, str]:
    """Law and name of the bubble; answers for which both are the same are answers of one model."""
    return answer.material, answer.bubble.name
