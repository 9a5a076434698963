"""A posterior network's answer for any recording that is within what it was trained on; else where to start a search.

The draws of the network (posterior_network.py) are an answer by themselves, in milliseconds, and its interval is as
good as its training. Weighed by simulations (inference/verify, level "auto") they are the answer that `infer` gives.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
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
from cavirheo.parameters import LOG10, natural_name, units
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

    def __post_init__(self) -> None:
        """Raises InputError: an unknown law, or a setting out of its domain."""
        self._options(), Family(self.material)

    def infer(self, curve: RadiusCurve) -> Posterior:
        """The answer for one curve; one that cannot be answered gives a failed Posterior with the reason."""
        start = time.perf_counter()
        provenance: Any = {"cavirheo": version("cavirheo"), "model": self.model.name, "model_sha256": self.model.sha256}
        provenance |= {"source_sha256": curve.source_sha256}
        names: tuple[str, ...] = (*(f"log10_{name}" for name in Family(self.material).parameters), "stretch")
        try:
            shot = self._experiment(curve)
            answer = self._answer(shot)
            warnings = [*self._warnings(curve, answer), *input_checks.of_walls(shot)]
            answer = replace(answer, checks=input_checks.warned(answer.checks, warnings, self.trust_input))
        except input_checks.ERRORS as error:  # of this curve alone
            checks = input_checks.failed(error, curve, self.medium)
            answer = Posterior(names, units(names), np.empty((0, len(names))), checks, self.material, "amortised")
        seconds, provenance = time.perf_counter() - start, provenance | answer.provenance
        return replace(answer, bubble=self.bubble, medium=self.medium, seconds=seconds, provenance=provenance)

    def _options(self) -> Options:
        return Options(self.window, None, self.stretch, tuple(FREE), bubble=self.bubble)

    def _experiment(self, curve: RadiusCurve) -> Experiment:
        exposure = float(curve.exposure or 0.0)
        return Experiment(curve, Family(self.material), self.medium, self._options(), exposure=exposure)

    def _draws(self, shot: Experiment) -> tuple[NetworkProposal, Floats]:
        """What the network answers, and u (draws, d) of it. Raises InputError: it cannot read it."""
        proposal = self.model.proposal(shot, shot.prior(), self.discrepancy)
        return proposal, proposal.draw(DRAWS, np.random.Generator(np.random.Philox(self.seed)))

    def _answer(self, shot: Experiment) -> Posterior:
        diagnostics = Diagnostics(stretch_source="given" if shot.stretch else "inferred with the other parameters")
        law, t_star = shot.family.name, shot.view.end / shot.time_scale
        try:
            proposal, u = self._draws(shot)
        except InputError as error:
            if self.checked or not error.code.startswith("network"):
                raise
            middle = shot.starts(np.zeros((1, len(shot.names))))
            middle[:, : shot.law] = np.mean(shot.family.bounds(started=True), axis=1)
            names, theta = shot.answer(middle)
            checks = Checks("unverified", t_star_end=t_star)  # a verification says why
            return Posterior(names, units(names), theta, checks, law, "amortised", diagnostics=diagnostics)
        x = proposal.prior.to_x(u)
        names, theta = shot.answer(x)
        log_q = proposal.log_density(u) - log_normal(u) + proposal.prior.log_density(x)
        likeliest = np.argsort(-log_q)[:SIMULATED]
        best, checks = x[likeliest[0]], Checks("unverified", t_star_end=t_star)
        if self.checked:
            missed = [float(np.mean(shot.difference(x[i], ROUGH) ** 2)) for i in likeliest]
            best = x[likeliest[int(np.argmin(np.nan_to_num(missed, nan=np.inf)))]]
            unbounded = shot.unbounded(x, proposal.prior.low, proposal.prior.high)
            messages = [Message("interval.of_network"), *unbounded]
            checks = shot.checks(best, "unverified", messages)
        values, log_q = shot.best(best), log_q - shot.log_stretched(theta)
        fields: Any = {"best": values, "stretch": values["stretch"], "prior": shot.of_law(shot.prior()), "log_q": log_q}
        return Posterior(names, units(names), theta, checks, law, "amortised", **fields, diagnostics=diagnostics)

    def _warnings(self, curve: RadiusCurve, answer: Posterior) -> list[Message]:
        """What the curve shows by itself, and whether frames that stand out move the network's answer."""
        messages = input_checks.plain(curve, self.medium)
        if answer.log_q is None:
            return messages
        if spiking := input_checks.without_spikes(curve):
            frames, without = spiking
            with suppress(InputError):  # read so it is no curve: nothing to compare
                shot = self._experiment(without)
                proposal, u = self._draws(shot)
                theta = shot.answer(proposal.prior.to_x(u))[1]
                change = np.median(theta, axis=0) - np.median(answer.theta, axis=0)
                logs = [(name, 10.0**d) for name, d in zip(answer.names, change, strict=True) if LOG10 in name]
                messages += input_checks.moved(frames, {natural_name(name): factor for name, factor in logs})
        return messages
