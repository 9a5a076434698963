"""The posterior without simulations: residuals as polynomials of u, learnt from rough simulations near its maximum.

It only gives a proposal its shape, bends and long tails included, which thousands of draws show and some hundred do
not: what counts in a posterior is simulated.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.inference.verify.mode import Target
from cavirheo.inference.verify.prior import log_normal
from cavirheo.inference.verify.sampler import Mixture, effective_size

Floats = NDArray[np.float64]

ROUNDS, LEARNT = 3, 200  # simulations a round
FITS, DRAWS = 5, 4000  # of the mixture to the surrogate after each, and draws for each
DEGREE = 3  # at most
SPARE = 1.5  # simulations per coefficient
NEAR = 10.0  # log posterior below the best at which a simulation counts 1/e
RIDGE = 1e-8  # of the normal equations, relative
BEYOND = 1.2  # distance over that of the farthest simulation, beyond which nothing is known


class Surrogate:
    """log posterior of u (k, d) from the simulations that `learn` was given. Failed simulations teach nothing."""

    def __init__(self, target: Target, accuracy: dict[str, Any]) -> None:
        self.target, self.accuracy = target, accuracy
        self.u = np.empty((0, len(target.prior.names)))
        self.residual = np.empty((0, len(target.likelihood.measured)))
        self.known = False

    def shape(self, proposal: Mixture, rng: np.random.Generator) -> Mixture:
        """The proposal, fitted to the posterior in rounds of simulations where it and its tails are."""
        for _ in range(ROUNDS):
            self.learn(proposal.widened().draw(LEARNT, rng))
            for _ in range(FITS if self.known else 0):
                wide = proposal.widened()
                u = wide.draw(DRAWS, rng)
                log_weight = self(u) - wide.log_density(u)
                if np.any(np.isfinite(log_weight)):
                    proposal = proposal.fitted(u, log_weight)
        return proposal

    def learn(self, u: Floats) -> None:
        """Simulate u (k, d) and fit all residuals so far."""
        residual = self.target.residuals(u, self.accuracy)
        good = np.all(np.isfinite(residual), axis=1)
        self.u = np.concatenate([self.u, u[good]])
        self.residual = np.concatenate([self.residual, residual[good]])
        if not len(self.u):
            return
        value = self.target.likelihood.noise.log_density(self.residual) + log_normal(self.u)
        log_weight = (value - np.max(value)) / NEAR
        worth, d = effective_size(log_weight), self.u.shape[1]
        degrees = [degree for degree in range(1, DEGREE + 1) if worth > SPARE * comb(d + degree, degree)]
        self.known = bool(degrees)
        if not self.known:
            return
        weight = np.exp(log_weight)
        self.centre = weight @ self.u / np.sum(weight)
        off = self.u - self.centre
        self.root = np.linalg.cholesky((off.T * weight) @ off / np.sum(weight))
        z = self._whitened(self.u)
        self.limit = BEYOND**2 * float(np.max(np.sum(z**2, axis=1)))
        self.terms = [
            term for degree in range(degrees[-1] + 1) for term in combinations_with_replacement(range(d), degree)
        ]
        powers = self._powers(z)
        normal = (powers.T * weight) @ powers
        normal[np.diag_indices_from(normal)] *= 1.0 + RIDGE
        self.coefficients = np.linalg.solve(normal, (powers.T * weight) @ self.residual)

    def __call__(self, u: Floats) -> Floats:
        z = self._whitened(u)
        near = np.sum(z**2, axis=1) <= self.limit
        value = np.full(len(u), -np.inf)
        residual = self._powers(z[near]) @ self.coefficients
        value[near] = self.target.likelihood.noise.log_density(residual) + log_normal(u[near])
        return value

    def _whitened(self, u: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.root, (u - self.centre).T).T)

    def _powers(self, z: Floats) -> Floats:
        """(k, terms)"""
        return np.column_stack([np.prod(z[:, list(term)], axis=1) for term in self.terms])
