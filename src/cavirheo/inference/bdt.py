"""The paper's networks as the paper uses them: a value read off the curve at equal Cauchy and Reynolds numbers.

The network knows one R_max, medium and grid of times (TrainingProblem.to_shot carries its answer over). That is not
enough: surface tension, heat and mass transfer do not scale, and a 60 um bubble read as a 245 um one looks 0.3 to 0.4
decades too viscous (docs/method/physics.md, section 1), so other sizes are outside the network's range. The stretch,
which it does not give, is fitted, and the simulation of the answer is compared with the curve. The posterior network
(network_answer.py) knows all sizes.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, expect_whole, require
from cavirheo.inference import input_checks
from cavirheo.inference.model import Network
from cavirheo.inference.reconstruct import MISFIT, check_stretch, fit_stretch, reconstruct, window
from cavirheo.messages import Message
from cavirheo.parameters import natural, natural_name, scaled, units
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Checks, Diagnostics, Posterior, Verdict
from cavirheo.problem import natural_values

MODULUS = "shear_modulus"
SHORTEST = 0.9  # of the network's samples that must lie inside the recording; the others are taken as the last one
SIZES = (0.73, 1.35)  # R_max over that of the training, where log10 mu is off by 0.03 or less (docs/reproduction.md)


@dataclass(frozen=True)
class Amortised:
    """Estimator: a network and the settings of the shot. `stretch` None is fitted; `collapses` limits the window of
    the check and of the stretch (the network always reads its own); with `trust_input` warnings decide no verdict."""

    model: Network
    medium: Medium = WATER
    stretch: float | None = None
    collapses: int | None = None
    trust_input: bool = False

    def __post_init__(self) -> None:
        """Raises InputError: a model that does not answer its law, or a setting out of its domain."""
        needed, outputs = set(self.model.problem.prior.names) - {"stretch"}, ", ".join(self.model.outputs)
        message = f"the model {self.model.name} answers only {outputs}; its law needs {', '.join(sorted(needed))}"
        require(needed == {*self.model.outputs}, message, "model.outputs")
        check_stretch(self.stretch)
        if self.collapses is not None:
            expect_whole(self.collapses, "collapses in the window", 1, "option.window")

    def infer(self, curve: RadiusCurve) -> Posterior:
        """The answer for one curve; one that cannot be answered gives a failed Posterior with the reason."""
        start, names, problem = time.perf_counter(), self.model.outputs, self.model.problem
        fields: dict[str, Any] = {}
        try:
            theta, checks, fields = _NetworkReading(self, curve).answer()
            checks = input_checks.warned(checks, self._warnings(curve), self.trust_input)
        except input_checks.ERRORS as error:  # of this curve alone
            theta, checks = np.empty((0, len(names))), input_checks.failed(error, curve, self.medium)
        provenance = {
            "cavirheo": version("cavirheo"),
            "model": self.model.name,
            "model_sha256": self.model.sha256,
            "problem_id": problem.id,
            "source_sha256": curve.source_sha256,
        } | fields.pop("provenance", {})
        fields |= {"medium": self.medium, "seconds": time.perf_counter() - start}
        return Posterior(names, units(names), theta, checks, problem.material_name, "bdt", provenance, **fields)

    def _warnings(self, curve: RadiusCurve) -> list[Message]:
        messages, names = input_checks.plain(curve, self.medium), self.model.outputs
        if spiking := input_checks.without_spikes(curve):
            frames, without = spiking
            with suppress(InputError):  # read so it is no curve: nothing to compare
                change = self.network_only(without) - self.network_only(curve)
                factors = {natural_name(name): 10.0**d for name, d in zip(names, change, strict=True)}
                messages += input_checks.moved(frames, factors)
        return messages

    def network_only(self, curve: RadiusCurve) -> Floats:
        """(outputs,) for the shot, in the prior's scale: what the network reads off the curve at equal Cauchy and
        Reynolds numbers. Raises InputError: the curve cannot be put on the network's grid."""
        return _NetworkReading(self, curve).for_shot()


