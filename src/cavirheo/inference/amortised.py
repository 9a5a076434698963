"""A trained network answers, and simulations correct the answer for the true scale of the shot.

The network knows one R_max, medium and grid of times. The same Cauchy and Reynolds numbers (TrainingProblem.to_shot)
are not enough: surface tension, heat and mass transfer do not scale, and a 60 um bubble read as a 245 um one looks 0.3
to 0.4 decades too viscous (docs/method/physics.md, section 1). So the network is used as a summary of the curve
(indirect inference, Gourieroux, Monfort and Renault 1993, doi:10.1002/jae.3950080507): wanted is the theta whose
simulation *at the true R_max, in the true medium, seen by the same camera with the same noise* gives the same summary,

    theta <- theta + net(measured) - net(simulated(theta)),

which removes the network's own bias as well. The stretch, which the network does not give, is fitted along the way.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, expect_whole, require
from cavirheo.inference import doubts
from cavirheo.inference.model import Network
from cavirheo.inference.reconstruct import MISFIT, check_stretch, fit_stretch, reconstruct, window
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
MARGIN = 0.3  # decades beyond the training range in which the answer is looked for
MODULUS = "shear_modulus"
LIQUID = "so soft a material may be a liquid: try --model bdt-viscous"
ELASTIC = "the material may be elastic: try --model bdt-viscoelastic"
SHORTEST = 0.6  # of the network's samples that must lie inside the recording


@dataclass(frozen=True)
class Amortised:
    """Estimator: a network and the settings of the shot. `stretch` None is fitted; `collapses` limits the window of
    the check and of the stretch (the network always reads its own); with `trust_input` doubts decide no verdict."""

    model: Network
    medium: Medium = WATER
    stretch: float | None = None
    collapses: int | None = None
    trust_input: bool = False

    def __post_init__(self) -> None:
        """Raises InputError: a model that does not answer its law, or a setting out of its domain."""
        needed, given = set(self.model.problem.prior.names) - {"stretch"}, ", ".join(self.model.outputs)
        told = f"the model {self.model.name} answers only {given}; its law needs {', '.join(sorted(needed))}"
        require(needed == {*self.model.outputs}, told, "model.outputs")
        check_stretch(self.stretch)
        if self.collapses is not None:
            expect_whole(self.collapses, "collapses in the window", 1, "option.window")

    def infer(self, curve: RadiusCurve) -> Posterior:
        """The answer for one curve; one that cannot be answered gives a failed Posterior with the reason."""
        began, names = time.perf_counter(), self.model.outputs
        found: dict[str, Any] = {}
        try:
            theta, checks, found = _Reading(self, curve).answer()
            checks = doubts.doubted(checks, self._doubts(curve), self.trust_input)
        except Exception as error:  # of this curve alone
            theta, checks = np.empty((0, len(names))), doubts.failed(error, curve, self.medium)
        provenance = {
            "cavirheo": version("cavirheo"),
            "model": self.model.name,
            "model_sha256": self.model.sha256,
            "problem_id": self.model.problem.id,
            "medium": asdict(self.medium),
            "corrected_at_true_scale": True,
            "source_sha256": curve.source_sha256,
        } | found.pop("provenance", {})
        material, seconds = self.model.problem.material_name, time.perf_counter() - began
        return Posterior(names, units(names), theta, checks, material, "bdt", provenance, seconds=seconds, **found)

    def _doubts(self, curve: RadiusCurve) -> list[str]:
        said, names = doubts.plain(curve, self.medium), self.model.outputs
        for difference, other in doubts.readings(curve):
            with suppress(InputError):  # read so it is no curve: nothing to compare
                change = self.network_alone(other) - self.network_alone(curve)
                factors = {natural_name(name): 10.0**d for name, d in zip(names, change, strict=True)}
                said += doubts.moved(difference, factors)
        return said

    def network_alone(self, curve: RadiusCurve) -> Floats:
        """(outputs,) for the shot, in the prior's scale: what the network reads off the curve at equal Cauchy and
        Reynolds numbers. Raises InputError: the curve cannot be put on the network's grid."""
        work = _Reading(self, curve)
        return work.for_shot(self.model(work.completed())[0])


