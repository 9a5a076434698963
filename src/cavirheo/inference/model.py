"""Shipped or user-made network: an .onnx file and the card (.json) beside it, which `cavirheo train` writes.

A model that is not shipped is not trusted: its graph is checked before any of it runs. It may have the operators below
and nothing else (no loops, no functions, no numbers from other files), and none of them may take a shape from the
values of the curve. Then one run under limits (session.py) shows what every later run takes. The file is a message of
protocol buffers: fields with a number and a value, of which some are messages themselves
(https://github.com/onnx/onnx/blob/main/onnx/onnx.proto). Only the few fields that decide are read.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from importlib.resources import files
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field, NonNegativeInt, PositiveInt, ValidationError, model_validator

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, read_bytes, read_object, require, validation_message
from cavirheo.inference.session import session, try_out
from cavirheo.parameters import LOG10, parameter_of, to_natural
from cavirheo.prior import TrainingProblem

DEFAULT = "posterior"
MAX_BYTES, MAX_CARD_BYTES = 100_000_000, 10_000_000  # bytes: largest .onnx file and card
MAX_FIELDS = 300_000  # of a graph; a usual network has some thousand
_ALLOWED = """
Abs Add And ArgMax ArgMin AveragePool BatchNormalization Cast CastLike Ceil Clip Concat Constant ConstantOfShape Conv
Cos CumSum Div Einsum Elu Equal Erf Exp Expand Flatten Floor Gather GatherElements GatherND Gelu Gemm GlobalAveragePool
Greater GreaterOrEqual GroupNormalization HardSigmoid HardSwish Identity InstanceNormalization LayerNormalization
LeakyRelu Less LessOrEqual Log LogSoftmax MatMul Max MaxPool Mean Min Mish Mod Mul Neg Not Or PRelu Pad Pow Range
Reciprocal ReduceL1 ReduceL2 ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum Relu Reshape Round
ScatterElements ScatterND Selu Shape Sigmoid Sign Sin Size Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum
Tan Tanh Tile TopK Transpose Trilu Unsqueeze Where Xor
"""
_OPERATORS = frozenset(_ALLOWED.split())
# indices of the inputs that decide the size of the result
_SIZES = {"ConstantOfShape": (0,), "Range": (0, 1, 2), "Slice": (1, 2, 3, 4), "Pad": (1, 3)}
_SIZES |= dict.fromkeys(("Expand", "Reshape", "Split", "Squeeze", "Tile", "TopK", "Unsqueeze"), (1,))
_SIZES |= {name: (1,) for name in _OPERATORS if name.startswith("Reduce")}

Value = int | memoryview
Fields = Mapping[int, Sequence[Value]]  # all values of a field, by its number
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Reads(BaseModel):
    """The input of a network.

    Attributes:
        name: name of the input.
        shape: shape of the input: "batch" (any number of curves) and the number of frames.
        dtype: type of the numbers.
    """

    name: Literal["radius"]
    shape: tuple[Literal["batch"], PositiveInt]
    dtype: Literal["float32"]


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


class _Trained(BaseModel):
    """How a network was trained.

    Attributes:
        seed: random seed of the training.
        best_epoch: number of the epoch, from 1, whose weights are exported.
    """

    seed: NonNegativeInt
    best_epoch: PositiveInt


class _Data(BaseModel):
    """The training set of a network.

    Attributes:
        n: number of curves in the set.
        seed: random seed of the set.
        sha256: SHA-256 of the content of the set.
        train: number of curves in the training part.
        test: number of curves in the test part.
    """

    n: PositiveInt
    seed: NonNegativeInt
    sha256: Digest
    train: PositiveInt
    test: PositiveInt


class _Score(BaseModel):
    """The accuracy of an output on the curves of the test part.

    Attributes:
        r2: coefficient of determination R², in the scale of the prior.
        median_absolute_error: median absolute error, in the scale of the prior (decades for "log10").
    """

    r2: float
    median_absolute_error: float


class _File(BaseModel):
    """The .onnx file.

    Attributes:
        sha256: SHA-256 of the file, which identifies it.
    """

    sha256: Digest


class ModelCard(BaseModel):
    """The card of a network that gives one value for each output. It has further entries for readers
    (training/train.py).

    Attributes:
        schema_version: number of the schema, 1; its key in the file is `schema`.
        name: name of the network and its files.
        kind: kind of the network: "point".
        material: name of the law.
        problem: prior, medium, grid of times and reference R_max of the training set.
        input: the input: R/R_max at R_max and at equal time steps after it.
        outputs: the outputs.
        training: how the network was trained.
        data: the training set.
        metrics: accuracy on the test part, by output.
        history: losses of every epoch on the "train" and "validation" parts.
        onnx: the file that the card describes.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern="^[a-z0-9][a-z0-9.-]*$")
    kind: Literal["point"]
    material: str
    problem: dict[str, Any]
    input: _Reads
    outputs: list[_Answers] = Field(min_length=1)
    training: _Trained
    data: _Data
    metrics: dict[str, _Score]
    history: dict[Literal["train", "validation"], list[float]] = {}
    onnx: _File

    @model_validator(mode="after")
    def _consistent(self) -> ModelCard:
        problem, names = TrainingProblem.from_dict(self.problem), {output.name for output in self.outputs}
        epochs = {len(losses) for losses in self.history.values()} or {self.training.best_epoch}
        require(self.material == problem.material_name, "its material is not that of its problem")
        require(self.input.shape[1] == problem.grid.frames, "its input has other frames than its problem")
        require(len(names) == len(self.outputs) and names <= {*problem.prior.names}, "outputs are not of its prior")
        require(names <= self.metrics.keys(), "metrics are not of its outputs")
        require(len(epochs) == 1 and min(epochs) >= self.training.best_epoch, "history ends before its best epoch")
        for output in self.outputs:
            fine = output.unit == parameter_of(output.name).unit and (output.scale == "log10") == (LOG10 in output.name)
            require(fine, f"{output.name} has another unit or scale than its name says")
        return self


