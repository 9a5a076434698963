"""A posterior network answers: draws of the parameters with their density, for any recording, in milliseconds.

The network (training/networks.py) reads the frames of an experiment's window, whatever the camera, and gives
the density of the coordinates (latent.py) one by one, each a mixture of Gaussians given those before it. It was
trained in water; in another medium the same Cauchy and Reynolds numbers make nearly the same curve:

    G = G_water p/p_water,   mu = mu_water (p t_c)/(p t_c)_water,   t_c at the shot's R_max.

A parameter that is not inferred (a stated stretch, an accommodation that is given, a clock that is exact) keeps its
coordinate at its value: those after it are answered given it, and those before it as if it were free.

Its draws are a proposal: what they are worth the simulations say (inference/verify). A network ships with the package
or is one that a user trained: an .onnx file and the card beside it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.inference.bins import SCALE, binned
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.latent import COORDINATES, damping_to_latent, from_latent, to_latent, used, z_index
from cavirheo.inference.model import DEFAULT, Network, PosteriorCard, card, checked_content, path_of
from cavirheo.inference.session import started
from cavirheo.physics.bubble import FIELD, FREE, Bubble
from cavirheo.physics.media import WATER
from cavirheo.prior import Prior

_POOL, _LEAST = 1000, 0.01  # draws by which the share within the bounds is found, and the smallest share
KNOWN_BUBBLES = "the real and the field's bubble, without damage, confinement inertia or excess of vapour"
INPUTS = ("cells", "kind", "has", "counted", "choice", "normal", "given", "take")
_PRESSURE = ("shear_modulus",)  # what scales with p, and what with p t_c
_PRESSURE_TIME = ("viscosity", "reference_viscosity")
_MARGIN = 0.1  # of a constant that all its curves share: the weights allow for no more
_VAPOUR, _OF_VAPOUR = 2.0, ("vapour_reference_pressure", "vapour_reference_temperature")  # from 14 to 37 degrees C


class NetworkProposal:
    """What a network answers for one experiment, in the coordinates u of its prior (prior.py): it can be drawn from,
    and its density is normalised. Raises InputError: hardly anything of it is within the prior's bounds."""

    def __init__(self, model: PosteriorModel, shot: Experiment, prior: Prior, *, discrepancy: bool) -> None:
        self.model: PosteriorModel = model
        self.shot: Experiment = shot
        self.prior: Prior = prior
        bubble = kind_of(shot.options.bubble)
        require(bubble != "", "the network does not know this bubble", "network.outside")
        self.kind: int = model.kinds.index((plain(shot.family.name), bubble))
        self.names: tuple[str, ...] = (*shot.family.parameters, *shot.logs)
        self.inputs: Any = read(shot, discrepancy)
        width_t, width_r = shot.usual_half_widths
        camera = {"max_radius_factor": (1.0, width_r / 3.0), "time_origin": (0.0, width_t * shot.time_scale)}
        camera |= {"radius_scale": (1.0, SCALE)}
        # column of x, index of z, and (middle, width) of x over z, of each that is free
        self.camera: list[tuple[int, int, float, float]] = []
        self.fixed: dict[int, float] = {}
        # free, but integrated out: they come last, so that the density of the others is that without them
        self.integrated: list[int] = []
        for name, (middle, width) in camera.items():
            if name not in shot.free:
                self.fixed[z_index(name)] = 0.0
            elif name not in prior.names:
                self.integrated.append(z_index(name))
            else:
                own_middle, own_width, _ = shot.free[name]
                place = prior.names.index(name), z_index(name)
                self.camera.append((*place, (middle - own_middle) / own_width, width / own_width))
        for name, value in (("accommodation", shot.bubble.get("accommodation")), ("stretch", shot.stretch)):
            if value:
                self.fixed[z_index(name)] = float(to_latent((name,), np.log10([[value]]))[0, z_index(name)])
        self.damping: int | None = None  # its column
        if "confinement_damping" in prior.names:
            self.damping = prior.names.index("confinement_damping")
        elif bubble == "real":
            damping = shot.bubble.get("confinement_damping", 0.0)
            self.fixed[z_index("confinement_damping")] = damping_to_latent(damping)
        pressure = shot.medium.pressure / WATER.pressure
        times = shot.time_scale / WATER.time_scale(shot.max_radius)
        factors = dict.fromkeys(_PRESSURE, pressure) | dict.fromkeys(_PRESSURE_TIME, pressure * times)
        self.shift: Floats = np.log10([factors.get(name, 1.0) for name in self.names])
        self.log_share: float = 0.0
        inside = self._within_bounds(_POOL, np.random.Generator(np.random.Philox(0)))
        message = "hardly any of the network's draws is within the ranges of the parameters"
        require(len(inside) > _LEAST * _POOL, message, "network.outside", shot.curve.name)
        self.log_share = float(np.log(len(inside) / _POOL))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d)"""
        u = np.empty((0, len(self.prior.names)))
        while len(u) < count:
            u = np.concatenate([u, self._within_bounds(count, rng)])
        return u[:count]

    def log_density(self, u: Floats) -> Floats:
        """(k,) at u (k, d)."""
        x = self.prior.to_x(u)
        z = to_latent(self.names, x[:, : len(self.names)] - self.shift)
        log_q = from_latent(self.names, z)[1]
        for column, place, middle, width in self.camera:
            z[:, place] = (x[:, column] - middle) / width
            log_q = log_q - np.log(width)
        by_x = np.ones(u.shape[1], dtype=bool)  # whether z is one of x; the damping's is its u
        if self.damping is not None:
            z[:, z_index("confinement_damping")], by_x[self.damping] = u[:, self.damping], False
        for place, value in self.fixed.items():
            z[:, place] = value
        log_q += self.model.log_density(self.inputs, self.kind, z, [*self.fixed, *self.integrated]) - self.log_share
        return np.asarray(log_q + np.sum(np.log(self.prior.slope(u))[:, by_x], axis=1))

    def _within_bounds(self, count: int, rng: np.random.Generator) -> Floats:
        """Those of `count` draws that are within the bounds, (k, d)."""
        z = self.model.sample(self.inputs, self.kind, count, rng, self.fixed)
        x = np.zeros((count, len(self.prior.names)))
        x[:, : len(self.names)] = from_latent(self.names, z)[0] + self.shift
        for column, place, middle, width in self.camera:
            x[:, column] = middle + width * z[:, place]
        inside = (x > self.prior.low) & (x < self.prior.high)
        u = self.prior.to_u(x)
        if self.damping is not None:
            u[:, self.damping], inside[:, self.damping] = z[:, z_index("confinement_damping")], True
        return u[inside.all(axis=1) & np.isfinite(u).all(axis=1)]


def kind_of(bubble: Bubble) -> str:
    """Which of the bubbles that a network knows (latent.BUBBLE_NAMES) this one is; empty: none of them."""
    if replace(bubble, accommodation=FREE, confinement_damping=0.0) == Bubble("kinetic"):
        return "real"
    return "field" if replace(bubble, accommodation=FREE) == FIELD else ""


def plain(material: str) -> str:
    """The name of a law or of a sum of laws, however it is spaced."""
    return material.replace(" ", "")


def read(shot: Experiment, discrepancy: bool) -> Any:
    """(1, SIZE) what the network reads of the frames of an experiment that count."""
    counted = shot.counted & (shot.since >= 0)
    time = shot.since[counted] / shot.time_scale
    numbers = {"max_radius": shot.max_radius, "noise": shot.curve.noise / shot.max_radius}
    numbers |= {"frame": shot.frame / shot.time_scale, "exposure": shot.exposure / shot.time_scale}
    numbers |= {"discrepancy": float(discrepancy), "late": float(shot.curve.begins_late)}
    arrays = {name: np.array([value]) for name, value in numbers.items()}
    return binned(np.zeros(len(time), np.int64), time, shot.measured[counted], **arrays)


class PosteriorModel:
    """A network that gives densities. name; card; sha256 of the .onnx file; kinds: (law, bubble) that it knows, in its
    order.

    Raises:
        InputError: the file or its card is missing, damaged or of another kind, or it is not the file of its card.
    """

    def __init__(self, path: Path) -> None:
        self.name: str = path.stem
        self.card: PosteriorCard = PosteriorCard.model_validate(card(path))
        self.sha256: str = self.card.onnx.sha256
        self.kinds: list[tuple[str, str]] = [(plain(law), bubble) for law, bubble in self.card.kinds]
        self.session: Any = started(checked_content(path, self.sha256, INPUTS))
        self.parts: int = next(int(tensor.shape[2]) for tensor in self.session.get_inputs() if tensor.name == "choice")

    def sample(
        self, inputs: Any, kind: int, count: int, rng: np.random.Generator, fixed: Mapping[int, float]
    ) -> Floats:
        """Draws z (count, 9), 0 where the kind has no such coordinate, and as given where it is `fixed`."""
        choice = rng.gumbel(size=(count, len(COORDINATES), self.parts))
        normal = rng.standard_normal((count, len(COORDINATES)))
        imposed, take = np.zeros((count, len(COORDINATES))), np.zeros(len(COORDINATES))
        for k, value in fixed.items():
            imposed[:, k], take[k] = value, 1.0
        return self._run(inputs, kind, np.zeros(len(COORDINATES)), choice, normal, imposed, take)[0]

    def log_density(self, inputs: Any, kind: int, z: Floats, without: Collection[int]) -> Floats:
        """(draws,) of z (draws, 9), each coordinate given those before it, without some."""
        counted = np.zeros(len(COORDINATES))
        counted[[k for k in used(*self.kinds[kind]) if k not in without]] = 1.0
        nothing = np.zeros((len(z), len(COORDINATES), self.parts))
        return self._run(inputs, kind, counted, nothing, z, z, np.ones(len(COORDINATES)))[1]

    def _run(
        self, inputs: Any, kind: int, counted: Floats, choice: Floats, normal: Floats, imposed: Floats, take: Floats
    ) -> tuple[Floats, Floats]:
        one_hot, has = np.zeros((1, len(self.kinds)), np.float32), np.zeros(len(COORDINATES), np.float32)
        one_hot[0, kind], has[used(*self.kinds[kind])] = 1.0, 1.0
        numbers = {"counted": counted, "choice": choice, "normal": normal, "given": imposed, "take": take}
        feed = {"cells": inputs, "kind": one_hot, "has": has}
        feed |= {name: values.astype(np.float32) for name, values in numbers.items()}
        z, log_density, _ = self.session.run(None, feed)
        return z.astype(float), log_density.astype(float)

    def knows(self, material: str, bubble: Bubble) -> bool:
        """Whether it was trained on this law and this bubble."""
        return (plain(material), kind_of(bubble)) in self.kinds

    def proposal(self, shot: Experiment, prior: Prior, discrepancy: bool) -> NetworkProposal:
        """Raises InputError: the experiment is outside the training."""
        outside = self.outside(shot)
        require(not outside, f"the network cannot read it: {outside}", "network.outside")
        return NetworkProposal(self, shot, prior, discrepancy=discrepancy)

    def outside(self, shot: Experiment) -> str:
        """What of an experiment is outside its training, in words; empty if all is inside."""
        bubble, trained = shot.options.bubble, self.card.trained
        if not kind_of(bubble):
            return f"it knows {KNOWN_BUBBLES}"
        if not self.knows(shot.family.name, bubble):
            return f"it was not trained on {shot.family.name} with the {kind_of(bubble)} bubble"
        frames = int((shot.counted & (shot.since >= 0)).sum())
        limited: dict[str, tuple[float, str]] = {
            "max_radius_um": (shot.max_radius * 1e6, "R_max of {:.4g} um"),
            "frame_interval_us": (shot.frame * 1e6, "{:.4g} us between frames"),
            "frames": (frames, "{:.0f} frames in the window"),
            "noise_over_rmax": (shot.curve.noise / shot.max_radius, "noise of {:.2g} of R_max"),
            "density": (shot.medium.density, "a density of {:.4g} kg/m3"),
            "pressure": (shot.medium.pressure, "a pressure of {:.4g} Pa"),
        }
        for name, (value, words) in limited.items():
            low, high = trained[name]
            if not low <= value <= high:
                return f"{words.format(value)} is outside its training ({low:g} to {high:g})"
        for constant in fields(WATER):
            if constant.name not in (*trained, "name", *_OF_VAPOUR):
                value, usual = getattr(shot.medium, constant.name), getattr(WATER, constant.name)
                if not abs(value - usual) <= _MARGIN * abs(usual):
                    return f"{constant.name} = {value:.4g} is more than {_MARGIN:.0%} from its training ({usual:.4g})"
        vapour, usual = shot.medium.vapour_pressure, WATER.vapour_pressure
        if not usual / _VAPOUR <= vapour <= usual * _VAPOUR:
            return f"a vapour pressure of {vapour:.4g} Pa is beyond twice or half of its training ({usual:.4g} Pa)"
        return ""


def network_of(name: str = DEFAULT) -> Network | PosteriorModel:
    """The shipped model of this name, or the one in a file whose name ends in .onnx, of either kind, as the file is
    now. Raises InputError."""
    path, state = path_of(name), tuple[int, ...]()
    with suppress(OSError):  # no file: its card says what is wrong
        state = path.stat().st_mtime_ns, path.stat().st_size
    return _loaded(path, *state)


@lru_cache(maxsize=8)
def _loaded(path: Path, *_: int) -> Network | PosteriorModel:
    """The model in a file of this time and size."""
    return Network(path) if card(path)["kind"] == "point" else PosteriorModel(path)


def describe(card: PosteriorCard) -> list[str]:
    """Lines of what the network knows, for `cavirheo models`."""
    laws: dict[str, list[str]] = {}
    for law, bubble in card.kinds:
        laws.setdefault(law, []).append(bubble)
    lines = [f"  {law}, bubble {' or '.join(bubbles)}" for law, bubbles in laws.items()]
    words: Any = {name: f"{low:g} to {high:g}" for name, (low, high) in card.trained.items()}
    inside = card.coverage.get("by_slot", {})
    coverage = ", ".join(f"{name.replace('_', ' ')} {share['90']:.0%}" for name, share in inside.items())
    lines += [f"  truth within its 90 % interval, without simulations: {coverage}"] if coverage else []
    return [*lines, f"  R_max {words['max_radius_um']} um, {words['frames']} frames of {words['frame_interval_us']} us"]