class _Reading:
    """The work on one curve. theta (outputs,) are in the prior's scale, for the reference scale."""

    def __init__(self, settings: Amortised, curve: RadiusCurve) -> None:
        self.settings, self.model, self.medium = settings, settings.model, settings.medium
        self.problem, self.max_radius = self.model.problem, curve.max_radius
        self.step, self.frames = self.problem.grid_step(self.max_radius, self.medium), self.problem.grid.frames
        self.features = curve.resampled(self.step, self.frames, allow_short=True) / self.max_radius
        self.missing = np.isnan(self.features)
        self.time_scale = self.medium.time_scale(self.max_radius)
        read_until = self.step * (self.frames - 1)
        if np.count_nonzero(~self.missing) < SHORTEST * self.frames:
            end = curve.time[np.isfinite(curve.radius)][-1] - curve.time_of_max
            raise InputError(
                f"{curve.name}: the recording ends {end * 1e6:.4g} us after R_max; the model reads "
                f"{read_until * 1e6:.4g} us (t* = {read_until / self.time_scale:.2f}) and needs at least "
                f"{SHORTEST:.0%} of them",
                "amortised.too_short",
            )
        self.view = window(curve, collapses=settings.collapses, end=read_until)
        self.low, self.high = np.transpose([self.problem.prior.bounds(name) for name in self.model.outputs])
        # Simulations are put on the grid from the camera's frames after R_max, as the measurement was.
        seen = np.isfinite(curve.radius) & (curve.time > curve.time_of_max)
        self.seen = curve.time[seen] - curve.time_of_max
        rng = np.random.default_rng(0)  # the same draws in every iteration, so that it converges
        self.noise = curve.noise * rng.standard_normal((NOISE_DRAWS, len(self.seen)))
        self.messages: list[str] = []

    def answer(self) -> tuple[Floats, Checks, dict[str, Any]]:
        """theta (1, outputs) of the shot, its checks, and further fields of its Posterior."""
        raw, theta, stretch = self._consistent()
        draw, given = self.for_shot(theta), self.settings.stretch is not None
        best = {name: float(natural(name, value)) for name, value in zip(self.model.outputs, draw, strict=True)}
        best = {natural_name(name): value for name, value in best.items()} | {"stretch": stretch}
        source = "given" if given else "fitted to the curve with the G and mu of the answer"
        network = {f"{name} [{about(name).unit}]": value for name, value in self._natural(raw).items()}
        provenance = {"stretch": stretch, "stretch_source": source, "network_alone": network}
        diagnostics = Diagnostics(stretch_source=source)
        found = {"best": best, "stretch": stretch, "diagnostics": diagnostics, "provenance": provenance}
        return draw[None, :], self._checks(theta, stretch), found

    def for_shot(self, theta: Floats) -> Floats:
        """(outputs,) in the prior's scale for the shot."""
        values = zip(self.model.outputs, self._natural(theta).values(), strict=True)
        return np.array([np.log10(value) if name.startswith(LOG10) else value for name, value in values])

    def completed(self, simulated: Floats | None = None) -> Floats:
        """(1 or k, frames) the measured samples; after the recording's end those of simulations (k, frames), or the
        last one."""
        fill = self.features[~self.missing][-1] if simulated is None or not self.missing.any() else simulated
        return np.where(self.missing, fill, self.features[None, :])

    def _consistent(self) -> tuple[Floats, Floats, float]:
        """What the network reads, theta and the stretch by indirect inference, steps relaxed by Aitken's rule."""
        # the training range at the training scale joined with the same numbers at the shot's, and MARGIN more
        shift = self.for_shot(np.zeros(len(self.low)))  # what 10^0 at the training scale is for the shot
        low, high = np.minimum(self.low, self.low - shift) - MARGIN, np.maximum(self.high, self.high - shift) + MARGIN
        theta = np.clip(self.model(self.completed())[0], low, high)
        stretch: float | None = None
        before: Floats | None = None
        relaxation, size, nearest = 1.0, np.inf, 0
        for turn in range(ITERATIONS):
            last, stretch = stretch, self._stretch(theta, stretch)
            settled = last is not None and abs(np.log(stretch / last)) < STRETCH_SETTLED
            simulated = self._simulated(theta, stretch)
            measured = self.completed(simulated)
            both = self.model(np.concatenate([measured, simulated]))
            read = both[: len(measured)].mean(axis=0)
            difference = read - both[len(measured) :].mean(axis=0)
            apart = float(np.max(np.abs(difference)))
            if apart < max(size, CONVERGED) or not turn:  # among converged ones the last: its stretch is the best
                nearest, size, best = turn, apart, (read, theta, stretch)
            if (apart < CONVERGED and settled) or turn - nearest > PATIENCE:
                break
            if before is not None:
                change = difference - before
                relaxation = float(np.clip(-relaxation * (before @ change) / (change @ change + 1e-12), 0.2, 1.2))
            before = difference
            step = np.clip(relaxation * difference, -LARGEST_STEP, LARGEST_STEP)
            theta = np.clip(theta + step, low, high)
        if size > 4 * CONVERGED:
            told = "no parameters make the network see the simulation as it sees the measurement"
            self.messages.append(f"{told} (nearest: {size:.2g} decades apart)")
        return best

    def _simulated(self, theta: Floats, stretch: float) -> Floats:
        """(k, frames) R/R_max at the true R_max on the grid by way of the camera's frames, each with another draw of
        the measurement's noise: the network takes noise for a weaker damping, in both alike."""
        grid = self.step * np.arange(self.frames)
        beyond = grid[grid > self.seen[-1]]
        times = np.concatenate([[0.0], self.seen, beyond])
        run = simulate(
            self._material(theta), max_radius=self.max_radius, stretch=stretch, time=times,
            medium=self.medium, **ROUGH,  # the network sees no more
        )  # fmt: skip
        radius = np.tile(run.radius, (NOISE_DRAWS, 1))
        radius[:, 1 : 1 + len(self.seen)] += self.noise
        radius[radius <= 0] = np.nan
        curves = [RadiusCurve(times, row, maximum=(0.0, self.max_radius)) for row in radius]
        return np.array([curve.resampled(self.step, self.frames) / self.max_radius for curve in curves])

    def _stretch(self, theta: Floats, near: float | None) -> float:
        return self.settings.stretch or fit_stretch(self.view, self._material(theta), self.medium, near)

    def _natural(self, theta: Floats) -> dict[str, float]:
        """SI values for the shot."""
        return self.problem.to_shot(natural_values(self.model.outputs, theta), self.max_radius, self.medium)

    def _material(self, theta: Floats) -> Material:
        return MATERIALS[self.problem.material_name](**self._natural(theta))

    def _checks(self, theta: Floats, stretch: float) -> Checks:
        outside = [
            f"{natural_name(name)} (at the training scale 10^{value:.2f}, trained in 10^{a:g} to 10^{b:g})"
            for name, value, a, b in zip(self.model.outputs, theta, self.low, self.high, strict=True)
            if not a - 0.02 <= value <= b + 0.02
        ]
        a, b = self.problem.prior.bounds("stretch")
        if not 0.97 * a <= stretch <= 1.03 * b:
            outside.append(f"stretch {stretch:.3g} (trained in {a:g} to {b:g})")
        verdict: Verdict = "outside_training_range" if outside else "ok"
        messages = ["outside the training range: " + ", ".join(outside)] if outside else []
        softer = [a - value for n, value, a in zip(self.model.outputs, theta, self.low, strict=True) if MODULUS in n]
        messages += [LIQUID] if any(by > 0.02 for by in softer) else []
        messages += self.messages
        if self.missing.any():
            messages.append(
                f"{np.count_nonzero(self.missing)} of the network's {self.frames} samples lie after the recording's "
                f"end and were taken from the simulation of the answer itself"
            )
        found = reconstruct(self.view, self._material(theta), self.medium, stretch)
        messages += [ELASTIC] if found.rmse > MISFIT and not softer else []
        return found.checks(self.view, self.time_scale, verdict, messages)
