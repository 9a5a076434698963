"""A posterior network gives draws of the parameters and their density, for any recording, in milliseconds.

It reads the frames of an experiment's window in bins of t* = t/t_c, whatever the camera (`binned`), and gives the
density of nine latent coordinates z that all its laws and bubbles share. The coordinates come one after the other, each
as a mixture of Gaussians given those before it; the first ones may be known in advance. Most have a standard normal
prior. A parameter of a law, the stretch and the accommodation have z = Phi^-1((log10 value - low)/(high - low)), with
low to high the range of a search; parameters of two laws with a similar effect share a coordinate. The damping is
half-normal. A power law's reference viscosity has z = (log10 mu_ref + 1.5)/2. R_max, clock and scale are in units of
their prior's width.

It was trained in water; in another medium the same Cauchy and Reynolds numbers give nearly the same curve:

    G = G_water p/p_water,   mu = mu_water (p t_c)/(p t_c)_water,   t_c at the shot's R_max.

If a parameter is not inferred (a given stretch, a given accommodation, an exact clock), its coordinate is fixed: those
after it are conditioned on its value, and those before it are drawn as if it were free. The draws are a proposal, which
simulations weight (inference/verify). A network ships with the package or was trained by a user: an .onnx file and the
card beside it.
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
from cavirheo.inference.experiment import BOUND_SCALES, ZETA, Experiment
from cavirheo.inference.model import DEFAULT, Network, PosteriorCard, card, checked_content, path_of
from cavirheo.inference.session import onnx_session
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.bubble import FIELD, FREE, Bubble
from cavirheo.physics.media import WATER
from cavirheo.prior import Prior

BINS, END = 192, 6.0  # number of bins of a recording, and t* at the end of the last one
CHANNELS, SCALARS = 7, 9  # numbers of each bin, and of the recording
SIZE = BINS * CHANNELS + SCALARS  # length of the input
SCALE = 0.005  # standard deviation of the radius scale
CAMERA = ("max_radius_factor", "time_origin", "radius_scale")
COORDINATES = ("stretch", "confinement_damping", "accommodation", "viscosity", "shear_modulus", "shape", *CAMERA)
BUBBLE_NAMES = {"field": (), "real": ("confinement_damping", "accommodation")}  # coordinates besides the common ones
_SHARED_COORDINATES = {"reference_viscosity": "viscosity", "stiffening": "shape", "exponent": "shape"}
_REFERENCE_VISCOSITY = (-1.5, 2.0)  # mean and standard deviation of log10 of a reference viscosity
_MAX_DAMPING_Z = 3.0  # largest |z| of a given damping: one in a thousand of the training is beyond
_MIN_P = 1e-9  # least probability between z and a bound
_TRIAL_DRAWS, _MIN_INSIDE_SHARE = 1000, 0.01  # draws that estimate the share within the bounds, and its smallest value
KNOWN_BUBBLES = "the real and the field's bubble, without damage, confinement inertia or excess of vapour"
INPUTS = ("cells", "kind", "has", "counted", "choice", "normal", "given", "take")
_MARGIN = 0.1  # largest relative difference of a constant from that of all training curves
_VAPOUR_FACTOR, _VAPOUR_NAMES = 2.0, ("vapour_reference_pressure", "vapour_reference_temperature")  # 14 to 37 degrees C


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
    """Inputs (m, SIZE) of m recordings: for each bin the mean radius, mean time, count and scatter of its frames, and
    the covariance of radius and time; an empty bin between frames is interpolated linearly. sample: (n,) index of the
    recording of each frame. time: (n,) t* after R_max, ascending. radius: (n,) R/R_max. For each recording, (m,): R_max
    in m, frame interval and exposure in t_c, noise over R_max, discrepancy (1 if frames and simulation may differ by
    more than white noise), late (1 if no growth is recorded)."""
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
    covariance = np.where(count > 1, summed(radius * offset) / several - mean * middle, 0.0)
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
    channels += [np.log1p(count), 20.0 * covariance, 10.0 * spread]
    frames = np.bincount(sample, minlength=m)
    end = np.zeros(m)
    np.maximum.at(end, sample, place * (END / BINS))
    scalars = [np.log(max_radius / 1.3e-4), np.log(frame / 0.04), exposure / frame]
    scalars += [0.7 * np.log(np.maximum(noise, 3e-4) / 0.01), 2.0 * discrepancy - 1.0, 0.5 * (end - 4.0)]
    scalars += [np.log(np.maximum(frames, 1) / 100.0), 1.0 * (noise < 1e-3), late]
    flat = np.stack(channels, axis=1).reshape(m, BINS * CHANNELS)
    return np.concatenate([flat, np.column_stack(scalars)], axis=1, dtype=np.float32, casting="same_kind")


def z_index(name: str) -> int:
    """Index of the coordinate of a parameter."""
    return COORDINATES.index(_SHARED_COORDINATES.get(name, name))


def coordinate_indices(law: str, bubble: str) -> list[int]:
    """Ascending indices of the coordinates of a law (`Family`), of this bubble (of BUBBLE_NAMES) and of the camera."""
    return sorted(map(z_index, [*Family(law).parameters, "stretch", *BUBBLE_NAMES[bubble], *CAMERA]))


def to_latent(names: tuple[str, ...], log10: Floats) -> Floats:
    """z (k, 9) from log10 values (k, names) of a law, the stretch and the accommodation; all others are 0."""
    z = np.zeros((len(log10), len(COORDINATES)))
    for name, value in zip(names, log10.T, strict=True):
        if name == "reference_viscosity":
            z[:, z_index(name)] = (value - _REFERENCE_VISCOSITY[0]) / _REFERENCE_VISCOSITY[1]
        else:
            low, high = PARAMETERS[name].search_range  # type: ignore[misc]
            z[:, z_index(name)] = ndtri(np.clip((value - low) / (high - low), _MIN_P, 1.0 - _MIN_P))
    return z


def from_latent(names: tuple[str, ...], z: Floats) -> tuple[Floats, Floats]:
    """log10 values (k, names) from z (k, 9), and log |dz/dlog10| (k,), the log density of values minus that of z."""
    log10, log_jacobian = np.empty((len(z), len(names))), np.zeros(len(z))
    for i, name in enumerate(names):
        coordinate = z[:, z_index(name)]
        if name == "reference_viscosity":
            log10[:, i] = _REFERENCE_VISCOSITY[0] + _REFERENCE_VISCOSITY[1] * coordinate
            log_jacobian -= np.log(_REFERENCE_VISCOSITY[1])
        else:
            low, high = PARAMETERS[name].search_range  # type: ignore[misc]
            log10[:, i] = low + (high - low) * ndtr(coordinate)
            log_jacobian += 0.5 * (coordinate**2 + np.log(2.0 * np.pi)) - np.log(high - low)
    return log10, log_jacobian


def damping(z: Floats) -> Floats:
    """The confinement damping of z; its prior is half-normal, and cut as that of an experiment."""
    return np.asarray(ZETA * ndtri(0.5 + (ndtr(BOUND_SCALES) - 0.5) * ndtr(z)))


def damping_to_latent(damping: float) -> float:
    """z of a given confinement damping; 0 has z = -_MAX_DAMPING_Z, below which the training has hardly any damping."""
    inside = (ndtr(damping / ZETA) - 0.5) / (ndtr(BOUND_SCALES) - 0.5)
    return float(np.clip(ndtri(np.clip(inside, _MIN_P, 1.0 - _MIN_P)), -_MAX_DAMPING_Z, _MAX_DAMPING_Z))


class NetworkProposal:
    """The answer of a network for one experiment: a normalised density, and draws, in the coordinates u of its prior.
    Raises InputError: hardly any draw is within the prior's bounds."""

    def __init__(self, model: PosteriorModel, shot: Experiment, prior: Prior, *, discrepancy: bool) -> None:
        self.model, self.prior, bubble = model, prior, kind_of(shot.options.bubble)
        self.kind: int = model.kinds.index((without_spaces(shot.family.name), bubble))
        self.names: tuple[str, ...] = (*shot.family.parameters, *shot.log_names)
        self.inputs: Any = network_input(shot, discrepancy)
        width_t, width_r = shot.usual_half_widths
        camera = {"max_radius_factor": (1.0, width_r / 3.0), "time_origin": (0.0, width_t * shot.time_scale)}
        camera |= {"radius_scale": (1.0, SCALE)}
        self.camera: list[tuple[int, int, float, float]] = []  # column of x, index of z, middle and width of x over z
        self.fixed: dict[int, float] = {}
        self.integrated: list[int] = []  # free z that are integrated out: the last ones
        for name, (middle, width) in camera.items():
            if name not in shot.free:
                self.fixed[z_index(name)] = 0.0
            elif name not in prior.names:
                self.integrated.append(z_index(name))
            else:
                prior_middle, prior_width, _ = shot.free[name]
                place = prior.names.index(name), z_index(name)
                self.camera.append((*place, (middle - prior_middle) / prior_width, width / prior_width))
        for name, value in (("accommodation", shot.bubble.get("accommodation")), ("stretch", shot.stretch)):
            if value:
                self.fixed[z_index(name)] = float(to_latent((name,), np.log10([[value]]))[0, z_index(name)])
        self.damping: int | None = None  # its column in x
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
        inside = self._within_bounds(_TRIAL_DRAWS, np.random.Generator(np.random.Philox(0)))
        message = "hardly any of the network's draws is within the ranges of the parameters"
        require(len(inside) > _MIN_INSIDE_SHARE * _TRIAL_DRAWS, message, "network.outside", shot.curve.name)
        self.log_share = float(np.log(len(inside) / _TRIAL_DRAWS))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draws u (count, d)."""
        u = np.empty((0, len(self.prior.names)))
        while len(u) < count:
            u = np.concatenate([u, self._within_bounds(count, rng)])
        return u[:count]

    def log_density(self, u: Floats) -> Floats:
        """Log density (k,) at u (k, d)."""
        x = self.prior.to_x(u)
        z = to_latent(self.names, x[:, : len(self.names)] - self.shift)
        log_q = from_latent(self.names, z)[1]
        for column, place, middle, width in self.camera:
            z[:, place] = (x[:, column] - middle) / width
            log_q = log_q - np.log(width)
        by_x = np.ones(u.shape[1], dtype=bool)  # whether z depends on x; that of the damping is its u
        if self.damping is not None:
            z[:, z_index("confinement_damping")], by_x[self.damping] = u[:, self.damping], False
        for place, value in self.fixed.items():
            z[:, place] = value
        log_q += self.model.log_density(self.inputs, self.kind, z, [*self.fixed, *self.integrated]) - self.log_share
        return np.asarray(log_q + np.sum(np.log(self.prior.slope(u))[:, by_x], axis=1))

    def _within_bounds(self, count: int, rng: np.random.Generator) -> Floats:
        """Those of `count` draws u (k, d) that are within the bounds."""
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
    """Name (of BUBBLE_NAMES) of this bubble; empty if no network knows it."""
    if replace(bubble, accommodation=FREE, confinement_damping=0.0) == Bubble("kinetic"):
        return "real"
    return "field" if replace(bubble, accommodation=FREE) == FIELD else ""


def without_spaces(material: str) -> str:
    """The name of a law or of a sum of laws, without spaces."""
    return material.replace(" ", "")


def network_input(shot: Experiment, discrepancy: bool) -> Any:
    """Input (1, SIZE) of the network: all usable frames in the window of an experiment."""
    time, radius = shot.view.time_since_max[shot.usable] / shot.time_scale, shot.view.normalised[shot.usable]
    numbers = {"max_radius": shot.max_radius, "noise": shot.curve.noise / shot.max_radius}
    numbers |= {"frame": shot.frame_interval / shot.time_scale, "exposure": shot.exposure / shot.time_scale}
    numbers |= {"discrepancy": float(discrepancy), "late": float(shot.curve.begins_late)}
    arrays = {name: np.array([value]) for name, value in numbers.items()}
    return binned(np.zeros(len(time), np.int64), time, radius, **arrays)


class PosteriorModel:
    """A network that gives densities. kinds: (law, bubble) that it knows, in its order. Raises InputError: the file or
    its card is missing, damaged or of another kind, or the file is not that of its card."""

    def __init__(self, path: Path) -> None:
        self.name: str = path.stem
        self.card: PosteriorCard = PosteriorCard.model_validate(card(path))
        self.sha256: str = self.card.onnx.sha256
        self.kinds: list[tuple[str, str]] = [(without_spaces(law), bubble) for law, bubble in self.card.kinds]
        self.session: Any = onnx_session(checked_content(path, self.sha256, INPUTS))
        self.parts: int = next(int(tensor.shape[2]) for tensor in self.session.get_inputs() if tensor.name == "choice")

    def sample(
        self, inputs: Any, kind: int, count: int, rng: np.random.Generator, fixed: Mapping[int, float]
    ) -> Floats:
        """Draws z (count, 9); 0 for a coordinate that the kind does not have, and the given value for a `fixed` one."""
        shape, counted, take = (count, len(COORDINATES)), np.zeros(len(COORDINATES)), np.zeros(len(COORDINATES))
        choice, normal, imposed = rng.gumbel(size=(*shape, self.parts)), rng.standard_normal(shape), np.zeros(shape)
        for k, value in fixed.items():
            imposed[:, k], take[k] = value, 1.0
        return self._run(inputs, kind, counted=counted, choice=choice, normal=normal, given=imposed, take=take)[0]

    def log_density(self, inputs: Any, kind: int, z: Floats, excluded: Collection[int]) -> Floats:
        """Log density (draws,) of z (draws, 9), each coordinate given those before it, without those in `excluded`."""
        counted = np.zeros(len(COORDINATES))
        counted[[k for k in coordinate_indices(*self.kinds[kind]) if k not in excluded]] = 1.0
        choice, take = np.zeros((*z.shape, self.parts)), np.ones(len(COORDINATES))
        return self._run(inputs, kind, counted=counted, choice=choice, normal=z, given=z, take=take)[1]

    def _run(self, inputs: Any, kind: int, **numbers: Floats) -> tuple[Floats, Floats]:
        """Draws z (count, 9) and their log densities (count,), from the other inputs by their names."""
        one_hot, has = np.zeros((1, len(self.kinds)), np.float32), np.zeros(len(COORDINATES), np.float32)
        one_hot[0, kind], has[coordinate_indices(*self.kinds[kind])] = 1.0, 1.0
        feed = {"cells": inputs, "kind": one_hot, "has": has}
        feed |= {name: values.astype(np.float32) for name, values in numbers.items()}
        z, log_density, _ = self.session.run(None, feed)
        return z.astype(float), log_density.astype(float)

    def knows(self, material: str, bubble: Bubble) -> bool:
        """Whether it was trained on this law and this bubble."""
        return (without_spaces(material), kind_of(bubble)) in self.kinds

    def proposal(self, shot: Experiment, prior: Prior, discrepancy: bool) -> NetworkProposal:
        """The proposal for an experiment. Raises InputError: the experiment is outside the training."""
        outside = self.outside(shot)
        require(not outside, f"the network cannot read it: {outside}", "network.outside")
        return NetworkProposal(self, shot, prior, discrepancy=discrepancy)

    def outside(self, shot: Experiment) -> str:
        """The property of an experiment that is outside the training, in words; empty if all are inside."""
        bubble, trained = kind_of(shot.options.bubble), self.card.trained
        if not bubble:
            return f"it knows {KNOWN_BUBBLES}"
        if not self.knows(shot.family.name, shot.options.bubble):
            return f"it was not trained on {shot.family.name} with the {bubble} bubble"
        frames = int(np.count_nonzero(shot.usable))
        limited: dict[str, tuple[float, str]] = {
            "max_radius_um": (shot.max_radius * 1e6, "R_max of {:.4g} um"),
            "frame_interval_us": (shot.frame_interval * 1e6, "{:.4g} us between frames"),
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
            if constant.name not in (*trained, "name", *_VAPOUR_NAMES):
                value, usual = getattr(shot.medium, constant.name), getattr(WATER, constant.name)
                if not abs(value - usual) <= _MARGIN * abs(usual):
                    return f"{constant.name} = {value:.4g} is more than {_MARGIN:.0%} from its training ({usual:.4g})"
        vapour, usual = shot.medium.vapour_pressure, WATER.vapour_pressure
        if not usual / _VAPOUR_FACTOR <= vapour <= usual * _VAPOUR_FACTOR:
            return f"a vapour pressure of {vapour:.4g} Pa is beyond twice or half of its training ({usual:.4g} Pa)"
        return ""


def network_of(name: str = DEFAULT) -> Network | PosteriorModel:
    """The shipped model of this name, or that in an .onnx file, read again if the file changes. Raises InputError."""
    path, state = path_of(name), tuple[int, ...]()
    with suppress(OSError):  # no file: `card` raises the error
        state = path.stat().st_mtime_ns, path.stat().st_size
    return _loaded(path, *state)


@lru_cache(maxsize=8)
def _loaded(path: Path, *_: int) -> Network | PosteriorModel:
    """The model in a file; its time and size are arguments, so that a changed file is read again."""
    return Network(path) if card(path)["kind"] == "point" else PosteriorModel(path)


def describe(card: PosteriorCard) -> list[str]:
    """Lines that describe what the network knows, for `cavirheo models`."""
    laws: dict[str, list[str]] = {}
    for law, bubble in card.kinds:
        laws.setdefault(law, []).append(bubble)
    lines = [f"  {law}, bubble {' or '.join(bubbles)}" for law, bubbles in laws.items()]
    words: Any = {name: f"{low:g} to {high:g}" for name, (low, high) in card.trained.items()}
    inside = card.coverage.get("by_slot", {})
    coverage = ", ".join(f"{name.replace('_', ' ')} {share['90']:.0%}" for name, share in inside.items())
    lines += [f"  truth within its 90 % interval, without simulations: {coverage}"] if coverage else []
    return [*lines, f"  R_max {words['max_radius_um']} um, {words['frames']} frames of {words['frame_interval_us']} us"]
