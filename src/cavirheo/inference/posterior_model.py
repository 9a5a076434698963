"""A posterior network that ships with the package or that a user trained: an .onnx file and the card beside it."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from cavirheo.errors import InputError, require
from cavirheo.files import read_bytes
from cavirheo.inference import DEFAULT, KNOWN_BUBBLES
from cavirheo.inference.card import PosteriorCard
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.flow import INPUTS, Flow, NetworkProposal, kind_of, plain
from cavirheo.inference.graph import check_graph
from cavirheo.inference.model import LARGEST, Network, card, load, path_of, shipped
from cavirheo.inference.session import try_out
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import WATER
from cavirheo.prior import Prior


class PosteriorModel:
    """name, card, sha256 of the .onnx file; flow: its densities.

    Raises:
        InputError: the file or its card is missing, damaged or of another kind, or it is not the file of its card.
    """

    def __init__(self, path: Path) -> None:
        self.name: str = path.stem
        about = card(path)
        message = f"{path} is a network of another kind ({about['kind']}): a posterior network is needed"
        require(about["kind"] == "posterior", message, "model.kind")
        self.card: PosteriorCard = PosteriorCard.model_validate(about)
        content = read_bytes(path, LARGEST)
        self.sha256: str = hashlib.sha256(content).hexdigest()
        message = f"{path} is not the file that its card describes (sha256 {self.sha256[:12]}...)"
        require(self.sha256 == self.card.onnx.sha256, message, "model.changed")
        if path not in shipped().values():
            try:
                check_graph(content, INPUTS)
                try_out(content, 0, 0)
            except InputError as error:
                raise InputError(f"{path} is not run: {error}; export it with `cavirheo train`", error.code) from error
        self.flow: Flow = Flow(content, self.card.kinds)

    def knows(self, material: str, bubble: Bubble) -> bool:
        """Whether it was trained on this law and this bubble."""
        return (plain(material), kind_of(bubble)) in self.flow.kinds

    def proposal(self, shot: Experiment, prior: Prior, discrepancy: bool) -> NetworkProposal:
        """Raises InputError: the experiment is outside the training."""
        outside = self.beyond(shot)
        require(not outside, f"the network cannot read it: {outside}", "network.outside")
        return NetworkProposal(self.flow, shot, prior, discrepancy=discrepancy)

    def beyond(self, shot: Experiment) -> str:
        """What of an experiment is outside its training, in words; empty if all is inside."""
        bubble, trained = shot.options.bubble, self.card.trained
        if not kind_of(bubble):
            return f"it knows {KNOWN_BUBBLES}"
        if not self.knows(shot.family.name, bubble):
            return f"it was not trained on {shot.family.name} with the {kind_of(bubble)} bubble"
        frames = int((shot.counted & (shot.since >= 0)).sum())
        here: dict[str, tuple[float, str]] = {
            "max_radius_um": (shot.max_radius * 1e6, "R_max of {:.4g} um"),
            "frame_interval_us": (shot.frame * 1e6, "{:.4g} us between frames"),
            "frames": (frames, "{:.0f} frames in the window"),
            "noise_over_rmax": (shot.curve.noise / shot.max_radius, "noise of {:.2g} of R_max"),
            "density": (shot.medium.density, "a density of {:.4g} kg/m3"),
            "pressure": (shot.medium.pressure, "a pressure of {:.4g} Pa"),
        }
        for name, (value, words) in here.items():
            low, high = trained[name]
            if not low <= value <= high:
                return f"{words.format(value)} is outside its training ({low:g} to {high:g})"
        for constant in fields(WATER):
            if constant.name not in (*trained, "name", *_OF_VAPOUR):
                value, usual = getattr(shot.medium, constant.name), getattr(WATER, constant.name)
                if not abs(value - usual) <= _NEAR * abs(usual):
                    return f"{constant.name} = {value:.4g} is more than {_NEAR:.0%} from its training ({usual:.4g})"
        vapour, usual = shot.medium.vapour_pressure, WATER.vapour_pressure
        if not usual / _VAPOUR <= vapour <= usual * _VAPOUR:
            return f"a vapour pressure of {vapour:.4g} Pa is beyond twice or half of its training ({usual:.4g} Pa)"
        return ""


_NEAR = 0.1  # of a constant that all its curves share: the weights allow for no more
_VAPOUR, _OF_VAPOUR = 2.0, ("vapour_reference_pressure", "vapour_reference_temperature")  # from 14 to 37 degrees C


def load_posterior(name: str = DEFAULT) -> PosteriorModel:
    """The shipped posterior network of this name, or the one in a file whose name ends in .onnx, as the file is now.
    Raises InputError."""
    path = path_of(name)
    try:
        state = path.stat()
    except OSError:
        return PosteriorModel(path)  # which says what is wrong
    return _loaded(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4)
def _loaded(path: Path, *_: int) -> PosteriorModel:
    """The model in a file of this time and size."""
    return PosteriorModel(path)


def network_of(name: str) -> Network | PosteriorModel:
    """The shipped model of this name, or the one in a file whose name ends in .onnx, of either kind. Raises
    InputError."""
    return load(name) if card(path_of(name))["kind"] == "point" else load_posterior(name)


def describe(card: PosteriorCard) -> list[str]:
    """Lines of what the network knows, for `cavirheo models`."""
    laws: dict[str, list[str]] = {}
    for law, bubble in card.kinds:
        laws.setdefault(law, []).append(bubble)
    lines = [f"  {law}, bubble {' or '.join(bubbles)}" for law, bubbles in laws.items()]
    words: Any = {name: f"{low:g} to {high:g}" for name, (low, high) in card.trained.items()}
    inside = card.coverage.get("by_slot", {})
    shown = ", ".join(f"{name.replace('_', ' ')} {share['90']:.0%}" for name, share in inside.items())
    lines += [f"  truth within its 90 % interval, without simulations: {shown}"] if shown else []
    return [*lines, f"  R_max {words['max_radius_um']} um, {words['frames']} frames of {words['frame_interval_us']} us"]
