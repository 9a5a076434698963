"""The posterior of a material's centre and of the scatter of its shots about it, given their likelihoods.

    p(frames_i | c, S) = (1 - P_OUTLIER) L_i(c, S) + P_OUTLIER L_i(c, S + OUTLIER_STD^2),

L_i(c, S) the integral of the likelihood of shot i over a normal population with centre c in log10 and variances S. An
outlier has the second, wide density (Mandel, Farr and Gair 2019, doi:10.1093/mnras/stz896).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.population.likelihood import Likelihood
from cavirheo.inference.sample import Draws, Mixture, first_round, sample
from cavirheo.prior import Prior, log_normal

P_OUTLIER = 0.05  # prior probability that a shot is an outlier
OUTLIER_STD = 0.7  # decades: additional standard deviation of outliers
SPREAD_SCALE = 0.2  # decades: scale of the half-normal prior of each spread
CUT = 10.0  # standard deviations at which this prior ends
ROUNDS = (1000, 1500, 2000, 2500, 3000, 3500, 4000)  # draws of each round at most
ENOUGH = 2500.0  # effective draws after which no round follows
ROWS = 250  # places at which densities are computed at a time


class MaterialPosterior:
    """The log posterior over u, the normal coordinates of the prior (cavirheo.prior). shots: n likelihoods. low,
    high: (d,) range of the centre, log10."""

    def __init__(self, shots: Sequence[Likelihood]) -> None:
        self.low = np.min([shot.low for shot in shots], axis=0)
        self.high = np.max([shot.high for shot in shots], axis=0)
        self.shots, self.d = shots, len(self.low)
        rows = [(one, other, 0.0, np.inf) for one, other in zip(self.low, self.high, strict=True)]
        rows += [(0.0, CUT * SPREAD_SCALE, 0.0, SPREAD_SCALE)] * self.d
        self.prior = Prior(tuple(map(str, range(len(rows)))), *np.array(rows, dtype=float).T)

    def parts(self, u: Floats) -> tuple[Floats, Floats]:
        """Centre and spread (k, d) of u (k, 2 d)."""
        x = self.prior.to_x(u)
        return x[:, : self.d], x[:, self.d :]

    def densities(self, u: Floats) -> tuple[Floats, Floats]:
        """Log density (n, k) of each shot as an inlier and as an outlier, with the prior probabilities of these."""
        inside, outside = np.empty((2, len(self.shots), len(u)))
        for begin in range(0, len(u), ROWS):
            rows = slice(begin, begin + ROWS)
            centre, spread = self.parts(u[rows])
            for i, shot in enumerate(self.shots):
                inside[i, rows] = shot.log_integral(centre, spread**2)
                outside[i, rows] = shot.log_integral_of_outliers(centre, spread**2 + OUTLIER_STD**2)
        return np.log(1.0 - P_OUTLIER) + inside, np.log(P_OUTLIER) + outside

    def log_density(self, u: Floats) -> Floats:
        """Log posterior (k,) at u (k, 2 d)."""
        return np.asarray(np.sum(np.logaddexp(*self.densities(u)), axis=0) + log_normal(u))

    def sample(self, seed: int) -> Draws:
        """Weighted draws."""
        rng = np.random.Generator(np.random.Philox(seed))

        def values(u: Floats) -> Floats:
            return self.log_density(u)[:, None]

        rounds = first_round(self._start(), ROUNDS[0], values, rng)
        return sample(values, lambda u, value: value[:, 0], rounds, ROUNDS, rng, ENOUGH)[0]

    def outliers(self, u: Floats) -> Floats:
        """Probability (n,) that each shot is an outlier, averaged over equally likely u (k, 2 d)."""
        inside, outside = self.densities(u)
        return np.asarray(np.mean(np.exp(outside - np.logaddexp(inside, outside)), axis=1))

    def _start(self) -> Mixture:
        """First proposal: normal shots about their median."""
        means = np.array([shot.mean for shot in self.shots])
        centre = np.median(means, axis=0)
        scatter = 1.5 * np.median(np.abs(means - centre), axis=0)  # the standard deviation of normal numbers
        own = np.sqrt(np.median([np.diag(shot.covariance) for shot in self.shots], axis=0))
        error = np.hypot(scatter, own) / np.sqrt(len(means))
        spread = np.maximum(scatter, own)
        low, middle, high = (
            self.prior.to_u(np.concatenate([at, spread]), inside=1e-3)
            for at in (centre - error, centre, centre + error)
        )
        width = np.ones(len(middle))
        width[: self.d] = 0.5 * (high - low)[: self.d]
        return Mixture.of_modes([middle], [np.diag(width**2)], [0.0])
