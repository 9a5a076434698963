"""A trained network answers, and simulations correct the answer for the true scale of the shot.

The network was trained at one R_max, in one medium and on one grid of times. Its answer theta_net is brought to the
shot at the same Cauchy and Reynolds numbers (TrainingProblem.to_shot), which is not enough: surface tension, heat and
mass transfer do not scale, and a 60 um bubble read as a 245 um one looks 0.3 to 0.4 decades too viscous
(docs/method/physics.md, section 1). So the network is used as a summary of the curve (indirect inference, Gourieroux,
Monfort and Renault 1993, doi:10.1002/jae.3950080507): wanted is the theta whose simulation *at the true R_max, in the
true medium, seen by the same camera with the same noise* gives the same summary,

    theta <- theta + net(measured) - net(simulated(theta)),

which removes the network's own bias as well. The stretch, which the network does not give, is fitted along the way.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.model import Network
from cavirheo.inference.reconstruct import MISFIT, Reconstruction, check_stretch, fit_stretch, reconstruct, window
from cavirheo.parameters import LOG10, about, natural, natural_name, units
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import ROUGH, simulate
from cavirheo.posterior import Checks, Diagnostics, Posterior, Verdict
from cavirheo.problem import natural_values

ITERATIONS = 12
NOISE_DRAWS = 4
STRETCH_SETTLED = 0.003  # relative change of the stretch in the last iteration
PATIENCE = 4  # iterations without a nearer summary
CONVERGED = 0.005  # largest difference of the two summaries, decades
LARGEST_STEP = 0.5  # decades
MARGIN = 0.3  # decades beyond the training range, there and at the shot's scale, in which the answer is looked for
SHORTEST = 0.6  # of the network's samples that must lie inside the recording


@dataclass(frozen=True)
class Amortised:
    """Estimator: a network and the settings of the shot.

    `stretch` None is fitted. `collapses` limits the window of the check and of the stretch (the network always reads
    its own window). `correct` False gives the network's answer at equal Cauchy and Reynolds numbers and no more.
    """

    model: Network
    medium: Medium = WATER
    stretch: float | None = None
    collapses: int | None = None
    correct: bool = True

    def infer(self, curve: RadiusCurve) -> Posterior:
        """The answer for one curve; one that cannot be answered gives a failed Posterior with the reason.

        Raises:
            InputError: a setting is out of its domain (what concerns the curve is in the answer instead).
        """
        check_stretch(self.stretch)
        if self.collapses is not None and self.collapses < 1:
            raise InputError(f"the window must hold at least 1 collapse, got {self.collapses}", "option.window")
        began = time.perf_counter()
        try:
            posterior = _Answer(self, curve).posterior()
        except (InputError, SolverError) as error:
            names = self.model.outputs
            posterior = Posterior(
                names, units(names), np.empty((0, len(names))), Checks("failed", str(error)),
                self.model.problem.material_name, "bdt", self._provenance(curve),
            )  # fmt: skip
        return replace(posterior, seconds=time.perf_counter() - began)

    def network_alone(self, curve: RadiusCurve) -> Floats:
        """(outputs,) for the shot, in the prior's scale: what the network reads off the curve at equal Cauchy and
        Reynolds numbers. Nothing is simulated; after the end of a short recording its last radius is held.

        Raises InputError: the curve cannot be put on the network's grid.
        """
        answer = _Answer(self, curve)
        return answer.for_shot(self.model(answer._completed(None))[0])

    def _provenance(self, curve: RadiusCurve) -> dict[str, Any]:
        return {
            "cavirheo": version("cavirheo"),
            "model": self.model.name,
            "model_sha256": self.model.sha256,
            "problem_id": self.model.problem.id,
            "medium": asdict(self.medium),
            "corrected_at_true_scale": self.correct,
            "source_sha256": curve.source_sha256,
        }


class _Answer:
    """The work on one curve."""

    def __init__(self, estimator: Amortised, curve: RadiusCurve) -> None:
        self.settings, self.curve, self.model = estimator, curve, estimator.model
        self.problem, self.medium = estimator.model.problem, estimator.medium
        self.max_radius = curve.max_radius
        self.step = self.problem.grid_step(self.max_radius, self.medium)
        self.frames = self.problem.grid.frames
        self.features = curve.resampled(self.step, self.frames, allow_short=True) / self.max_radius
        self.missing = np.isnan(self.features)
        read_until = self.step * (self.frames - 1)
        self.time_scale = self.medium.time_scale(self.max_radius)
        if np.count_nonzero(~self.missing) < SHORTEST * self.frames:
            end = curve.time[np.isfinite(curve.radius)][-1] - curve.time_of_max
            raise InputError(
                f"{curve.name}: the recording ends {end * 1e6:.4g} us after R_max; the model reads "
                f"{read_until * 1e6:.4g} us (t* = {read_until / self.time_scale:.2f}) and needs at least "
                f"{SHORTEST:.0%} of them",
                "amortised.too_short",
            )
        self.view = window(curve, collapses=estimator.collapses, end=read_until)
        prior = self.problem.prior
        columns = [prior.names.index(name) for name in self.model.outputs]
        self.low, self.high = prior.low[columns], prior.high[columns]
        # Frames as the camera saw them after R_max; simulations are put on the grid from these, as the measurement was.
        seen = np.isfinite(curve.radius) & (curve.time > curve.time_of_max)
        self.seen = curve.time[seen] - curve.time_of_max
        rng = np.random.default_rng(0)  # the same draws in every iteration, so that it converges
        self.noise = curve.noise * rng.standard_normal((NOISE_DRAWS, len(self.seen)))
        self.messages: list[str] = []

    def posterior(self) -> Posterior:
        theta, stretch = self._consistent() if self.settings.correct else self._plain()
        given = self.settings.stretch is not None
        source = "given" if given else "fitted to the curve with the G and mu of the answer"
        found = reconstruct(self.view, self._material(theta), self.medium, stretch)
        names, draw = self.model.outputs, self.for_shot(theta)
        best = {natural_name(name): float(natural(name, value)) for name, value in zip(names, draw, strict=True)}
        provenance = self.settings._provenance(self.curve) | {
            "stretch": stretch,
            "stretch_source": source,
            "network_alone": {f"{name} [{about(name).unit}]": value for name, value in self._natural(self.raw).items()},
        }
        return Posterior(
            names, units(names), draw[None, :], self._checks(theta, stretch, found), self.problem.material_name, "bdt",
            provenance, best=best | {"stretch": stretch}, stretch=stretch,
            diagnostics=Diagnostics(stretch_source=source),
        )  # fmt: skip

    def for_shot(self, theta: Floats) -> Floats:
        """(outputs,) in the prior's scale for the shot from theta at the reference scale."""
        values = zip(self.model.outputs, self._natural(theta).values(), strict=True)
        return np.array([np.log10(value) if name.startswith(LOG10) else value for name, value in values])

    def _plain(self) -> tuple[Floats, float]:
        """The network's answer alone; a short recording is completed from its own reconstruction."""
        theta = self.raw = self.model(self._completed(None))[0]
        stretch = self._stretch(theta, None)
        if self.missing.any():
            for _ in range(3):
                theta = self.raw = self.model(self._completed(self._simulated(theta, stretch))).mean(axis=0)
                stretch = self._stretch(theta, stretch)
        return theta, stretch

    def _consistent(self) -> tuple[Floats, float]:
        """Indirect inference; Aitken's rule relaxes the step, for G and stretch pull at each other."""
        # The training range at the training scale joined with the same numbers at the shot's, and MARGIN more.
        shift = self.for_shot(np.zeros(len(self.low)))  # what 10^0 at the training scale is for the shot
        low, high = np.minimum(self.low, self.low - shift) - MARGIN, np.maximum(self.high, self.high - shift) + MARGIN
        theta = self.raw = self.model(self._completed(None))[0]
        theta = np.clip(theta, low, high)
        stretch: float | None = None
        before: Floats | None = None
        relaxation = 1.0
        best: tuple[int, float, Floats, float] | None = None
        for turn in range(ITERATIONS):
            last, stretch = stretch, self._stretch(theta, stretch)
            settled = last is not None and abs(np.log(stretch / last)) < STRETCH_SETTLED
            simulated = self._simulated(theta, stretch)
            measured = self._completed(simulated)
            both = self.model(np.concatenate([measured, simulated]))
            of_measured, of_simulated = both[: len(measured)].mean(axis=0), both[len(measured) :].mean(axis=0)
            difference = of_measured - of_simulated
            size = float(np.max(np.abs(difference)))
            if best is None or size < max(best[1], CONVERGED):  # among converged ones the last: its stretch is the best
                best, self.raw = (turn, size, theta, stretch), of_measured
            if (size < CONVERGED and settled) or turn - best[0] > PATIENCE:
                break
            if before is not None:
                change = difference - before
                relaxation = float(np.clip(-relaxation * (before @ change) / (change @ change + 1e-12), 0.2, 1.2))
            before = difference
            step = np.clip(relaxation * difference, -LARGEST_STEP, LARGEST_STEP)
            theta = np.clip(theta + step, low, high)
        assert best is not None
        _, size, theta, stretch = best
        if size > 4 * CONVERGED:
            self.messages.append(
                f"no parameters make the network see the simulation as it sees the measurement "
                f"(nearest: {size:.2g} decades apart)"
            )
        return theta, stretch

    def _completed(self, simulated: Floats | None) -> Floats:
        """(k, frames) the measured samples; those after the recording's end from the simulations (k, frames), or, to
        begin with, the last one held."""
        if not self.missing.any():
            return self.features[None, :]
        last = self.features[~self.missing][-1]
        return np.where(self.missing, last if simulated is None else simulated, self.features[None, :])

    def _simulated(self, theta: Floats, stretch: float) -> Floats:
        """(k, frames) R/R_max of the answer at the true R_max on the grid by way of the camera's frames, each with
        another draw of the measurement's noise: the network takes noise for a weaker damping, in both alike."""
        grid = self.step * np.arange(self.frames)
        beyond = grid[grid > self.seen[-1]]
        times = np.concatenate([[0.0], self.seen, beyond])
        run = simulate(
            self._material(theta), max_radius=self.max_radius, stretch=stretch, time=times,
            medium=self.medium, **ROUGH,  # the network sees no more
        )  # fmt: skip
        noise = np.zeros((len(self.noise), len(times)))
        noise[:, 1 : 1 + len(self.seen)] = self.noise
        radius = run.radius + noise
        radius[radius <= 0] = np.nan
        return np.array([self._on_grid(times, row) for row in radius])

    def _on_grid(self, times: Floats, radius: Floats) -> Floats:
        seen = RadiusCurve(times, radius, maximum=(0.0, self.max_radius))
        return seen.resampled(self.step, self.frames) / self.max_radius

    def _stretch(self, theta: Floats, near: float | None) -> float:
        return self.settings.stretch or fit_stretch(self.view, self._material(theta), self.medium, near)

    def _natural(self, theta: Floats) -> dict[str, float]:
        """SI values for the shot from theta at the reference scale."""
        return self.problem.to_shot(natural_values(self.model.outputs, theta), self.max_radius, self.medium)

    def _material(self, theta: Floats) -> Material:
        return MATERIALS[self.problem.material_name](**self._natural(theta))

    def _checks(self, theta: Floats, stretch: float, found: Reconstruction) -> Checks:
        outside = [
            f"{natural_name(name)} (at the training scale 10^{value:.2f}, trained in 10^{a:g} to 10^{b:g})"
            for name, value, a, b in zip(self.model.outputs, theta, self.low, self.high, strict=True)
            if not a - 0.02 <= value <= b + 0.02
        ]
        prior = self.problem.prior.part(self.problem.prior.names.index("stretch"))
        a, b = prior.low[0], prior.high[0]
        if not 0.97 * a <= stretch <= 1.03 * b:
            outside.append(f"stretch {stretch:.3g} (trained in {a:g} to {b:g})")
        verdict: Verdict = "ok"
        messages = self.messages
        if self.missing.any():
            messages.append(
                f"{np.count_nonzero(self.missing)} of the network's {self.frames} samples lie after the recording's "
                f"end and were taken from the simulation of the answer itself"
            )
        if outside:
            verdict = "outside_training_range"
            messages.insert(0, "outside the training range: " + ", ".join(outside))
        if found.rmse > MISFIT:
            verdict = "model_does_not_fit"
            misses = f"the simulation misses the measurement by {found.rmse:.1%} of R_max RMS (limit {MISFIT:.0%})"
            messages.insert(0, misses)
        return found.checks(self.view, self.time_scale, verdict, messages)
