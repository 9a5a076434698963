"""A posterior network's answer for any recording that is within what it was trained on; else where to start a search.

The draws of the network (posterior_network.py) are an answer by themselves, in milliseconds, and its interval is as
good as its training. Weighed by simulations (inference/verify, level "auto") they are the answer that `infer` gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import input_checks
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.law import Family
from cavirheo.inference.options import FREE, Options
from cavirheo.inference.posterior_network import NetworkProposal, PosteriorModel
from cavirheo.messages import Message
from cavirheo.parameters import LOG10, units
from cavirheo.physics.accuracy import ROUGH
from cavirheo.physics.bubble import REAL, Bubble
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Checks, Diagnostics, Posterior
from cavirheo.prior import log_normal

DRAWS = 1000
SIMULATED = 8  # of the draws, those that the network takes for the likeliest, simulated to check the answer


@dataclass(frozen=True)
class Networked:
    """Estimator: a posterior network, a law and a model of the bubble.

    model: the network. stretch, window: as in `fit_many`. checked: simulate the likeliest draws; without it the answer
    is for a verification to start from. discrepancy: whether more than white noise may lie between frames and law.
    """

    model: PosteriorModel
    material: str = "nhkv"
    bubble: Bubble = REAL
    medium: Medium = WATER
    stretch: float | str | None = None
    window: int | None = None
    trust_input: bool = False
    discrepancy: bool = True
    checked: bool = True
    seed: int = 0

    def infer(self, curve: RadiusCurve) -> Posterior:
        """The answer for one curve; one that cannot be answered gives a failed Posterior with the reason."""
        names = (*(LOG10 + name for name in Family(self.material).parameters), "stretch")
        network: Any = {"model": self.model.name, "model_sha256": self.model.sha256}
        empty = input_checks.empty_answer(curve, names, self.material, "amortised", self.bubble, self.medium, **network)
        return input_checks.answer_of(curve, empty, self._answer, self.trust_input)

    def _experiment(self, curve: RadiusCurve) -> Experiment:
        options = Options(self.window, None, self.stretch, tuple(FREE), bubble=self.bubble)
        exposure = float(curve.exposure or 0.0)
        return Experiment(curve, Family(self.material), self.medium, options, exposure=exposure)

    def _draws(self, shot: Experiment) -> tuple[NetworkProposal, Floats]:
        """What the network answers, and u (draws, d) of it. Raises InputError: it cannot read it."""
        proposal = self.model.proposal(shot, shot.prior(), self.discrepancy)
        return proposal, proposal.draw(DRAWS, np.random.Generator(np.random.Philox(self.seed)))

    def _medians(self, curve: RadiusCurve) -> Floats:
        """(parameters,) in the prior's scale. Raises InputError: the network cannot read it."""
        shot = self._experiment(curve)
        proposal, u = self._draws(shot)
        return np.asarray(np.median(shot.answer(proposal.prior.to_x(u))[1], axis=0))

    def _answer(self, curve: RadiusCurve) -> tuple[dict[str, Any], list[Message]]:
        """Fields of the Posterior, and further input warnings."""
        shot = self._experiment(curve)
        checks = Checks("unverified", t_star_end=shot.view.end / shot.time_scale)
        warnings = input_checks.wall_warnings(shot)
        source = "given" if shot.stretch else "inferred with the other parameters"
        fields: dict[str, Any] = {"material": shot.family.name, "diagnostics": Diagnostics(stretch_source=source)}
        try:
            proposal, u = self._draws(shot)
        except InputError as error:
            if self.checked or not error.code.startswith("network"):
                raise
            middle = shot.starts(np.zeros((1, len(shot.names))))
            middle[:, : shot.law] = np.mean(shot.family.bounds(started=True), axis=1)
            names, theta = shot.answer(middle)
            fields |= {"names": names, "units": units(names), "theta": theta}
            return fields | {"checks": checks}, warnings  # a verification says why
        x = proposal.prior.to_x(u)
        names, theta = shot.answer(x)
        log_q = proposal.log_density(u) - log_normal(u) + proposal.prior.log_density(x)
        likeliest = np.argsort(-log_q)[:SIMULATED]
        best = x[likeliest[0]]
        if self.checked:
            missed = [float(np.mean(shot.difference(x[i], ROUGH) ** 2)) for i in likeliest]
            best = x[likeliest[int(np.argmin(np.nan_to_num(missed, nan=np.inf)))]]
            unbounded = shot.unbounded(x, proposal.prior.low, proposal.prior.high)
            checks = shot.checks(best, "unverified", [Message("interval.of_network"), *unbounded])
        values, prior = shot.best(best), shot.of_law(shot.prior())
        fields |= {"names": names, "units": units(names), "theta": theta, "checks": checks, "best": values}
        fields |= {"stretch": values["stretch"], "prior": prior, "log_q": log_q - shot.log_stretched(theta)}
        spikes = input_checks.spike_warnings(curve, names, self._medians, np.median(theta, axis=0))
        return fields, spikes + warnings
