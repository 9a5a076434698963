"""Conventional least squares in a page of scipy: neo-Hookean Kelvin-Voigt, field's bubble, R_max and its time known.

    python -m validation.challenge.run_scipy RECORDINGS ANSWERS.csv

It is what a laboratory writes in an afternoon, and the control of `cavirheo fit` (tests/inference/test_fit.py), of
which it uses the simulation alone. It takes all frames, and trusts the textbook's covariance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from cavirheo import Medium, NeoHookeanKelvinVoigt, simulate
from validation.challenge.answers import Answer, Recording, run
from validation.challenge.camera import read_maximum

STARTS = [(G, mu, 6.5) for G in (3e3, 2e4) for mu in (0.02, 0.1)]  # Pa, Pa s, stretch
BOUNDS = ([2.0, -3.0, 0.3], [5.0, 0.5, 1.2])  # log10 of these
NORMAL_90 = 1.645  # standard deviations from the middle to an end of a 90 % interval


def ratio(x: np.ndarray, time: np.ndarray, max_radius: float, medium: Medium) -> np.ndarray:
    """R/R_max at times since R_max, of log10 of G, mu and stretch; nothing where the simulation fails."""
    G, mu, stretch = 10.0**x
    law = NeoHookeanKelvinVoigt(G, mu)
    done = simulate(law, max_radius=max_radius, stretch=stretch, time=time, medium=medium, throw=False)
    return done.radius / max_radius if done.ok else np.zeros(len(time))


def fit(model: Callable[..., np.ndarray], measured: np.ndarray, starts: list = STARTS) -> tuple[np.ndarray, np.ndarray]:
    """log10 of G, mu and stretch at the lowest minimum, and their standard deviations: the variance of the residuals
    times (J'J)^-1."""
    ends = [
        least_squares(lambda x: measured - model(x), np.log10(start), bounds=BOUNDS, diff_step=1e-3) for start in starts
    ]
    best = min(ends, key=lambda end: end.cost)
    variance = 2.0 * best.cost / (len(measured) - len(best.x))
    return best.x, np.sqrt(variance * np.diag(np.linalg.pinv(best.jac.T @ best.jac)))


def bounded(best: np.ndarray, sigma: np.ndarray) -> Answer:
    """G and mu with their 90 % intervals, of log10 values."""
    row: Answer = {}
    for name, middle, width in zip(("G", "mu"), best, NORMAL_90 * sigma, strict=False):
        ends = {name: middle, f"{name}_low": middle - width, f"{name}_high": middle + width}
        row |= {key: f"{10 ** np.clip(value, -9, 9):.6g}" for key, value in ends.items()}
    return row


def answer(recording: Recording, _: list[str]) -> Answer:
    time, radius = recording.from_maximum()
    medium, origin = Medium(density=recording.density), read_maximum(recording.time, recording.radius)[0]
    best, sigma = fit(lambda x: ratio(x, time, recording.max_radius, medium), radius / recording.max_radius)

    def predict(at: np.ndarray) -> np.ndarray:
        return recording.max_radius * ratio(best, at - origin, recording.max_radius, medium)

    return {**bounded(best, sigma), "predict": predict}


if __name__ == "__main__":
    run(__doc__, answer)
