"""Networks that ship with the package or were made by `cavirheo train`: a file of weights, NAME.npz, and its card,
NAME.json.

Nothing in them is executed: the file holds plain arrays of numbers, whose sizes are checked before they are read, and
the networks are those of this package.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.resources import files
from io import BytesIO
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError, model_validator

from cavirheo.errors import InputError, read_bytes, read_object, validation_message
from cavirheo.inference.problem import TrainingProblem
from cavirheo.parameters import LOG10, parameter_of

MAX_BYTES, MAX_CARD_BYTES = 8_000_000, 2_000_000  # bytes: largest file of weights, also unpacked, and largest card
MAX_ARRAYS = 5_000  # of a file
MAX_ATTENTION = 50_000_000  # numbers in the attention weights of one curve

Arrays = Mapping[str, NDArray[np.float32]]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Size = Annotated[int, Field(gt=0, le=4096)]


class _Answers(BaseModel):
    """One output of a network.

    Attributes:
        name: name of the parameter in the scale of the prior, "log10_viscosity".
        unit: SI unit of the parameter.
        scale: scale of the output: "log10" or "linear".
    """

    name: str
    unit: str
    scale: Literal["log10", "linear"]


class Layers(BaseModel):
    """Sizes of the layers of a network, apart from those that its arrays show.

    Attributes:
        heads: number of attention heads.
        layers: number of encoder layers of each output.
        activation: function of the feed-forward layers.
        norm_epsilon: what is added to the variance before a layer is normalised.
    """

    heads: Size
    layers: Annotated[int, Field(gt=0, le=100)]
    activation: Literal["relu", "softplus"]
    norm_epsilon: Annotated[float, Field(gt=0)]


class _File(BaseModel):
    """The file of weights.

    Attributes:
        sha256: SHA-256 of the file, which identifies it.
        largest_difference_from_torch: from the trained network, on curves of the test part; in the prior's scale, for
            an emulator R/R_max and t/T.
    """

    sha256: Digest
    largest_difference_from_torch: float


class _Card(BaseModel):
    """What every card says.

    Attributes:
        schema_version: number of the schema, 2; its key in the file is `schema`.
        name: name of the network and its files.
        data: the training set: "n" curves, its "seed" and "sha256", and the numbers of curves in "train" and in "test",
            which the training did not see.
        weights: the file that the card describes.
    """

    schema_version: Literal[2] = Field(alias="schema")
    name: str = Field(pattern="^[a-z0-9][a-z0-9.-]*$")
    data: dict[str, Any]
    weights: _File


class ModelCard(_Card):
    """The card of a network that gives one value for each output (inference/bdt.py). It has further entries for readers
    (training/train.py).

    Attributes:
        kind: kind of the network: "point".
        material: name of the law.
        problem: prior, medium, grid of times and reference R_max of the training set.
        outputs: the outputs.
        network: sizes of its layers.
        metrics: accuracy on the test part, by output, in the scale of the prior (decades for "log10"): the coefficient
            of determination R² and the median absolute error.
        history: losses of every epoch on the "train" and "validation" parts.
    """

    kind: Literal["point"]
    material: str
    problem: dict[str, Any]
    outputs: list[_Answers] = Field(min_length=1)
    network: Layers
    metrics: dict[str, dict[str, float]]
    history: dict[Literal["train", "validation"], list[float]] = {}

    @model_validator(mode="after")
    def _consistent(self) -> ModelCard:
        problem, names = TrainingProblem.from_dict(self.problem), {output.name for output in self.outputs}
        if self.material != problem.material_name:
            raise InputError("its material is not that of its problem")
        if self.network.heads * problem.frames**2 > MAX_ATTENTION:
            raise InputError(f"{problem.frames} frames are too many for a network")
        if len(names) != len(self.outputs) or names != {*problem.prior.names} - {"stretch"}:
            raise InputError("its outputs are not the parameters of its law")
        if not names <= self.metrics.keys():
            raise InputError("its metrics are not of its outputs")
        for output in self.outputs:
            if output.unit != parameter_of(output.name).unit or (output.scale == "log10") != (LOG10 in output.name):
                raise InputError(f"{output.name} has another unit or scale than its name says")
        return self


class EmulatorCard(_Card):
    """The card of an emulator (inference/emulator.py). It has further entries for readers (training/train.py).

    Attributes:
        kind: kind of the network: "emulator".
        domain: what its curves were drawn from.
        errors: RMS error of the frames of a curve, up to the rebound that follows its third collapse, over R_max:
            quantiles over the test part.
    """

    kind: Literal["emulator"]
    domain: dict[str, Any]
    errors: dict[Literal["median", "p90", "p95", "p99"], float]


def card(path: Path) -> dict[str, Any]:
    """The card beside a file of weights. Raises InputError: one of the two is missing, or the card is not valid."""
    file = path.with_suffix(".json")
    if not (isfile(path) and isfile(file)):  # isfile is False for a name that is too long, too
        message = f"a model is an .npz file with its card beside it; expected {path} and {file}"
        raise InputError(message, "model.missing")
    content = read_object(file, MAX_CARD_BYTES)
    kind = EmulatorCard if content.get("kind") == "emulator" else ModelCard
    try:
        kind.model_validate(content)
    except ValidationError as error:
        message = f"{file} is not a card of `cavirheo train`: {validation_message(error)}; train it anew"
        raise InputError(message, "model.card") from error
    return content


def read_weights(path: Path, sha256: str) -> Arrays:
    """The arrays in a file of weights whose card has this sha256. Raises InputError: it is damaged, too large, or not
    the file that its card describes."""
    content = read_bytes(path, MAX_BYTES)
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        message = f"{path} is not the file that its card describes (sha256 {digest[:12]}...): train it anew"
        raise InputError(message, "model.changed")
    try:
        return unpack(content)
    except Exception as error:  # zipfile and numpy raise nearly any error for damaged bytes
        message = f"{path} holds no weights of `cavirheo train` ({error}): train it anew"
        raise InputError(message, "model.weights") from error


def unpack(content: bytes) -> Arrays:
    """The arrays of float32 in the bytes of an .npz file. Raises any error: it holds something else."""
    with ZipFile(BytesIO(content)) as packed:
        parts = packed.infolist()
    if len(parts) > MAX_ARRAYS or sum(part.file_size for part in parts) > MAX_BYTES:
        raise ValueError(f"{len(parts)} arrays of more than {MAX_BYTES / 1e6:g} MB in all, or more than {MAX_ARRAYS}")
    if any(part.compress_type not in (ZIP_STORED, ZIP_DEFLATED) for part in parts):  # others unpack without a limit
        raise ValueError("it is packed in another way than .npz files are")
    with np.load(BytesIO(content), allow_pickle=False) as file:
        arrays: dict[str, NDArray[np.float32]] = {name: file[name] for name in file.files}
    for name, array in arrays.items():
        if array.dtype != np.float32 or not np.isfinite(array).all():
            raise ValueError(f"{name} holds other things than finite numbers of single precision")
    return arrays


def shipped(kind: str | None = None) -> dict[str, Path]:
    """Files of the networks that come with the package, by name; of all, or of one kind ("point", "emulator")."""
    folder = Path(str(files("cavirheo") / "models"))
    paths = {path.stem: path for path in sorted(folder.glob("*.npz"))}
    return {name: path for name, path in paths.items() if kind is None or card(path)["kind"] == kind}


def path_of(name: str) -> Path:
    """The file of weights of a shipped network, that in the folder of a run of `cavirheo train`, or the file itself.
    Raises InputError."""
    models, path = shipped(), Path(name)
    if name in models:
        return models[name]
    if path.suffix == ".npz":
        return path
    found = [file for file in sorted(path.glob("*.npz")) if isfile(file.with_suffix(".json"))]
    if len(found) != 1:
        known = ", ".join(["posterior", *shipped("point")])
        message = f"{name!r} is no model: expected {known}, the folder of a run of `cavirheo train`, or its .npz file"
        raise InputError(message, "model.unknown")
    return found[0]


def network_name(name: str) -> str:
    """The name of a shipped network, or the whole path of another: other processes have other folders."""
    return name if name in shipped() else str(path_of(name).absolute())
