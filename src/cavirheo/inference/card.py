"""The card of a model: what `cavirheo train` says of an .onnx file, in the .json beside it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, NonNegativeInt, PositiveInt, model_validator

from cavirheo.errors import require
from cavirheo.parameters import LOG10, about
from cavirheo.problem import TrainingProblem

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Reads(BaseModel):
    """What a network reads.

    Attributes:
        name: of the input.
        shape: "batch" and the number of frames.
        dtype: of the numbers.
    """

    name: Literal["radius"]
    shape: tuple[Literal["batch"], PositiveInt]
    dtype: Literal["float32"]


class _Answers(BaseModel):
    """One number that a network gives.

    Attributes:
        name: of the parameter, in the scale of the prior.
        unit: of the SI value.
        scale: "log10" or "linear".
    """

    name: str
    unit: str
    scale: Literal["log10", "linear"]


class _Trained(BaseModel):
    """How a network was trained.

    Attributes:
        seed: of the training.
        best_epoch: the one that is exported.
    """

    seed: NonNegativeInt
    best_epoch: PositiveInt


class _Data(BaseModel):
    """What a network was trained on.

    Attributes:
        n: curves of the training set.
        seed: of the training set.
        sha256: of its content.
        train: curves that the network saw.
        test: curves that it was tested with.
    """

    n: PositiveInt
    seed: NonNegativeInt
    sha256: Digest
    train: PositiveInt
    test: PositiveInt


class _Score(BaseModel):
    """How well a network answers the curves of the test part.

    Attributes:
        r2: coefficient of determination, in the scale of the prior.
        median_absolute_error: in the scale of the prior.
    """

    r2: float
    median_absolute_error: float


class _File(BaseModel):
    """The .onnx file.

    Attributes:
        sha256: of the file, by which it is known.
    """

    sha256: Digest


class ModelCard(BaseModel):
    """The card of a network that gives one value; a card says more, for people (training/export.py).

    Attributes:
        schema_version: `schema` in the file; always 1.
        name: of the network and its files.
        kind: "point".
        material: the law.
        problem: prior, medium, grid and reference R_max of the training set.
        input: R/R_max at R_max and at equal steps after it.
        outputs: the numbers that it gives.
        training: how it was trained.
        data: what it was trained on.
        metrics: scores by output.
        history: losses of every epoch.
        onnx: the file that the card is of.
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
            fine = output.unit == about(output.name).unit and (output.scale == "log10") == (LOG10 in output.name)
            require(fine, f"{output.name} has another unit or scale than its name says")
        return self


class _Scores(BaseModel):
    """How a posterior network was trained.

    Attributes:
        samples: recordings that it saw.
        seconds: wall time, s.
        loss: of recordings that it was not trained on, at the end.
    """

    samples: PositiveInt
    seconds: float
    loss: float


class PosteriorCard(BaseModel):
    """The card of a posterior network; a card says more, for people (training/export.py).

    Attributes:
        schema_version: `schema` in the file; always 1.
        name: of the network and its files.
        kind: "posterior".
        kinds: (law, bubble) in the order in which the network knows them.
        trained: ranges of R_max (um), frame interval (us), frames, noise over R_max, and of the medium's density
            (kg/m3)
            and pressure (Pa).
        training: how it was trained.
        coverage: share of truths within its intervals, by slot.
        onnx: the file that the card is of.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern="^[a-z0-9][a-z0-9.-]*$")
    kind: Literal["posterior"]
    kinds: list[tuple[str, str]] = Field(min_length=1)
    trained: dict[str, tuple[float, float]]
    training: _Scores
    coverage: dict[str, Any] = {}
    onnx: _File
