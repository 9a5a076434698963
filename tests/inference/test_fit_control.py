"""The control of `fit`: conventional least squares in a page of scipy, which share nothing but the simulation."""

from __future__ import annotations

import numpy as np
import pytest

import cavirheo
from cavirheo import RadiusCurve
from cavirheo.physics.media import WATER
from validation.challenge import run_scipy

R_MAX, NOISE, FRAMES = 250e-6, 0.01, 80
NAMES = ("shear_modulus", "viscosity", "stretch")


def ratio(x: np.ndarray) -> np.ndarray:
    """R/R_max (frames,) of log10 of G, mu and stretch, at 1 Mfps from R_max on."""
    return run_scipy.ratio(x, 1e-6 * np.arange(FRAMES), R_MAX, WATER)


def recording(truth: tuple[float, float, float], seed: int) -> RadiusCurve:
    """A gel with independent noise of 1 % of R_max, whose clock and R_max are right."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(FRAMES)
    return RadiusCurve(1e-6 * np.arange(FRAMES), R_MAX * (ratio(np.log10(truth)) + noise), maximum=(0.0, R_MAX))


@pytest.mark.parametrize("weights", ["equal", pytest.param("learnt", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("truth", "seed"),
    [
        ((8e3, 0.05, 7.0), 1),
        pytest.param((3e3, 0.1, 6.0), 2, marks=pytest.mark.slow),
        pytest.param((2e4, 0.03, 5.5), 3, marks=pytest.mark.slow),
    ],
)
def test_a_fit_is_the_conventional_least_squares(truth, seed, weights):
    """Where a minimum is Gaussian, best value, median and interval are the textbook's, but for the noise of about a
    hundred draws, and for the weights of frames that the fit has learnt."""
    curve = recording(truth, seed)
    best, sigma = run_scipy.fit(ratio, curve.radius / R_MAX)
    how = {"bubble": "field", "window": "all", "free": "none", "weights": weights}
    answer = cavirheo.fit(curve, others=False, trust_input=True, **how)
    apart = 0.5 if weights == "learnt" else 0.3
    for name, middle, width in zip(NAMES, best, sigma, strict=True):
        low, high = np.log10(answer.interval(name))
        assert abs(np.log10(answer.best[name]) - middle) < apart * width, name
        assert abs(np.log10(answer.median(name)) - middle) < (apart + 0.1) * width, name
        assert 0.7 < (high - low) / (2.0 * 1.645 * width) < 1.4, name