class _Scores(BaseModel):
    """How a posterior network was trained.

    Attributes:
        samples: number of recordings in the training.
        seconds: wall time of the training, s.
        loss: loss of the exported network on recordings of curves that were not used in the training.
    """

    samples: PositiveInt
    seconds: float
    loss: float


class PosteriorCard(BaseModel):
    """The card of a posterior network. It has further entries for readers (training/train.py).

    Attributes:
        schema_version: number of the schema, 1; its key in the file is `schema`.
        name: name of the network and its files.
        kind: kind of the network: "posterior".
        kinds: (law, bubble) of each model that the network knows, in the order of its input.
        trained: (low, high) of R_max (um), frame interval (us), number of frames and noise over R_max in the training,
            and of the medium's density (kg/m3) and pressure (Pa).
        training: how the network was trained.
        coverage: number of "recordings" that were tested, and "by_slot", for each parameter, the shares of true values
            in the central 50 % and 90 % intervals.
        onnx: the file that the card describes.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern="^[a-z0-9][a-z0-9.-]*$")
    kind: Literal["posterior"]
    kinds: list[tuple[str, str]] = Field(min_length=1)
    trained: dict[str, tuple[float, float]]
    training: _Scores
    coverage: dict[str, Any] = {}
    onnx: _File


class Network:
    """A network that reads R/R_max on the grid of its training problem and gives values in the prior's scale. outputs:
    the names of these values. Raises InputError: the file or its card is missing, damaged or not from this package, the
    file is not the one that its card describes, or it is refused for its content ("graph...") or its demands
    ("model.time", ...)."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, path.stem
        self.card: dict[str, Any] = card(path)
        message = f"{path.stem} gives draws: the paper's networks, which give one value, are needed here"
        require(self.card["kind"] == "point", message, "model.kind")
        self.problem: TrainingProblem = TrainingProblem.from_dict(self.card["problem"])
        self.outputs: tuple[str, ...] = tuple(str(output["name"]) for output in self.card["outputs"])
        self.sha256: str = self.card["onnx"]["sha256"]
        content = checked_content(path, self.sha256, ["radius"], self.problem.grid.frames, len(self.outputs))
        self._run = session(content)

    def __call__(self, features: ArrayLike) -> Floats:
        """Values (curves, outputs) in the prior's scale from R/R_max (curves, frames). Raises InputError: a value is
        not finite ("model.not_finite")."""
        theta = self._run(features)
        with np.errstate(over="ignore"):
            values = [to_natural(name, column) for name, column in zip(self.outputs, theta.T, strict=True)]
        fine = np.isfinite(theta).all() and np.isfinite(values).all()
        message = f"the model {self.path} answers a curve with what is no number: train it anew"
        require(bool(fine), message, "model.not_finite")
        return theta


def checked_content(path: Path, sha256: str, inputs: Sequence[str], frames: int = 0, outputs: int = 0) -> bytes:
    """The content of the .onnx file whose card has this sha256. A file that is not shipped is checked and tried out;
    `check_graph` and session.py describe this and the arguments. Raises InputError as `Network`."""
    content = read_bytes(path, MAX_BYTES)
    digest = hashlib.sha256(content).hexdigest()
    message = f"{path} is not the file that its card describes (sha256 {digest[:12]}...)"
    require(digest == sha256, message, "model.changed")
    if path not in shipped().values():
        try:
            check_graph(content, inputs)
            try_out(content, frames, outputs)
        except InputError as error:
            raise InputError(f"{path} is not run: {error}; export it with `cavirheo train`", error.code) from error
    return content


def check_graph(content: bytes, inputs: Sequence[str] = ("radius",)) -> None:
    """Raises InputError ("graph." and a word): the file has parts that are not allowed, or reads other inputs."""
    try:
        _Graph(content).check(inputs)
    except (LookupError, TypeError, UnicodeDecodeError) as error:  # it ends early; a number is where text belongs
        raise InputError("the file is damaged or not an ONNX model", "graph.damaged") from error


