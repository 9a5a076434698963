"""Shipped or user-made network: an .onnx file and the card (.json) beside it."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, explained, require
from cavirheo.files import read_bytes, read_object
from cavirheo.inference.card import ModelCard, PosteriorCard
from cavirheo.inference.graph import check_graph
from cavirheo.inference.session import session, try_out
from cavirheo.parameters import natural
from cavirheo.problem import TrainingProblem

DEFAULT = "bdt-viscoelastic"
LARGEST, LARGEST_CARD = 100_000_000, 10_000_000  # bytes that are read


class Network:
    """A network that reads R/R_max on the grid of its training problem and answers in the prior's scale.

    Attributes: name; card (dict); problem; outputs (names in the prior's scale); sha256 of the .onnx file.

    A model that is not shipped is a stranger's. Its graph is looked at, then it is run once in a process of its own
    with limits; what it takes depends on the number of curves alone (graph.py), so from then on it is run in this one.

    Raises:
        InputError: the file or its card is missing, damaged or not one of ours, it is not the file that its card
            describes, or it is not run for what it holds ("graph...") or takes ("model.time", ...).
    """

    def __init__(self, path: Path) -> None:
        self.name: str = path.stem
        self.card: dict[str, Any] = card(path)
        message = f"{path.stem} gives draws: the paper's networks, which give one value, are needed here"
        require(self.card["kind"] == "point", message, "model.kind")
        self.problem: TrainingProblem = TrainingProblem.from_dict(self.card["problem"])
        self.outputs: tuple[str, ...] = tuple(str(output["name"]) for output in self.card["outputs"])
        content = read_bytes(path, LARGEST)
        self.sha256: str = hashlib.sha256(content).hexdigest()
        message = f"{path} is not the file that its card describes (sha256 {self.sha256[:12]}...)"
        require(self.sha256 == self.card["onnx"]["sha256"], message, "model.changed")
        if path not in shipped().values():
            try:
                check_graph(content)
                try_out(content, self.problem.grid.frames, len(self.outputs))
            except InputError as error:
                raise InputError(f"{path} is not run: {error}; export it with `cavirheo train`", error.code) from error
        self._run = session(content)

    def __call__(self, features: ArrayLike) -> Floats:
        """(curves, outputs) in the prior's scale from R/R_max (curves, frames), any number of curves.

        Raises InputError: it answers a curve with what is no number ("model.not_finite").
        """
        theta = self._run(features)
        with np.errstate(over="ignore"):
            values = [natural(name, column) for name, column in zip(self.outputs, theta.T, strict=True)]
        fine = np.isfinite(theta).all() and np.isfinite(values).all()
        require(bool(fine), f"the model {self.name} answers a curve with what is no number", "model.not_finite")
        return theta


def predict(path: str | Path, features: ArrayLike) -> Floats:
    """What the network of one's own .onnx file answers, as `Network` does; no card is needed."""
    return session(read_bytes(path, LARGEST))(features)


def card(path: Path) -> dict[str, Any]:
    """The card beside an .onnx file. Raises InputError: one of the two is missing, or it is not a card of ours."""
    beside = path.with_suffix(".json")
    try:
        there = path.is_file() and beside.is_file()
    except OSError:  # a name that is too long
        there = False
    message = f"a model is an .onnx file with its card beside it; expected {path} and {beside}"
    require(there, message, "model.missing")
    content = read_object(beside, LARGEST_CARD)
    kind = PosteriorCard if content.get("kind") == "posterior" else ModelCard
    try:
        kind.model_validate(content)
    except ValidationError as error:
        message = f"{beside} is not a card of `cavirheo train`: {explained(error, kind)}; export it anew"
        raise InputError(message, "model.card") from error
    return content


def shipped(kind: str | None = None) -> dict[str, Path]:
    """Names of the models that come with the package, or of those of a kind ("point", "posterior"), and their files."""
    folder = Path(str(files("cavirheo") / "models"))
    found = {path.stem: path for path in sorted(folder.glob("*.onnx"))}
    return {name: path for name, path in found.items() if kind is None or card(path)["kind"] == kind}


def path_of(name: str) -> Path:
    """The file of a shipped model, or the file itself if the name ends in .onnx. Raises InputError."""
    if name.endswith(".onnx"):
        return Path(name)
    known = shipped()
    message = f"unknown model {name!r}; known: {', '.join(known) or 'none'}, or a path to an .onnx file"
    require(name in known, message, "model.unknown")
    return known[name]


@lru_cache(maxsize=8)
def load(name: str = DEFAULT) -> Network:
    """The shipped model of this name, or the one in a file whose name ends in .onnx. Raises InputError."""
    return Network(path_of(name))
