"""Shipped or user-made network: an .onnx file and the card (.json) beside it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.problem import TrainingProblem

DEFAULT = "bdt-viscoelastic"
_BATCH = 512


class Network:
    """A network that reads R/R_max on the grid of its training problem and answers in the prior's scale.

    Attributes: name; card (dict); problem; outputs (names in the prior's scale); sha256 of the .onnx file.

    Raises:
        InputError: the file or its card is missing, is not one of ours, or the file is not the one the card describes.
    """

    def __init__(self, path: Path) -> None:
        self.name, self.card = path.stem, card(path)
        try:
            self.problem = TrainingProblem.from_dict(self.card["problem"])
            self.outputs = tuple(str(output["name"]) for output in self.card["outputs"])
            expected = self.card["onnx"]["sha256"]
        except (KeyError, TypeError) as error:
            raise InputError(f"the card of {path} lacks what inference needs: {error}", "model.card") from error
        content = path.read_bytes()
        self.sha256 = hashlib.sha256(content).hexdigest()
        told = f"{path} is not the file that its card describes (sha256 {self.sha256[:12]}...)"
        require(self.sha256 == expected, told, "model.changed")
        self._run = _session(content)

    def __call__(self, features: ArrayLike) -> Floats:
        """(curves, outputs) in the prior's scale from R/R_max (curves, frames), any number of curves."""
        return self._run(features)


def predict(path: str | Path, features: ArrayLike) -> Floats:
    """What the network of an .onnx file answers, as `Network` does; no card is needed."""
    return _session(Path(path).read_bytes())(features)


def _session(content: bytes) -> Callable[[ArrayLike], Floats]:
    """(curves, frames) -> (curves, outputs) of the content of an .onnx file."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read at import: its wheels come with telemetry
    import onnxruntime  # half a second that listing models or reading curves need not pay

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # one small curve at a time: threads cost more than they give
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])

    def run(features: ArrayLike) -> Floats:
        curves = np.asarray(features, dtype=np.float32)
        blocks = [curves[i : i + _BATCH] for i in range(0, len(curves), _BATCH)]
        return np.concatenate([session.run(["theta"], {"radius": block})[0] for block in blocks]).astype(float)

    return run


def card(path: Path) -> dict[str, Any]:
    """The card beside an .onnx file. Raises InputError if either is missing or the card is not JSON."""
    beside = path.with_suffix(".json")
    told = f"a model is an .onnx file with its card beside it; expected {path} and {beside}"
    require(path.is_file() and beside.is_file(), told, "model.missing")
    try:
        content = json.loads(beside.read_text(encoding="utf-8"))
        require(isinstance(content, dict), "it holds no object")
    except (OSError, ValueError) as error:
        raise InputError(f"{beside} is not a model card of cavirheo: {error}", "model.card") from error
    return dict(content)


def shipped() -> dict[str, Path]:
    """Names of the models that come with the package, and their files."""
    folder = Path(str(files("cavirheo") / "models"))
    return {path.stem: path for path in sorted(folder.glob("*.onnx"))}


def path_of(name: str) -> Path:
    """The file of a shipped model, or the file itself if the name ends in .onnx. Raises InputError."""
    if name.endswith(".onnx"):
        return Path(name)
    known = shipped()
    told = f"unknown model {name!r}; known: {', '.join(known) or 'none'}, or a path to an .onnx file"
    require(name in known, told, "model.unknown")
    return known[name]


@lru_cache(maxsize=8)
def load(name: str = DEFAULT) -> Network:
    """The shipped model of this name, or the one in a file whose name ends in .onnx. Raises InputError."""
    return Network(path_of(name))