class _Graph:
    def __init__(self, content: bytes) -> None:
        self.fields_left = MAX_FIELDS
        model = self.fields(memoryview(content))
        require(len(model[7]) == 1, f"the file holds {len(model[7])} graphs, not one", "graph.damaged")
        require(not model[20] and not model[25], "the model has functions or a training of its own", "graph.functions")
        self.nodes, self.tensors, sparse = (self.fields(model[7][0])[number] for number in (1, 5, 15))
        require(not sparse, "the model has sparse tensors", "graph.sparse")

    def fields(self, message: Value) -> Fields:
        """The values in a message, by the number of their field."""
        if isinstance(message, int):
            raise TypeError("a number, not a message")
        at = 0
        values: defaultdict[int, list[Value]] = defaultdict(list)
        while at < len(message):
            self.fields_left -= 1
            require(self.fields_left > 0, f"the model has more than {MAX_FIELDS} parts", "graph.size")
            key, at = _varint(message, at)
            if key & 7 == 0:
                number, at = _varint(message, at)
                values[key >> 3].append(number)
                continue
            size, at = _varint(message, at) if key & 7 == 2 else ({1: 8, 5: 4}[key & 7], at)
            values[key >> 3].append(message[at : at + size])
            at += size
            if at > len(message):
                raise IndexError("the message ends too early")
        return values

    def check(self, inputs_of_model: Sequence[str]) -> None:
        constants = {self.tensor_name(tensor) for tensor in self.tensors}
        of_curve = {*inputs_of_model}
        defined = {""} | of_curve | constants
        for node in map(self.fields, self.nodes):
            kind, domain = _text(node[4]), _text(node[7])
            inputs, results = [_text([name]) for name in node[1]], [_text([name]) for name in node[2]]
            foreign = f"the operator {f'{domain}.{kind}'.strip('.')[:60]!r} is not among those that are run (Add, "
            fine = kind in _OPERATORS and domain in ("", "ai.onnx")
            require(fine, f"{foreign}MatMul, Softmax, ...; no loops, nothing random)", "graph.operator")
            for attribute in map(self.fields, node[5]):
                inner = any(attribute[number] for number in (6, 10, 11, 22, 23))  # graphs, and lists of tensors
                require(not inner, f"the operator {kind} holds a graph of its own", "graph.operator")
                for tensor in attribute[5]:
                    self.tensor_name(tensor)
            unknown = ", ".join(sorted({*inputs} - defined))[:60]
            require(not unknown, f"the operator {kind} reads {unknown!r}, which nothing has given", "graph.order")
            sized = of_curve & {inputs[place] for place in _SIZES.get(kind, ()) if place < len(inputs)}
            message = f"the operator {kind} takes a shape from the values of the curve: its memory cannot be foreseen"
            require(not sized, message, "graph.shape")
            defined.update(results)
            if kind not in ("Shape", "Size") and of_curve & {*inputs}:
                of_curve.update({*results} - {""})

    def tensor_name(self, tensor: Value) -> str:
        """The name of a tensor. Raises InputError: its numbers are in another file."""
        fields = self.fields(tensor)
        message = f"the numbers of {_text(fields[8])[:60]!r} are in another file: only a model of one file is run"
        require(not fields[13] and not any(fields[14]), message, "graph.elsewhere")
        return _text(fields[8])


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """An integer of seven bits per byte, the lowest first, and the index after it. Raises IndexError."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at + shift // 7]
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at + shift // 7 + 1
    raise IndexError("a number of more than ten bytes")


def _text(values: Sequence[Value]) -> str:
    value = values[-1] if values else b""
    if isinstance(value, int):
        raise TypeError("a number, not text")
    return bytes(value).decode()


def predict(path: str | Path, features: ArrayLike) -> Floats:
    """The output of the network in the user's own .onnx file, as that of `Network`; no card is needed."""
    return session(read_bytes(path, MAX_BYTES))(features)


def card(path: Path) -> dict[str, Any]:
    """The card beside an .onnx file. Raises InputError: one of the two is missing, or the card is not valid."""
    file = path.with_suffix(".json")
    message = f"a model is an .onnx file with its card beside it; expected {path} and {file}"
    require(isfile(path) and isfile(file), message, "model.missing")  # isfile is False for a name that is too long, too
    content = read_object(file, MAX_CARD_BYTES)
    kind = PosteriorCard if content.get("kind") == "posterior" else ModelCard
    try:
        kind.model_validate(content)
    except ValidationError as error:
        message = f"{file} is not a card of `cavirheo train`: {validation_message(error, kind)}; export it anew"
        raise InputError(message, "model.card") from error
    return content


def shipped(kind: str | None = None) -> dict[str, Path]:
    """Files of the models that come with the package, by name; of all, or of one kind ("point", "posterior")."""
    folder = Path(str(files("cavirheo") / "models"))
    paths = {path.stem: path for path in sorted(folder.glob("*.onnx"))}
    return {name: path for name, path in paths.items() if kind is None or card(path)["kind"] == kind}


def path_of(name: str) -> Path:
    """The file of a shipped model, or the file itself if the name ends in .onnx. Raises InputError."""
    if name.endswith(".onnx"):
        return Path(name)
    models = shipped()
    message = f"unknown model {name!r}; known: {', '.join(models) or 'none'}, or a path to an .onnx file"
    require(name in models, message, "model.unknown")
    return models[name]
