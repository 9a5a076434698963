"""The paper's two networks, the Bubble Dynamics Transformers (Bu et al. 2025, arXiv:2506.11936), and their answers.

A network gives one value for each parameter, without an interval; its layers are described where it is trained
(training/networks.py). It is used as the paper uses it: a value is read off the curve at equal Cauchy and Reynolds
numbers (`TrainingProblem.to_shot`). This is not exact: surface tension, heat and mass transfer do not scale, and a
60 um bubble read as a 245 um one looks 0.3 to 0.4 decades too viscous (docs/method/physics.md, section 1). Other sizes
are therefore outside the network's range. The stretch is not an output of these networks; it is fitted.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.emulator import Bubbles, Camera, emulator
from cavirheo.inference.experiment import MISFIT, Experiment
from cavirheo.inference.network_files import (
    Arrays,
    Layers,
    ModelCard,
    TrainingProblem,
    card,
    natural_values,
    path_of,
    read_weights,
)
from cavirheo.messages import Message
from cavirheo.parameters import LOG10, STRETCH_RANGE, natural_name, to_natural, to_prior_scale
from cavirheo.physics.bubble import FIELD
from cavirheo.physics.materials import MATERIALS, Material

MODULUS = "shear_modulus"
MIN_SAMPLES = 0.9  # least share of the network's samples inside the recording; the others repeat the last one
SIZE_RANGE = (0.73, 1.35)  # R_max over that of the training, error of log10 mu up to 0.03 (docs/reproduction.md)
ATTENTION = 2_000_000  # numbers in the attention weights of the curves that are computed together
STRETCHES = 500  # that are compared, 0.7 % apart


class Network:
    """A network that reads R/R_max on the grid of its training problem and gives values in the prior's scale.

    Attributes:
        problem: its training problem.
        outputs: names of its values.
        sha256: of its weights.

    Raises:
        InputError: the file or its card is missing, damaged, of another kind or of another network.
    """

    def __init__(self, path: Path) -> None:
        about = ModelCard.model_validate(card(path, "point"))
        self.path, self.name, self.sha256 = path, path.stem, about.weights.sha256
        self.problem: TrainingProblem = TrainingProblem.from_dict(about.problem)
        self.outputs: tuple[str, ...] = tuple(output.name for output in about.outputs)
        self._forward = Forward(about.network, len(about.outputs), read_weights(path, self.sha256))
        try:
            self._forward(np.ones((1, self.problem.frames)))
        except (KeyError, ValueError, IndexError) as error:
            message = f"{path} has other arrays than its card says ({error}): train it anew"
            raise InputError(message, "model.weights") from error

    def __call__(self, radius: ArrayLike) -> Floats:
        """Values (curves, outputs) in the prior's scale from R/R_max (curves, frames). Raises InputError: a value is
        not finite ("model.not_finite")."""
        theta = self._forward(np.asarray(radius, float))
        with np.errstate(over="ignore"):
            values = [to_natural(name, column) for name, column in zip(self.outputs, theta.T, strict=True)]
        if not (np.isfinite(theta).all() and np.isfinite(values).all()):
            message = f"the model {self.path} answers a curve with what is no number: train it anew"
            raise InputError(message, "model.not_finite")
        return theta


class Forward:
    """The layers of a network with so many outputs, from sizes of its layers and its arrays by name."""

    def __init__(self, size: Layers, outputs: int, arrays: Arrays) -> None:
        self.size, self.outputs = size, outputs
        self.arrays: dict[str, Floats] = {name: array.astype(float) for name, array in arrays.items()}

    def __call__(self, radius: Floats) -> Floats:
        """Values (curves, outputs) from R/R_max (curves, frames)."""
        at_once = max(ATTENTION // (self.size.heads * radius.shape[1] ** 2), 1)
        parts = [self._values(radius[i : i + at_once]) for i in range(0, len(radius), at_once)]
        return np.concatenate(parts) * self.arrays["std"] + self.arrays["mean"]

    def _values(self, radius: Floats) -> Floats:
        position = np.broadcast_to(self.arrays["position"], (len(radius), *self.arrays["position"].shape))
        x = self._dense("dense", np.concatenate([radius[..., None], position], axis=2))
        x = self._norm("norm", _softplus(x))  # (curves, frames, width)
        return np.hstack([self._branch(f"branches.{i}", x) for i in range(self.outputs)])

    def _branch(self, name: str, x: Floats) -> Floats:
        for i in range(self.size.layers):
            x = self._encoder(f"{name}.layers.{i}", x)
        return self._dense(f"{name}.output", _softplus(self._dense(f"{name}.dense", x.mean(axis=1))))

    def _encoder(self, name: str, x: Floats) -> Floats:
        curves, frames, _ = x.shape
        split = self._dense(f"{name}.query_key_value", x).reshape(curves, frames, 3, self.size.heads, -1)
        query, key, value = split.transpose(2, 0, 3, 1, 4)  # each (curves, heads, frames, head_width)
        score = query @ key.swapaxes(2, 3) / np.sqrt(key.shape[3])
        weight = np.exp(score - score.max(axis=3, keepdims=True))
        mixed = (weight / weight.sum(axis=3, keepdims=True)) @ value
        mixed = mixed.swapaxes(1, 2).reshape(curves, frames, -1)
        x = self._norm(f"{name}.norm_attention", x + self._dense(f"{name}.attended", mixed))
        hidden = _ACTIVATIONS[self.size.activation](self._dense(f"{name}.expand", x))
        return self._norm(f"{name}.norm_feed_forward", x + self._dense(f"{name}.contract", hidden))

    def _dense(self, name: str, x: Floats) -> Floats:
        return x @ self.arrays[f"{name}.weight"].T + self.arrays[f"{name}.bias"]

    def _norm(self, name: str, x: Floats) -> Floats:
        centred = x - x.mean(axis=-1, keepdims=True)
        deviation = np.sqrt(np.mean(centred**2, axis=-1, keepdims=True) + self.size.norm_epsilon)
        return centred / deviation * self.arrays[f"{name}.weight"] + self.arrays[f"{name}.bias"]


def _softplus(x: Floats) -> Floats:
    return np.logaddexp(x, 0.0)


_ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {"relu": lambda x: np.maximum(x, 0.0), "softplus": _softplus}


def network_of(name: str) -> Network:
    """The network of this name or place (`path_of`), read again if its file changes. Raises InputError."""
    path, state = path_of(name), tuple[int, ...]()
    with suppress(OSError):  # no file: `card` raises the error
        state = path.stat().st_mtime_ns, path.stat().st_size
    return _loaded(path, *state)


@lru_cache(maxsize=8)
def _loaded(path: Path, *_: int) -> Network:
    """The network in a file; its time and size are arguments, so that a changed file is read again."""
    return Network(path)


def shot_values(network: Network, shot: Experiment) -> tuple[Floats, dict[str, float], int]:
    """Values (outputs,) in the prior's scale for the reference R_max, values by name for the shot (SI) at equal Cauchy
    and Reynolds numbers, and the number of samples that the recording lacks. Frames that stand out are left out. Raises
    InputError: too few."""
    curve, medium, problem, top = shot.curve, shot.medium, network.problem, shot.max_radius
    step, frames = problem.grid_step(top, medium), problem.frames
    radius = curve.radius.copy()
    radius[curve.spikes()] = np.nan
    features = replace(curve, radius=radius).resampled(step, frames) / top
    measured = ~np.isnan(features)
    if np.count_nonzero(measured) < MIN_SAMPLES * frames:
        end = step * (frames - 1)
        last = curve.time[np.isfinite(curve.radius)][-1] - curve.time_of_max
        message = f"the recording ends {last * 1e6:.4g} us after R_max; the model reads {end * 1e6:.4g} us (t* = "
        message += f"{end / medium.time_scale(top):.2f}) and needs at least {MIN_SAMPLES:.0%} of them"
        raise InputError(message, "network.too_short", curve.name)
    theta = network(np.where(measured, features, features[measured][-1])[None])[0]
    values = problem.to_shot(natural_values(network.outputs, theta), top, medium)
    return theta, values, int(np.count_nonzero(~measured))


def read_values(shot: Experiment, network: Network) -> dict[str, Any]:
    """The fields of a Posterior, with checks and verdict, from a network of one value. The stretch, if not given, is
    fitted to the window of the shot."""
    problem, outputs = network.problem, network.outputs
    theta, values, missing = shot_values(network, shot)
    material = MATERIALS[problem.material_name](**values)
    stretch = shot.stretch or fit_stretch(shot, material)
    messages = list[Message]()
    for name, value in zip(outputs, theta.tolist(), strict=True):
        messages += _outside(natural_name(name), value, *problem.prior.bounds(name), 0.02)
    messages += _outside("stretch", stretch, *problem.prior.bounds("stretch"), 0.2)
    trained = problem.reference_max_radius
    low, high = (trained * end for end in SIZE_RANGE)
    messages += _outside("max_radius", shot.max_radius, low, high, 0.0, trained_at=trained)
    modulus = LOG10 + MODULUS in outputs
    if modulus and problem.prior.bounds(LOG10 + MODULUS)[0] - theta[outputs.index(LOG10 + MODULUS)] > 0.02:
        messages.append(Message("network.liquid"))
    if spikes := len(shot.curve.spikes()):
        messages.append(Message("frames.spikes", {"frames": spikes}))
    if missing:
        messages.append(Message("network.cut_short", {"missing": missing, "samples": problem.frames}))
    natural = {"stretch": stretch, "time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}
    checks = shot.checks_of(material, FIELD, natural, "unverified", messages)
    if not modulus and (checks.rmse_over_rmax or 0.0) > MISFIT:
        checks = replace(checks, messages=(*checks.messages, Message("network.elastic")))
    return {
        "theta": np.array([[to_prior_scale(name, values[natural_name(name)]) for name in outputs]]),
        "checks": checks,
        "best": values | {"stretch": stretch},
        "stretch": stretch,
    }


def _outside(name: str, value: float, low: float, high: float, slack: float, **more: float) -> list[Message]:
    """A message if a value is outside the range of the training; the law's are log10 at the reference R_max."""
    numbers = {"value": float(value), "low": float(low), "high": float(high)}
    inside = low - slack <= value <= high + slack
    return [] if inside else [Message(f"training_range.{name}", {"name": name, **numbers, **more})]


def fit_stretch(shot: Experiment, material: Material) -> float:
    """The stretch R_max/R_0 with the smallest RMSE, of the whole range, by the emulator: a rebound may slip by a
    period. Raises SolverError: there is no such bubble at any stretch."""
    stretches, whole = np.geomspace(*STRETCH_RANGE, STRETCHES), np.ones(STRETCHES)
    nothing, size, at_equilibrium = 0.0 * whole, shot.max_radius * whole, np.inf * whole
    walls = nothing, nothing, nothing  # damping, inertia, vapour above saturation
    bubbles = Bubbles(material, shot.medium, size, stretches, at_equilibrium, *walls, whole, whole)
    sharp = Camera(shot.time_since_max[shot.counted], np.zeros(1), np.ones(1), nothing)
    errors = np.mean((emulator().radius(bubbles, sharp) - shot.measured[shot.counted]) ** 2, axis=1)
    if not np.isfinite(errors).any():
        raise SolverError(f"there is no bubble of {material} at any stretch in {STRETCH_RANGE}")
    return float(stretches[np.nanargmin(errors)])
