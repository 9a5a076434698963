"""A posterior network answers: draws of the parameters with their density, for any recording, in milliseconds.

The network (training/posterior) reads the frames of an experiment's window, whatever the camera, and gives the density
of the slots (slots.py) one after the other, each a mixture of Gaussians given those before it. It was trained in
water; in another medium the same Cauchy and Reynolds numbers make nearly the same curve:

    G = G_water p/p_water,   mu = mu_water (p t_c)/(p t_c)_water,   t_c at the shot's R_max.

Its draws are a proposal: what they are worth the simulations say (inference/verify).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.inference.cells import SCALE, cells, half_widths
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.session import started
from cavirheo.inference.slots import SLOTS, from_slots, slot, to_slots, used
from cavirheo.physics.media import WATER
from cavirheo.prior import Prior, log_normal

_POOL, _LEAST = 1000, 0.01  # draws by which the share within the bounds is found, and the smallest share
INPUTS = ("cells", "kind", "has", "choice", "normal", "given", "take")
_PRESSURE = ("shear_modulus",)  # what scales with p, and what with p t_c
_PRESSURE_TIME = ("viscosity", "consistency")


class Flow:
    """The densities of an .onnx file. kinds: (law, contents) that it knows, in its order."""

    def __init__(self, content: bytes, kinds: list[tuple[str, str]]) -> None:
        self.session: Any = started(content)
        self.kinds: list[tuple[str, str]] = [(plain(law), contents) for law, contents in kinds]
        self.parts: int = next(int(given.shape[2]) for given in self.session.get_inputs() if given.name == "choice")

    def sample(self, inputs: Any, kind: int, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Draws z (count, 8), 0 in slots that the kind has not, and their log density (count,)."""
        choice = rng.gumbel(size=(count, len(SLOTS), self.parts))
        return self._run(inputs, kind, choice, rng.standard_normal((count, len(SLOTS))), 0.0)

    def log_density(self, inputs: Any, kind: int, z: Floats) -> Floats:
        """(draws,) of z (draws, 8)."""
        return self._run(inputs, kind, np.zeros((len(z), len(SLOTS), self.parts)), z, 1.0)[1]

    def _run(self, inputs: Any, kind: int, choice: Floats, z: Floats, take: float) -> tuple[Floats, Floats]:
        one, has = np.zeros((1, len(self.kinds)), np.float32), np.zeros(len(SLOTS), np.float32)
        one[0, kind], has[used(*self.kinds[kind])] = 1.0, 1.0
        of_draws = {"choice": choice, "normal": z, "given": z, "take": np.array([take])}
        feed = {"cells": inputs, "kind": one, "has": has}
        feed |= {name: values.astype(np.float32) for name, values in of_draws.items()}
        found, log_density, _ = self.session.run(None, feed)
        return found.astype(float), log_density.astype(float)


class NetworkProposal:
    """What a network answers for one experiment, in the coordinates u of its prior (prior.py): it can be drawn from,
    and its density is normalised. Raises InputError: hardly anything of it is within the prior's bounds."""

    def __init__(self, flow: Flow, shot: Experiment, prior: Prior, *, discrepancy: bool) -> None:
        self.flow: Flow = flow
        self.shot: Experiment = shot
        self.prior: Prior = prior
        wanted = plain(shot.family.name), shot.options.bubble.contents
        self.kind: int = flow.kinds.index(wanted)
        self.names: tuple[str, ...] = (*shot.family.parameters, *shot.logs)
        frame, noise = shot.frame / shot.time_scale, shot.curve.noise / shot.max_radius
        self.inputs: Any = read(shot, discrepancy)
        width_t, width_r = half_widths(np.array(frame), np.array(noise))
        camera = {
            "max_radius_factor": (1.0, float(width_r) / 3.0), "time_origin": (0.0, float(width_t) * shot.time_scale),
            "radius_scale": (1.0, SCALE),
        }  # fmt: skip
        # column of x, slot, and (middle, width) of x over z, of each that is free
        self.camera: list[tuple[int, int, float, float]] = []
        for name, (middle, width) in camera.items():
            if name in shot.free:
                own_middle, own_width, _ = shot.free[name]
                place = shot.names.index(name), slot(name)
                self.camera.append((*place, (middle - own_middle) / own_width, width / own_width))
        pressure = shot.medium.pressure / WATER.pressure
        times = shot.time_scale / WATER.time_scale(shot.max_radius)
        factors = dict.fromkeys(_PRESSURE, pressure) | dict.fromkeys(_PRESSURE_TIME, pressure * times)
        self.shift: Floats = np.log10([factors.get(name, 1.0) for name in self.names])
        self.log_share: float = 0.0
        inside = self._drawn(_POOL, np.random.Generator(np.random.Philox(0)))
        told = f"{shot.curve.name}: hardly any of the network's draws is within the ranges of the parameters"
        require(len(inside) > _LEAST * _POOL, told, "network.outside")
        self.log_share = float(np.log(len(inside) / _POOL))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d)"""
        found = np.empty((0, len(self.prior.names)))
        while len(found) < count:
            found = np.concatenate([found, self._drawn(count, rng)])
        return found[:count]

    def log_density(self, u: Floats) -> Floats:
        """(k,) at u (k, d)."""
        x = self.prior.to_x(u)
        z = to_slots(self.names, x[:, : len(self.names)] - self.shift)
        log_q = from_slots(self.names, z)[1]
        for column, place, middle, width in self.camera:
            z[:, place] = (x[:, column] - middle) / width
            log_q = log_q - np.log(width)
        log_q += self.flow.log_density(self.inputs, self.kind, z) - self.log_share
        return np.asarray(log_q + log_normal(u) - self.prior.log_density(x))

    def _drawn(self, count: int, rng: np.random.Generator) -> Floats:
        """Those of `count` draws that are within the bounds, (k, d)."""
        z, _ = self.flow.sample(self.inputs, self.kind, count, rng)
        x = np.zeros((count, len(self.shot.names)))
        x[:, : len(self.names)] = from_slots(self.names, z)[0] + self.shift
        for column, place, middle, width in self.camera:
            x[:, column] = middle + width * z[:, place]
        inside = np.all((x > self.prior.low) & (x < self.prior.high), axis=1)
        u = self.prior.to_u(x[inside])
        return u[np.isfinite(u).all(axis=1)]


def plain(material: str) -> str:
    """The name of a law or of a sum of laws, however it is spaced."""
    return material.replace(" ", "")


def read(shot: Experiment, discrepancy: bool) -> Any:
    """(1, SIZE) what the network reads of the frames of an experiment that count."""
    counted = shot.counted & (shot.since >= 0)
    time = shot.since[counted] / shot.time_scale
    about = {
        "max_radius": shot.max_radius, "frame": shot.frame / shot.time_scale,
        "exposure": shot.exposure / shot.time_scale,
        "noise": shot.curve.noise / shot.max_radius, "discrepancy": float(discrepancy),
    }  # fmt: skip
    given = {name: np.array([value]) for name, value in about.items()}
    return cells(np.zeros(len(time), np.int64), time, shot.measured[counted], **given)