class _NetworkReading:
    """What the network reads off one curve. theta: (outputs,) in the prior's scale, for the reference scale."""

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
            needed = f"{read_until * 1e6:.4g} us (t* = {read_until / self.time_scale:.2f})"
            message = f"the recording ends {end * 1e6:.4g} us after R_max; the model reads {needed}"
            raise InputError(f"{message} and needs at least {SHORTEST:.0%} of them", "amortised.too_short", curve.name)
        self.view = window(curve, collapses=settings.collapses, end=read_until)
        self.low, self.high = np.transpose([self.problem.prior.bounds(name) for name in self.model.outputs])
        self.theta = self.model(np.where(self.missing, self.features[~self.missing][-1], self.features)[None])[0]

    def answer(self) -> tuple[Floats, Checks, dict[str, Any]]:
        """theta (1, outputs) of the shot, its checks, and further fields of its Posterior."""
        draw = self.for_shot()
        stretch = self.settings.stretch or fit_stretch(self.view, self._material(), self.medium)
        pairs = zip(self.model.outputs, draw, strict=True)
        best = {natural_name(name): float(natural(name, value)) for name, value in pairs} | {"stretch": stretch}
        source = "given" if self.settings.stretch else "fitted to the curve with the G and mu of the answer"
        provenance = {"stretch": stretch, "stretch_source": source}
        diagnostics = Diagnostics(stretch_source=source)
        fields = {"best": best, "stretch": stretch, "diagnostics": diagnostics, "provenance": provenance}
        return draw[None, :], self._checks(stretch), fields

    def for_shot(self) -> Floats:
        """(outputs,) in the prior's scale for the shot."""
        values = zip(self.model.outputs, self._natural().values(), strict=True)
        return np.array([scaled(name, value) for name, value in values])

    def _natural(self) -> dict[str, float]:
        """SI values for the shot."""
        return self.problem.to_shot(natural_values(self.model.outputs, self.theta), self.max_radius, self.medium)

    def _material(self) -> Material:
        return MATERIALS[self.problem.material_name](**self._natural())

    def _checks(self, stretch: float) -> Checks:
        read = list(zip(map(natural_name, self.model.outputs), self.theta, self.low, self.high, strict=True))
        messages = [self._outside(*row) for row in read if not row[2] - 0.02 <= row[1] <= row[3] + 0.02]
        a, b = self.problem.prior.bounds("stretch")
        if not 0.97 * a <= stretch <= 1.03 * b:
            messages.append(self._outside("stretch", stretch, a, b))
        trained_at = self.problem.reference_max_radius
        low, high = (trained_at * end for end in SIZES)
        if not low <= self.max_radius <= high:
            messages.append(self._outside("max_radius", self.max_radius, low, high, trained_at=trained_at))
        verdict: Verdict = "outside_training_range" if messages else "ok"
        softer = [low - value for name, value, low, _ in read if name == MODULUS]
        if any(by > 0.02 for by in softer):
            messages.append(Message("network.liquid"))
        if self.missing.any():
            missing = int(np.count_nonzero(self.missing))
            messages.append(Message("network.cut_short", {"missing": missing, "samples": self.frames}))
        simulated = reconstruct(self.view, self._material(), self.medium, stretch)
        if simulated.rmse > MISFIT and not softer:
            messages.append(Message("network.elastic"))
        return simulated.checks(self.view, self.time_scale, verdict, messages)

    @staticmethod
    def _outside(name: str, value: float, low: float, high: float, **more: float) -> Message:
        """A value outside the range of the training; of the law's parameters log10 at the training scale."""
        numbers = {"value": float(value), "low": float(low), "high": float(high)}
        return Message(f"training_range.{name}", {"name": name, **numbers, **more})
