"""A posterior network answers: draws of the parameters with their density, for any recording, in milliseconds.

It reads the frames of an experiment's window in bins of t* = t/t_c, whatever the camera (`binned`), and gives the
density of nine latent coordinates z that all its laws and bubbles share, one by one, each a mixture of Gaussians given
those before it: what may be known beforehand comes first. Each is standard normal under its prior. A parameter of a
law, the stretch and the accommodation have z = Phi^-1((log10 value - low)/(high - low)), low to high the range of a
search; two laws have one coordinate for what acts alike. The damping has the half of a normal. That of a power law's
reference viscosity is z = (log10 mu_ref + 1.5)/2. R_max, clock and scale are over the half-widths of their priors.

It was trained in water; in another medium the same Cauchy and Reynolds numbers make nearly the same curve:

    G = G_water p/p_water,   mu = mu_water (p t_c)/(p t_c)_water,   t_c at the shot's R_max.

A parameter that is not inferred (a stated stretch, an accommodation that is given, a clock that is exact) keeps its
coordinate at its value: those after it are answered given it, and those before it as if it were free. The draws are a
proposal: what they are worth the simulations say (inference/verify). A network ships with the package or is one that a
user trained: an .onnx file and the card beside it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.inference.assumptions import Family
from cavirheo.inference.experiment import LARGEST, ZETA, Experiment
from cavirheo.inference.model import DEFAULT, Network, PosteriorCard, card, checked_content, path_of
from cavirheo.inference.session import started
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.bubble import FIELD, FREE, Bubble
from cavirheo.physics.media import WATER
from cavirheo.prior import Prior

BINS, END = 192, 6.0  # of a recording as the network reads it, and t* at the end of the last one
CHANNELS, SCALARS = 7, 9  # numbers of each bin, and of the recording
SIZE = BINS * CHANNELS + SCALARS  # of the input
SCALE = 0.005  # standard deviation of the radius scale
CAMERA = ("max_radius_factor", "time_origin", "radius_scale")
COORDINATES = ("stretch", "confinement_damping", "accommodation", "viscosity", "shear_modulus", "shape", *CAMERA)
BUBBLE_NAMES = {"field": (), "real": ("confinement_damping", "accommodation")}  # beside those of all
_SHARED = {"reference_viscosity": "viscosity", "stiffening": "shape", "exponent": "shape"}
_REFERENCE = (-1.5, 2.0)  # mean and standard deviation of log10 of a reference viscosity
_FARTHEST = 3.0  # z of a given damping: training has one in a thousand beyond
_INSIDE = 1e-9  # of the probability, that z keeps away from the bounds
_POOL, _LEAST = 1000, 0.01  # draws by which the share within the bounds is found, and the smallest share
KNOWN_BUBBLES = "the real and the field's bubble, without damage, confinement inertia or excess of vapour"
INPUTS = ("cells", "kind", "has", "counted", "choice", "normal", "given", "take")
_MARGIN = 0.1  # of a constant that all its curves share: the weights allow for no more
_VAPOUR, _OF_VAPOUR = 2.0, ("vapour_reference_pressure", "vapour_reference_temperature")  # from 14 to 37 degrees C


def binned(
    sample: NDArray[np.int64],
    time: Floats,
    radius: Floats,
    *,
    max_radius: Floats,
    frame: Floats,
    exposure: Floats,
    noise: Floats,
    discrepancy: Floats,
    late: Floats,
) -> NDArray[np.float32]:
    """(m, SIZE) inputs of m recordings: of each bin the mean radius, mean time, count and scatter of its frames, and
    how radius and time go together; an empty one between frames is passed by a straight line. sample: (n,) to which
    recording a frame belongs. time: (n,) t* after R_max, ascending. radius: (n,) R/R_max. Of each recording, (m,):
    R_max in m, frame interval and exposure in t_c, noise over R_max, discrepancy (1 where more than white noise lies
    between frames and simulation), late (1 where no growth is recorded)."""
    m = len(max_radius)
    place = np.minimum(time * (BINS / END), BINS - 1e-9)
    inside = (time >= 0) & (time <= END)
    sample, place, radius = sample[inside], place[inside], radius[inside]
    bin_number = place.astype(np.int64)
    offset = (place - bin_number - 0.5).astype(float)
    at = sample * BINS + bin_number

    def summed(values: Floats | None = None) -> Floats:
        return np.bincount(at, values, m * BINS).reshape(m, BINS).astype(float)

    count = summed()
    filled = count > 0
    several = np.maximum(count, 1.0)
    mean, middle = summed(radius) / several, summed(np.asarray(offset)) / several
    together = np.where(count > 1, summed(radius * offset) / several - mean * middle, 0.0)
    spread = np.sqrt(np.maximum(summed(radius**2) / several - mean**2, 0.0))
    index = np.arange(BINS)
    before = np.maximum.accumulate(np.where(filled, index, -1), axis=1)
    after = np.minimum.accumulate(np.where(filled, index, BINS)[:, ::-1], axis=1)[:, ::-1]
    within = (before >= 0) & (after < BINS)
    rows = np.arange(m)[:, None]
    a, b = np.clip(before, 0, BINS - 1), np.clip(after, 0, BINS - 1)
    start, stop = a + 0.5 + middle[rows, a], b + 0.5 + middle[rows, b]
    share = np.clip((index + 0.5 - start) / np.maximum(stop - start, 1e-9), 0.0, 1.0)
    line = np.where(filled, mean, (1.0 - share) * mean[rows, a] + share * mean[rows, b])
    channels = [np.where(within, 2.0 * line - 1.0, 0.0), middle, 1.0 * filled, 1.0 * within]
    channels += [np.log1p(count), 20.0 * together, 10.0 * spread]
    frames = np.bincount(sample, minlength=m)
    end = np.zeros(m)
    np.maximum.at(end, sample, place * (END / BINS))
    scalars = [np.log(max_radius / 1.3e-4), np.log(frame / 0.04), exposure / frame]
    scalars += [0.7 * np.log(np.maximum(noise, 3e-4) / 0.01), 2.0 * discrepancy - 1.0, 0.5 * (end - 4.0)]
    scalars += [np.log(np.maximum(frames, 1) / 100.0), 1.0 * (noise < 1e-3), late]
    flat = np.stack(channels, axis=1).reshape(m, BINS * CHANNELS)
    return np.concatenate([flat, np.column_stack(scalars)], axis=1, dtype=np.float32, casting="same_kind")


def z_index(name: str) -> int:
    """Of the coordinate of a parameter."""
    return COORDINATES.index(_SHARED.get(name, name))


def used(law: str, bubble: str) -> list[int]:
    """Indices of the coordinates of a law (`Family`) with this bubble (of BUBBLE_NAMES), camera included, ascending."""
    return sorted(map(z_index, [*Family(law).parameters, "stretch", *BUBBLE_NAMES[bubble], *CAMERA]))


def to_latent(names: tuple[str, ...], log10: Floats) -> Floats:
    """(k, 9) z from log10 values (k, names) of a law, the stretch and the accommodation; 0 in all others."""
    z = np.zeros((len(log10), len(COORDINATES)))
    for name, value in zip(names, log10.T, strict=True):
        if name == "reference_viscosity":
            z[:, z_index(name)] = (value - _REFERENCE[0]) / _REFERENCE[1]
        else:
            low, high = PARAMETERS[name].searched  # type: ignore[misc]
            z[:, z_index(name)] = ndtri(np.clip((value - low) / (high - low), _INSIDE, 1.0 - _INSIDE))
    return z


def from_latent(names: tuple[str, ...], z: Floats) -> tuple[Floats, Floats]:
    """log10 values (k, names) from z (k, 9), and log |dz/dlog10| (k,), by which a density of z becomes one of them."""
    log10, log_jacobian = np.empty((len(z), len(names))), np.zeros(len(z))
    for i, name in enumerate(names):
        coordinate = z[:, z_index(name)]
        if name == "reference_viscosity":
            log10[:, i] = _REFERENCE[0] + _REFERENCE[1] * coordinate
            log_jacobian -= np.log(_REFERENCE[1])
        else:
            low, high = PARAMETERS[name].searched  # type: ignore[misc]
            log10[:, i] = low + (high - low) * ndtr(coordinate)
            log_jacobian += 0.5 * (coordinate**2 + np.log(2.0 * np.pi)) - np.log(high - low)
    return log10, log_jacobian


def damping(z: Floats) -> Floats:
    """The confinement damping of z: its prior is the half of a normal from 0 up, cut as that of an experiment."""
    return np.asarray(ZETA * ndtri(0.5 + (ndtr(LARGEST) - 0.5) * ndtr(z)))


def damping_to_latent(damping: float) -> float:
    """z of a given confinement damping; that of nothing is where training has hardly any smaller one."""
    inside = (ndtr(damping / ZETA) - 0.5) / (ndtr(LARGEST) - 0.5)
    return float(np.clip(ndtri(np.clip(inside, _INSIDE, 1.0 - _INSIDE)), -_FARTHEST, _FARTHEST))


class NetworkProposal:
    """What a network answers for one experiment: a normalised density, and draws, in the coordinates u of its prior.
    Raises InputError: hardly anything of it is within the prior's bounds."""

    def __init__(self, model: PosteriorModel, shot: Experiment, prior: Prior, *, discrepancy: bool) -> None:
        self.model, self.prior, bubble = model, prior, kind_of(shot.options.bubble)
        self.kind: int = model.kinds.index((plain(shot.family.name), bubble))
        self.names: tuple[str, ...] = (*shot.family.parameters, *shot.logs)
        self.inputs: Any = read(shot, discrepancy)
        width_t, width_r = shot.usual_half_widths
        camera = {"max_radius_factor": (1.0, width_r / 3.0), "time_origin": (0.0, width_t * shot.time_scale)}
        camera |= {"radius_scale": (1.0, SCALE)}
        self.camera: list[tuple[int, int, float, float]] = []  # column of x, index of z, middle and width of x over z
        self.fixed: dict[int, float] = {}
        self.integrated: list[int] = []  # free, and last: the density of the others is that without them
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
        viscous = pressure * (shot.time_scale / WATER.time_scale(shot.max_radius))
        factors = {"shear_modulus": pressure, "viscosity": viscous, "reference_viscosity": viscous}
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
    """Which of the bubbles that a network knows (BUBBLE_NAMES) this one is; empty: none of them."""
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
    """A network that gives densities. kinds: (law, bubble) that it knows, in its order. Raises InputError: the file or
    its card is missing, damaged or of another kind, or it is not the file of its card."""

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
        shape, counted, take = (count, len(COORDINATES)), np.zeros(len(COORDINATES)), np.zeros(len(COORDINATES))
        choice, normal, imposed = rng.gumbel(size=(*shape, self.parts)), rng.standard_normal(shape), np.zeros(shape)
        for k, value in fixed.items():
            imposed[:, k], take[k] = value, 1.0
        return self._run(inputs, kind, counted=counted, choice=choice, normal=normal, given=imposed, take=take)[0]

    def log_density(self, inputs: Any, kind: int, z: Floats, without: Collection[int]) -> Floats:
        """(draws,) of z (draws, 9), each coordinate given those before it, without some."""
        counted = np.zeros(len(COORDINATES))
        counted[[k for k in used(*self.kinds[kind]) if k not in without]] = 1.0
        choice, take = np.zeros((*z.shape, self.parts)), np.ones(len(COORDINATES))
        return self._run(inputs, kind, counted=counted, choice=choice, normal=z, given=z, take=take)[1]

    def _run(self, inputs: Any, kind: int, **numbers: Floats) -> tuple[Floats, Floats]:
        """Draws z (count, 9) and their log densities (count,), from the other inputs by their names."""
        one_hot, has = np.zeros((1, len(self.kinds)), np.float32), np.zeros(len(COORDINATES), np.float32)
        one_hot[0, kind], has[used(*self.kinds[kind])] = 1.0, 1.0
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
        bubble, trained = kind_of(shot.options.bubble), self.card.trained
        if not bubble:
            return f"it knows {KNOWN_BUBBLES}"
        if not self.knows(shot.family.name, shot.options.bubble):
            return f"it was not trained on {shot.family.name} with the {bubble} bubble"
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
    """The shipped model of this name, or the one in an .onnx file as it is now. Raises InputError."""
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
