"""The control of `fit`: conventional least squares in a page of scipy, which share nothing but the simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import cavirheo
from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, simulate

R_MAX, NOISE, FRAMES = 250e-6, 0.01, 80
STARTS = [(G, mu, 6.5) for G in (3e3, 2e4) for mu in (0.02, 0.1)]
BOUNDS = ([2.0, -3.0, 0.3], [5.0, 0.5, 1.2])  # log10 of G, Pa, of mu, Pa s, and of the stretch
NAMES = ("shear_modulus", "viscosity", "stretch")


def radius(x: np.ndarray) -> np.ndarray:
    """(frames,) of log10 of G, mu and stretch, m, at 1 Mfps from R_max on; nothing where the simulation fails."""
    G, mu, stretch = 10.0**x
    law, time = NeoHookeanKelvinVoigt(G, mu), 1e-6 * np.arange(FRAMES)
    run = simulate(law, max_radius=R_MAX, stretch=stretch, time=time, throw=False)
    return run.radius if run.ok else np.zeros(FRAMES)


def recording(truth: tuple[float, float, float], seed: int) -> RadiusCurve:
    """A gel with independent noise of 1 % of R_max, whose clock and R_max are right."""
    noise = NOISE * R_MAX * np.random.default_rng(seed).standard_normal(FRAMES)
    return RadiusCurve(1e-6 * np.arange(FRAMES), radius(np.log10(truth)) + noise, maximum=(0.0, R_MAX))


def control(curve: RadiusCurve) -> tuple[np.ndarray, np.ndarray]:
    """log10 of G, mu and stretch at the lowest minimum, and their standard deviations: the variance of the residuals
    times (J'J)^-1."""

    def residuals(x: np.ndarray) -> np.ndarray:
        return (curve.radius - radius(x)) / (NOISE * R_MAX)

    ends = [least_squares(residuals, np.log10(start), bounds=BOUNDS, diff_step=1e-3) for start in STARTS]
    best = min(ends, key=lambda end: end.cost)
    variance = 2.0 * best.cost / (FRAMES - len(best.x))
    return best.x, np.sqrt(variance * np.diag(np.linalg.inv(best.jac.T @ best.jac)))


@pytest.mark.parametrize("weights", ["equal", pytest.param("learnt", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("truth", "seed"),
    [((8e3, 0.05, 7.0), 1), pytest.param((3e3, 0.1, 6.0), 2, marks=pytest.mark.slow), ((2e4, 0.03, 5.5), 3)],
)
def test_a_fit_is_the_conventional_least_squares(truth, seed, weights):
    """Where a minimum is Gaussian, best value, median and interval are the textbook's, but for the noise of about a
    hundred draws."""
    curve = recording(truth, seed)
    best, sigma = control(curve)
    how = {"bubble": "field", "window": "all", "free": "none", "weights": weights}
    answer = cavirheo.fit(curve, others=False, trust_input=True, **how)
    for name, middle, width in zip(NAMES, best, sigma, strict=True):
        low, high = np.log10(answer.interval(name))
        assert abs(np.log10(answer.best[name]) - middle) < 0.3 * width, name
        assert abs(np.log10(answer.median(name)) - middle) < 0.4 * width, name
        assert 0.7 < (high - low) / (2.0 * 1.645 * width) < 1.4, name
