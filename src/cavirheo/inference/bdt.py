"""The paper's networks as the paper uses them: a value read off the curve at equal Cauchy and Reynolds numbers.

The network knows one R_max, medium and grid of times (TrainingProblem.to_shot carries its answer over). That is not
enough: surface tension, heat and mass transfer do not scale, and a 60 um bubble read as a 245 um one looks 0.3 to 0.4
decades too viscous (docs/method/physics.md, section 1), so other sizes are outside the network's range. The stretch,
which it does not give, is fitted, and the simulation of the answer is compared with the curve. The posterior network
(network_answer.py) knows all sizes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, expect_whole, require
from cavirheo.inference import input_checks
from cavirheo.inference.model import Network
from cavirheo.inference.reconstruct import MISFIT, check_stretch, fit_stretch, reconstruct, window
from cavirheo.messages import Message
from cavirheo.parameters import natural, natural_name, scaled
from cavirheo.physics.bubble import FIELD
from cavirheo.physics.materials import MATERIALS
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Diagnostics, Posterior, Verdict
from cavirheo.prior import natural_values

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
        model, problem = self.model, self.model.problem
        network: Any = {"model": model.name, "model_sha256": model.sha256, "problem_id": problem.id}
        model_of_medium = problem.material_name, "bdt", FIELD, self.medium
        empty = input_checks.empty_answer(curve, model.outputs, *model_of_medium, **network)
        return input_checks.answer_of(curve, empty, self._answer, self.trust_input)

    def network_only(self, curve: RadiusCurve) -> Floats:
        """(outputs,) for the shot, in the prior's scale: what the network reads off the curve at equal Cauchy and
        Reynolds numbers. Raises InputError: the curve cannot be put on the network's grid."""
        return self._read(curve).for_shot

    def _read(self, curve: RadiusCurve) -> _NetworkOutput:
        model, problem, top = self.model, self.model.problem, curve.max_radius
        step, frames = problem.grid_step(top, self.medium), problem.grid.frames
        end, scale = step * (frames - 1), self.medium.time_scale(top)
        features = curve.resampled(step, frames, allow_short=True) / top
        measured = ~np.isnan(features)
        if np.count_nonzero(measured) < SHORTEST * frames:
            last = curve.time[np.isfinite(curve.radius)][-1] - curve.time_of_max
            message = f"the recording ends {last * 1e6:.4g} us after R_max; the model reads {end * 1e6:.4g} us (t* = "
            message += f"{end / scale:.2f}) and needs at least {SHORTEST:.0%} of them"
            raise InputError(message, "amortised.too_short", curve.name)
        theta = model(np.where(measured, features, features[measured][-1])[None])[0]
        values = problem.to_shot(natural_values(model.outputs, theta), top, self.medium)
        for_shot = np.array([scaled(name, value) for name, value in zip(model.outputs, values.values(), strict=True)])
        return _NetworkOutput(theta, values, for_shot, end, int(np.count_nonzero(~measured)))

    def _answer(self, curve: RadiusCurve) -> tuple[dict[str, Any], list[Message]]:
        """Fields of the Posterior, and further input warnings."""
        read, problem, outputs = self._read(curve), self.model.problem, self.model.outputs
        view = window(curve, collapses=self.collapses, end=read.end)
        material, scale = MATERIALS[problem.material_name](**read.values), self.medium.time_scale(curve.max_radius)
        stretch = self.stretch or fit_stretch(view, material, self.medium)
        simulated = reconstruct(view, material, self.medium, stretch)
        ranges = {name: problem.prior.bounds(name) for name in outputs}
        messages = [
            _outside(natural_name(name), value, low, high)
            for (name, (low, high)), value in zip(ranges.items(), read.theta, strict=True)
            if not low - 0.02 <= value <= high + 0.02
        ]
        low, high = problem.prior.bounds("stretch")
        if not 0.97 * low <= stretch <= 1.03 * high:
            messages.append(_outside("stretch", stretch, low, high))
        trained_at = problem.reference_max_radius
        low, high = (trained_at * end for end in SIZES)
        if not low <= curve.max_radius <= high:
            messages.append(_outside("max_radius", curve.max_radius, low, high, trained_at=trained_at))
        verdict: Verdict = "outside_training_range" if messages else "ok"
        modulus = next((name for name in outputs if natural_name(name) == MODULUS), None)
        if modulus and ranges[modulus][0] - read.theta[outputs.index(modulus)] > 0.02:
            messages.append(Message("network.liquid"))
        if read.missing:
            messages.append(Message("network.cut_short", {"missing": read.missing, "samples": problem.grid.frames}))
        if simulated.rmse > MISFIT and not modulus:
            messages.append(Message("network.elastic"))
        source = "given" if self.stretch else "fitted to the curve with the G and mu of the answer"
        best = {natural_name(name): float(natural(name, x)) for name, x in zip(outputs, read.for_shot, strict=True)}
        fields = {
            "theta": read.for_shot[None],
            "checks": simulated.checks(view, scale, verdict, messages),
            "best": best | {"stretch": stretch},
            "stretch": stretch,
            "diagnostics": Diagnostics(stretch_source=source),
            "provenance": {"stretch": stretch, "stretch_source": source},
        }
        return fields, input_checks.spike_warnings(curve, outputs, self.network_only, read.for_shot)


class _NetworkOutput(NamedTuple):
    """What a network reads off one curve: theta (outputs,) in the prior's scale, for the reference scale; for the shot
    values, SI, and `for_shot` (outputs,) in the prior's scale; end: s after R_max; missing: samples after the last."""

    theta: Floats
    values: dict[str, float]
    for_shot: Floats
    end: float
    missing: int


def _outside(name: str, value: float, low: float, high: float, **more: float) -> Message:
    """A value outside the range of the training; of the law's parameters log10 at the training scale."""
    numbers = {"value": float(value), "low": float(low), "high": float(high)}
    return Message(f"training_range.{name}", {"name": name, **numbers, **more})
