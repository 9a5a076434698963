"""The files of networks that ship with the package or were made by `cavirheo train`: the weights, NAME.npz, and their
card, NAME.json, with the training problem of a network that gives one value for each parameter.

Nothing in them is executed: the file holds plain arrays of numbers, whose sizes are checked before they are read, and
the networks are those of this package.

R/R_max over t* = t/t_c depends on the Cauchy number p_inf/G, the Reynolds number p_inf t_c/mu and the stretch, and less
on R_max itself (docs/method/physics.md, section 1). So all training curves have one R_max, 245 um: 35 um (the R_0 of
the app of the Bubble Dynamics Transformer) times 7 (the mean stretch). A shot is sampled on their grid of t* with its
own t_c, and the answer is scaled back at equal Cauchy and Reynolds numbers (`grid_step`, `to_shot`):

    step_shot = step x t_c,shot/t_c,   G_shot = G x p_inf,shot/p_inf,   mu_shot = mu x (p_inf t_c)_shot/(p_inf t_c)
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from importlib.resources import files
from io import BytesIO
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, Field, ValidationError, model_validator

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, read_bytes, read_object, validation_message
from cavirheo.parameters import LOG10, RADIUS, natural_name, parameter_of, to_natural
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.prior import Prior

if TYPE_CHECKING:
    from cavirheo.physics.simulate import Simulation

MOST_FRAMES = 5_000  # larger training sets would not fit on a machine
MAX_TIME = 1_000.0  # longest time of the frames in t_c
MAX_BYTES, MAX_CARD_BYTES = 8_000_000, 2_000_000  # bytes: largest file of weights, also unpacked, and largest card
MAX_ARRAYS = 5_000  # of a file
MAX_ATTENTION = 50_000_000  # numbers in the attention weights of one curve

Arrays = Mapping[str, NDArray[np.float32]]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Size = Annotated[int, Field(gt=0, le=4096)]


@dataclass(frozen=True, eq=False)
class TrainingProblem:
    """How the curves of a training set are drawn and simulated; stored in the network's card and in the data.

    Attributes:
        material_name: name of the law, "nhkv", ...
        prior: of the parameters of the law and the stretch.
        medium: liquid and gas constants.
        frame_interval: s between the frames of a curve, the first of which is at R_max.
        frames: number of frames.
        reference_max_radius: R_max of all curves, m.

    Raises:
        InputError: unknown material, a prior of other parameters or outside their domains, or invalid R_max or frames.
    """

    material_name: str
    prior: Prior
    medium: Medium = WATER
    frame_interval: float = 1e-6
    frames: int = 100
    reference_max_radius: float = 245e-6

    def __post_init__(self) -> None:
        material, names, radius = self.material_name, self.prior.names, self.reference_max_radius
        if material not in MATERIALS:
            raise InputError(f"unknown material {material!r}; known: {', '.join(MATERIALS)}", "problem.material")
        needed = sorted([*(f.name for f in fields(MATERIALS[material])), "stretch"])
        if sorted(map(natural_name, names)) != needed:
            message = f"material {material!r} needs a prior for {', '.join(needed)} (each with or without log10_), got "
            raise InputError(message + ", ".join(names), "problem.prior")
        if "stretch" not in names or self.prior.bounds("stretch")[0] < 1:
            message = "the stretch R_max/R_0 must be 1 or more and not of log10_, got the prior "
            raise InputError(f"{message}{self.prior.to_dict()}", "problem.prior")
        interval, frames = self.frame_interval, self.frames
        if not (isinstance(frames, int) and 2 <= frames <= MOST_FRAMES and 0 < interval < np.inf):
            message = f"a curve needs a positive frame interval and 2 to {MOST_FRAMES} frames, got "
            raise InputError(f"{message}{interval} s and {frames}", "problem.grid")
        RADIUS.check("reference_max_radius", radius, "problem.max_radius")
        end, scale = float(self.time[-1]), self.medium.time_scale(radius)
        if end > MAX_TIME * scale:
            message = f"the frames end {end:.3g} s after R_max, more than the {MAX_TIME:g} collapse times of "
            raise InputError(f"{message}{scale:.3g} s that are simulated; is a unit wrong?", "problem.grid")
        for ends in (self.prior.low, self.prior.high):
            self.material(ends)  # raises InputError if the law refuses a value

    @property
    def time(self) -> Floats:
        """(frames,) s after R_max."""
        return np.asarray(self.frame_interval * np.arange(self.frames, dtype=float))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, from which `from_dict` makes the same problem again."""
        camera = {"frame_interval": self.frame_interval, "frames": self.frames}
        parts = {"medium": asdict(self.medium), "prior": self.prior.to_dict(), "camera": camera}
        return {"schema": 1, "material": self.material_name, **parts, "reference_max_radius": self.reference_max_radius}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TrainingProblem:
        """The problem from the data of `to_dict`. Raises InputError if a part is missing or unknown."""
        try:
            medium = Medium(**data["medium"], unusual=True)  # checked when the problem was made
            prior, radius = Prior.uniform(data["prior"]), data["reference_max_radius"]
            return cls(data["material"], prior, medium, **data["camera"], reference_max_radius=radius)
        except InputError:
            raise
        except (AttributeError, KeyError, TypeError, IndexError, ValueError, OverflowError) as error:
            message = f"not a problem written by this version of cavirheo: {error}"
            raise InputError(message, "problem.unreadable") from error

    @cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits that change with any part of the problem (the prior's order included)."""
        text = json.dumps(self.to_dict() | {"order": self.prior.names}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def material(self, theta: ArrayLike) -> Material:
        """The material of theta (parameters,) in the prior's scale."""
        values = natural_values(self.prior.names, theta)
        return MATERIALS[self.material_name](**{name: value for name, value in values.items() if name != "stretch"})

    def simulate_many(self, theta: ArrayLike, workers: int | None = None) -> list[Simulation]:
        """The curves of theta (curves, parameters) at the reference R_max, failed ones too (see their status)."""
        from cavirheo.physics.simulate import simulate_many  # it compiles; training does not need it

        rows = np.asarray(theta, dtype=float)
        stretch = rows[:, self.prior.names.index("stretch")]
        shot: dict[str, Any] = {"max_radius": self.reference_max_radius, "stretch": stretch, "time": self.time}
        return simulate_many([self.material(row) for row in rows], workers=workers, medium=self.medium, **shot)

    def grid_step(self, max_radius: float, medium: Medium) -> float:
        """The frame interval (s) that puts a shot of this R_max (m) on the grid in t*."""
        return self.frame_interval * self._time_ratio(max_radius, medium)

    def to_shot(self, values: Mapping[str, float], max_radius: float, medium: Medium) -> dict[str, float]:
        """Values in SI by parameter name for a shot of this R_max (m) from those at the reference scale."""
        pressure = medium.pressure / self.medium.pressure
        ratio = {"shear_modulus": pressure, "viscosity": pressure * self._time_ratio(max_radius, medium)}
        return {name: value * ratio.get(name, 1.0) for name, value in values.items()}

    def _time_ratio(self, max_radius: float, medium: Medium) -> float:
        return medium.time_scale(max_radius) / self.medium.time_scale(self.reference_max_radius)


def natural_values(names: Sequence[str], theta: ArrayLike) -> dict[str, float]:
    """Values in SI by parameter name from theta (names,) in the prior's scale. Raises InputError: another shape."""
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (len(names),):
        raise InputError(f"theta must hold {', '.join(names)}, got shape {theta.shape}", "problem.theta")
    with np.errstate(over="ignore"):
        return {natural_name(name): float(to_natural(name, value)) for name, value in zip(names, theta, strict=True)}


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


def card(path: Path, kind: str | None = None) -> dict[str, Any]:
    """The card beside a file of weights. Raises InputError: one of the two is missing, the card is not valid, or its
    network is not of this kind ("point", "emulator")."""
    file = path.with_suffix(".json")
    if not (isfile(path) and isfile(file)):  # isfile is False for a name that is too long, too
        message = f"a model is an .npz file with its card beside it; expected {path} and {file}"
        raise InputError(message, "model.missing")
    content = read_object(file, MAX_CARD_BYTES)
    model = EmulatorCard if content.get("kind") == "emulator" else ModelCard
    try:
        model.model_validate(content)
    except ValidationError as error:
        message = f"{file} is not a card of `cavirheo train`: {validation_message(error)}; train it anew"
        raise InputError(message, "model.card") from error
    if kind not in (None, content["kind"]):
        message = f"{path} is a network of the kind {content['kind']!r}: one of the kind {kind!r} is needed here"
        raise InputError(message, "model.kind")
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
