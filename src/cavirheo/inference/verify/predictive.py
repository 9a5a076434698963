"""Could the law have left these residuals? A posterior-predictive check against white noise.

Replicates are independent noise z that is refitted, as the measurement was: (1 - J (J'J + ridge)^-1 J') z is left, J
the frames' derivatives, so none costs a simulation. Statistics, none of which depends on the size of the noise: level
(standard deviation over the frame-to-frame noise of third differences, which cancel a smooth misfit), correlation (of
neighbours) and run (longest, of one sign). p is the share of replicates that are as extreme. Gelman, Meng and Stern
1996, Statistica Sinica 6, 733; with refitting the check is not too timid (Robins, van der Vaart and Ventura 2000,
doi:10.1080/01621459.2000.10474310).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.verify.tuning import TUNING


def statistics(residuals: Floats) -> dict[str, Floats]:
    """(k,) level, correlation and run of residuals (k, n), n >= 9, each over its assumed deviation."""
    k, n = residuals.shape
    rough = 1.4826 * np.median(np.abs(np.diff(residuals, 3, axis=1)), axis=1) / np.sqrt(20.0)
    r = residuals - np.mean(residuals, axis=1, keepdims=True)
    power = np.sum(r**2, axis=1)
    longest, run = np.ones(k), np.ones(k)
    for i in range(1, n):
        run = np.where((residuals[:, i] > 0) == (residuals[:, i - 1] > 0), run + 1.0, 1.0)
        longest = np.maximum(longest, run)
    return {
        "level": np.sqrt(np.mean(residuals**2, axis=1)) / rough,
        "correlation": np.sum(r[:, 1:] * r[:, :-1], axis=1) / power,
        "run": longest,
    }


def predictive_check(residual: Floats, jacobian: Floats, deviation: Floats, seed: int) -> dict[str, Any] | None:
    """The check of residuals (n,) at a maximum of the posterior with the frames' derivatives (n, d) there and the
    frames' assumed deviations (n,). None below 9 frames."""
    n, d = jacobian.shape
    if n < max(9, d + 3):
        return None
    scaled, J = residual / deviation, jacobian / deviation[:, None]
    variance = float(scaled @ scaled) / max(n - d, 1)
    fitted = np.linalg.solve(J.T @ J + variance * np.eye(d), J.T)
    noise = np.random.Generator(np.random.Philox(seed)).standard_normal((TUNING.replicates, n))
    replicated = statistics(noise - (noise @ fitted.T) @ J.T)
    observed = {name: float(value[0]) for name, value in statistics(scaled[None]).items()}
    extreme = {name: np.count_nonzero(values >= observed[name]) for name, values in replicated.items()}
    p = {name: float((1 + count) / (1 + TUNING.replicates)) for name, count in extreme.items()}
    worst = min(1.0, len(p) * min(p.values()))  # the most extreme of three has been looked at (Bonferroni)
    return {"p": p, "observed": observed, "p_value": worst, "least": len(p) / (1 + TUNING.replicates)}
