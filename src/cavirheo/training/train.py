"""Training and export: from a recipe and a training set to a network's weights and one file of weights with its card.

All random numbers follow from (seed, step): a run that is interrupted and continued ends with the same weights.

Files in the run's folder, each written completely or not at all; tensors have a JSON note, and nothing is pickled:
    last.safetensors   weights and optimiser at the last validation, settings, history
    best.safetensors   weights to export: of the lowest validation loss; for an emulator the averaged ones
    history.jsonl      one line per validation: losses of the training and the validation part, seconds
    test.npz           inputs of the test part, which is used once, at the end, and true values and predictions
    result.json        settings and results of the run, for the card of the exported model (inference/cards.py)
"""

from __future__ import annotations

import json
import math
import platform
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from datetime import UTC, date, datetime
from hashlib import sha256
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic_core import to_json
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, read_object, require
from cavirheo.inference.bdt import Forward
from cavirheo.inference.cards import MAX_BYTES, Arrays, EmulatorCard, Layers, ModelCard, unpack
from cavirheo.inference.emulator import NODES, Emulator, seen
from cavirheo.parameters import LOG10, parameter_of
from cavirheo.training.dataset import Dataset, Indices, load, load_trajectories
from cavirheo.training.muon import Muon
from cavirheo.training.networks import BubbleTransformer, EmulatorNetwork, arrays_of
from cavirheo.training.recipe import WARM_UP, EmulatorRecipe, Recipe, difference
from cavirheo.training.scores import metrics
from cavirheo.training.trajectories import compared_end
from cavirheo.writing.document import atomic_file, writable_folder
from cavirheo.writing.terminal import progress_bar

AVERAGE_DECAY = 0.998
NOTE_KEY = "cavirheo"
LARGEST = 200_000_000  # bytes of a result.json
EVALUATION_BATCH = 512
MOST_COMPARED = 1000  # curves of the test part on which the exported network is compared with the trained one
HELD_OUT = 0.03  # part of the trajectories of an emulator that is held out
LEAST_HELD_OUT, MOST_HELD_OUT = 20, 4000
MOST_FITTED = 12_000  # trajectories that give the principal components
FIRST_FLOOR, LAST_FLOOR = -5.5, -7.5  # log10 of the floor of squared errors, which falls
FALLING = 0.7  # share of the steps in which it does
LATE_WEIGHT = 0.05  # of squared errors after the rebound of the third collapse
FAST = 3.0  # velocity, in R_max/T, from which errors count less
SLOW = 0.03  # least velocity by which an error of the time counts
FRAMES = 100  # of a bubble, of which the errors on the card are
# Largest difference between the exported network and the trained one: rounding to single precision alone moves an
# answer by up to 1e-4 of a decade
TOLERANCE = 5e-4


class Training(ABC):
    """One training in one folder, which continues where it stopped. `history` has a line for each validation."""

    network: nn.Module  # the network that is trained
    average: nn.Module | None = None  # averaged weights, which are exported; None: those of the lowest validation loss
    optimiser: torch.optim.Optimizer  # of the network's weights
    steps: int  # number of steps of the whole training
    validation_interval: int  # steps from one validation, and checkpoint, to the next
    clip: float = math.inf  # largest norm of a gradient
    identity: dict[str, Any]  # identifies the data, which must not change within a run, like the settings

    def __init__(self, recipe: Recipe | EmulatorRecipe, folder: Path, device: torch.device) -> None:
        self.name, self.schedule, self.settings = recipe.export.name, recipe.training, recipe.settings()
        self.folder, self.device, self.step, self.history = folder, device, 0, list[dict[str, Any]]()
        torch.manual_seed(recipe.training.seed)

    @abstractmethod
    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        """Loss of a step, losses (n,) that are reported, and their weight in the reported mean."""

    @abstractmethod
    def history_line(self, losses: Sequence[float]) -> dict[str, Any]:
        """A line of the history: results of a validation, and `losses`, mean training losses since the last line."""

    @abstractmethod
    def result(self) -> dict[str, Any]:
        """Entries of result.json on the exported weights."""

    def run(self, progress: bool) -> dict[str, Any]:
        """Train to the end, write result.json, and return its content."""
        path, best = self.folder / "result.json", self.folder / "best.safetensors"
        self._resume(path)
        if self.step < self.steps or not path.exists():
            path.unlink(missing_ok=True)
            with progress_bar("training", self.steps, visible=progress, unit="steps") as advance:
                advance(self.step)
                while self.step < self.steps:
                    lowest = min((line["validation"] for line in self.history), default=math.inf)
                    advance(0, what=f"training, best validation loss {lowest:.5f}")
                    self._train_to_validation(advance)
            weights, note = read_tensors(best)
            with damaged_as_input_error(best):
                self.exported.load_state_dict(weights)
            cuda = self.device.type == "cuda"
            document = self.settings | {
                "kind": "training",
                "schema": 1,
                "version": version("cavirheo"),
                "command": f"cavirheo train (recipe of {self.name})",
                "epochs": len(self.history),
                "best_epoch": note["epoch"],
                "best_validation_loss": note["validation_loss"],
                "seconds": round(sum(line["seconds"] for line in self.history), 1),
                "device": torch.cuda.get_device_name(self.device) if cuda else self.device.type,
                "parameters": sum(p.numel() for p in self.network.parameters()),
                "history": {part: [line[part] for line in self.history] for part in ("train", "validation")},
                "torch": torch.__version__,
            }
            write_text(path, as_json(document | self.result(), indent=2) + "\n")
        return read_result(self.folder)

    @property
    def exported(self) -> nn.Module:
        return self.average or self.network

    @property
    def _networks(self) -> nn.ModuleDict:
        return nn.ModuleDict({"network": self.network} | ({"mean": self.average} if self.average else {}))

    def _train_to_validation(self, advance: Callable[..., None]) -> None:
        """Take the steps to the next validation, validate, and write a checkpoint."""
        started, summed, weights = time.perf_counter(), torch.zeros(1, device=self.device), 0
        while True:
            for group in self.optimiser.param_groups:
                group["lr"] = self.schedule.learning_rate(self.step, self.steps)
            loss, reported, weight = self.loss(self.step)
            self.optimiser.zero_grad()
            loss.backward()
            if self.clip < math.inf:
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.clip)
            self.optimiser.step()
            summed, weights, self.step = summed + reported.detach() * weight, weights + weight, self.step + 1
            if self.average is not None:
                share = min(AVERAGE_DECAY, self.step / (self.step + 10.0))
                with torch.no_grad():
                    torch._foreach_lerp_(list(self.average.parameters()), list(self.network.parameters()), 1.0 - share)
            advance(1)
            if self.step % self.validation_interval == 0 or self.step == self.steps:
                break
        line = self.history_line([value / weights for value in summed.tolist()])
        message = f"the loss is not finite after {self.step} steps: lower lr (rate) or lengthen the warm-up"
        require(math.isfinite(line["train"]) and math.isfinite(line["validation"]), message)
        self.history.append(line | {"seconds": round(time.perf_counter() - started, 3)})
        if self.average is not None or line["validation"] <= min(line["validation"] for line in self.history):
            note = self.settings | {"epoch": len(self.history), "validation_loss": line["validation"]}
            write_tensors(self.folder / "best.safetensors", self.exported.state_dict(), note)
        moments = self.optimiser.state_dict()["state"].items()
        state = {f"moments.{index}.{name}": tensor for index, values in moments for name, tensor in values.items()}
        note = {"identity": self.settings | self.identity, "history": self.history, "step": self.step}
        write_tensors(self.folder / "last.safetensors", state | self._networks.state_dict(), note)
        write_text(self.folder / "history.jsonl", "".join(as_json(entry) + "\n" for entry in self.history))

    def _resume(self, result: Path) -> None:
        """Load the last checkpoint, if there is one. Raises InputError: it is damaged, of another run, or lost."""
        path = self.folder / "last.safetensors"
        if not path.exists():
            message = f"{self.folder} holds a result but not the run's {path.name}: use another folder"
            require(not result.exists(), message)
            return
        state, note = read_tensors(path)
        with damaged_as_input_error(path):
            changed = difference(note["identity"], json.loads(json.dumps(self.settings | self.identity)))
            hint = "use another folder, or the recipe and data that it was begun with"
            require(not changed, f"{self.folder} holds another run ({changed}): {hint}", "training.another_run")
            losses = ("train", "validation", "seconds")
            self.history = [{**line, **{part: float(line[part]) for part in losses}} for line in note["history"]]
            self.step = int(note["step"])
            moments: dict[int, dict[str, Tensor]] = {}
            for key in [key for key in state if key.startswith("moments.")]:
                _, index, name = key.split(".")
                moments.setdefault(int(index), {})[name] = state.pop(key)
            self.optimiser.load_state_dict(self.optimiser.state_dict() | {"state": moments})
            self._networks.load_state_dict(state)


class PointTraining(Training):
    """Training by the mean squared error on curves on a grid of times. All random numbers of an epoch (order of curves,
    dropout) follow from (seed, epoch). Raises InputError: the set is of another problem, or has too few curves."""

    def __init__(self, recipe: Recipe, data: Dataset, folder: Path, device: torch.device) -> None:
        super().__init__(recipe, folder, device)
        self.recipe, self.data, problem = recipe, data, recipe.problem
        message = f"the training set was made for problem {data.problem.id}, the recipe is of {problem.id}: generate "
        require(data.problem.id == problem.id, f"{message}the data with this recipe", "training.another_problem")
        self.network = self.transformer = BubbleTransformer.of(recipe).to(device)
        # R/R_max (curves, frames) and standardised target (curves, outputs) of "train", "validation", "test"
        self.parts: dict[str, tuple[Tensor, Tensor]] = {}
        for name, curves in data.split(self.schedule.seed).items():
            require(len(curves) >= 2, f"too few usable curves in the {name} part of {len(data.theta)}")
            truth = torch.tensor(data.truth(recipe.outputs)[curves]).float().to(device)
            target = (truth - self.transformer.mean) / self.transformer.std
            self.parts[name] = torch.from_numpy(data.radius[curves]).to(device), target
        self.validation_interval = math.ceil(len(self.parts["train"][0]) / self.schedule.batch)
        self.steps = recipe.training.epochs * self.validation_interval
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=recipe.training.lr)
        self.batches: Sequence[Tensor] = ()
        self.identity = {"data": data.sha256}

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        epoch, place = divmod(step, self.validation_interval)
        radius, target = self.parts["train"]
        if place == 0:
            schedule = self.recipe.training
            torch.manual_seed(int(np.random.SeedSequence([schedule.seed, epoch]).generate_state(1)[0]))
            self.batches = torch.randperm(len(radius)).split(schedule.batch)
            self.network.train(epoch < (schedule.dropout_epochs or schedule.epochs))  # switches only dropout
        batch = self.batches[place].to(self.device)
        loss = functional.mse_loss(self.network(radius[batch]), target[batch])
        return loss, loss[None], len(batch)

    def history_line(self, losses: Sequence[float]) -> dict[str, Any]:
        validation = float(functional.mse_loss(self._predict("validation"), self.parts["validation"][1]))
        return {"epoch": self.step // self.validation_interval, "train": losses[0], "validation": validation}

    def result(self) -> dict[str, Any]:
        """Entries of result.json; the test part is used here alone."""
        data, (radius, target) = self.data, self.parts["test"]
        natural = (t * self.transformer.std + self.transformer.mean for t in (target, self._predict("test")))
        truth, predicted = (values.cpu().numpy() for values in natural)
        test = {"inputs": radius.cpu().numpy(), "truth": truth, "predicted": predicted}
        write_arrays(self.folder / "test.npz", test)
        origin = {"n": len(data.theta), "seed": data.seed, "sha256": data.sha256, "failures": data.failures}
        parts = {part: len(radius) for part, (radius, _) in self.parts.items()}
        return {
            "problem_id": self.recipe.problem.id,
            "data": origin | {"made_by": data.made_by} | parts,
            "metrics": metrics(self.recipe.outputs, truth, predicted),
        }

    @torch.inference_mode()
    def _predict(self, part: str) -> Tensor:
        self.network.eval()
        return torch.cat([self.network(batch) for batch in self.parts[part][0].split(EVALUATION_BATCH)])


class EmulatorTraining(Training):
    """Training on the trajectories of simulated bubbles; the weights are averaged over the steps. All random numbers
    follow from (seed, step). The loss of a trajectory is the logarithm of its mean squared error above a floor, which
    falls: bubbles that are hard do not decide alone. The error of a node is that of R at its time t, so what is wrong
    in t counts by the velocity, or by SLOW where that is slower, so that slow bubbles do not end early; it counts less
    where the wall is fast, and after the rebound of the third collapse."""

    validation_interval, clip = 500, 1.0

    def __init__(self, recipe: EmulatorRecipe, data_dir: str | Path, folder: Path, device: torch.device) -> None:
        super().__init__(recipe, folder, device)
        self.curves, origin = load_trajectories(data_dir)
        self.steps = recipe.training.steps
        n = len(self.curves["inputs"])
        held_out = min(max(round(HELD_OUT * n), LEAST_HELD_OUT), MOST_HELD_OUT)
        if n < held_out + recipe.network.components:
            components = recipe.network.components
            message = f"{components} components need {LEAST_HELD_OUT} trajectories more; the data have {n}"
            raise InputError(message, "training.few")
        self.train = n - held_out  # the others are the last: other laws in other media
        self.held_out = np.arange(self.train, n)
        self.origin = origin | {"train": self.train, "test": held_out}
        self.identity = {"data": origin["sha256"]}
        network = EmulatorNetwork(recipe.network)
        first = slice(0, min(self.train, MOST_FITTED))
        trajectories = np.hstack([self.curves["radius"][first], self.curves["time"][first]]).astype(float)
        network.fit(self.curves["inputs"][: self.train].astype(float), trajectories)
        self.network = network.to(device)
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimiser = Muon(self.network.parameters(), recipe.training.rate)

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        rng = np.random.default_rng([self.schedule.seed, step])
        rows = rng.integers(self.train, size=self.schedule.batch)
        inputs, truth, weight = self._batch(rows)
        predicted = self.network(inputs)
        squared = squared_errors(predicted, truth, weight)
        reported = torch.median(torch.sqrt(squared))[None]
        if step < WARM_UP:
            return squared.mean() + functional.mse_loss(predicted, truth), reported, 1
        floor = 10.0 ** (FIRST_FLOOR + (LAST_FLOOR - FIRST_FLOOR) * min(1.0, step / (FALLING * self.steps)))
        return torch.log(squared + floor).mean(), reported, 1

    def _batch(self, rows: Indices) -> tuple[Tensor, Tensor, Tensor]:
        """Inputs (k, INPUTS), R/R_max and t/T (k, 2 NODES), and weights (k, NODES) of bubbles."""
        radius = self.curves["radius"][rows]
        counts = np.arange(NODES) <= compared_end(radius)[:, None]
        arrays = self.curves["inputs"][rows], np.hstack([radius, self.curves["time"][rows]])
        weight = np.where(counts, 1.0, LATE_WEIGHT).astype(np.float32)
        inputs, truth, weights = (torch.from_numpy(array).to(self.device) for array in (*arrays, weight))
        return inputs, truth, weights

    @torch.inference_mode()
    def history_line(self, losses: Sequence[float]) -> dict[str, Any]:
        """A line of the history, with quantiles of the error of the averaged weights on bubbles that are held out."""
        inputs, truth, weight = self._batch(self.held_out)
        errors = torch.sqrt(squared_errors(self.exported(inputs), truth, weight))
        middle, p90, p99 = (float(torch.quantile(errors, level)) for level in (0.5, 0.9, 0.99))
        samples = self.step * self.schedule.batch
        line = {"step": self.step, "samples": samples, "train": losses[0], "validation": middle}
        return line | {"p90": p90, "p99": p99}

    @torch.inference_mode()
    def result(self) -> dict[str, Any]:
        """Entries of result.json; the errors are of frames at equal times, on bubbles that are held out."""
        inputs, truth, _ = self._batch(self.held_out)
        predicted = self.exported(inputs)
        write_arrays(self.folder / "test.npz", {"inputs": inputs[:MOST_COMPARED].cpu().numpy()})
        errors = frame_errors(truth.cpu().numpy(), predicted.cpu().numpy())
        quantiles = np.quantile(errors, (0.5, 0.9, 0.95, 0.99)).tolist()
        names = ("median", "p90", "p95", "p99")
        return {"data": self.origin, "errors": dict(zip(names, (float(f"{q:.3g}") for q in quantiles), strict=True))}


def squared_errors(predicted: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """(k,) mean squared error of R/R_max along trajectories (k, 2 NODES), with weights (k, NODES)."""
    radius, time = truth.chunk(2, dim=1)
    off_radius, off_time = (predicted - truth).chunk(2, dim=1)
    velocity = torch.gradient(radius, dim=1)[0] / torch.gradient(time, dim=1)[0].clamp(min=1e-6)
    off = (off_radius - velocity * off_time) ** 2 / (1.0 + (velocity / FAST) ** 2) + (SLOW * off_time) ** 2
    return (off * weight).mean(dim=1)


def frame_errors(truth: NDArray[np.float32], emulated: NDArray[np.float32]) -> Floats:
    """(k,) RMS error over R_max of FRAMES at equal times, up to the rebound that follows the third collapse."""
    radius, time = np.hsplit(truth, 2)
    end = np.take_along_axis(time, compared_end(radius)[:, None], axis=1)
    expected, found = np.empty((2, len(truth), FRAMES))
    instants, nothing = np.linspace(0.0, 1.0, FRAMES), np.zeros(len(truth))
    for curves, frames in ((truth, expected), (emulated, found)):
        seen(curves, 1.0 / end[:, 0].astype(float), instants, np.zeros(1), np.ones(1), nothing, frames)
    return np.asarray(np.sqrt(np.mean((found - expected) ** 2, axis=1)))


def write_tensors(path: Path, tensors: Mapping[str, Tensor], note: Mapping[str, Any]) -> None:
    """Write tensors and a note on them into one file."""
    content = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with atomic_file(path) as temporary:
        try:
            save_file(content, temporary, metadata={NOTE_KEY: as_json(note)})
        except SafetensorError as error:  # a full disk
            raise OSError(str(error)) from error


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read the tensors and the note of `write_tensors`. Raises InputError: the file does not hold them."""
    with damaged_as_input_error(path):
        if not path.is_file():  # reading a pipe would wait for ever
            raise OSError("no file")
        with safe_open(path, framework="pt") as file:
            note: dict[str, Any] = json.loads(file.metadata()[NOTE_KEY])
            return {name: file.get_tensor(name) for name in list(file.keys())}, note


@contextmanager
def damaged_as_input_error(path: Path) -> Iterator[None]:
    """Context in which the content of `path` is used; turns any error into an InputError on this file."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # libraries raise nearly any error for a damaged file
        reason = str(error).partition("\n")[0]
        message = f"{path} is damaged or not of this run ({reason}); delete its folder, or use another, and train anew"
        raise InputError(message, "training.checkpoint") from error


def read_result(run: Path) -> dict[str, Any]:
    """Content of the result.json of a finished run. Raises InputError: there is none, or it is damaged."""
    try:
        return read_object(run / "result.json", LARGEST)
    except InputError as error:
        hint = "finish the run with `cavirheo train`; if the file is damaged, delete it first"
        raise InputError(f"{error}; {hint}", "export.unfinished") from error


def as_json(content: Mapping[str, Any], indent: int | None = None) -> str:
    """The text of a JSON object, in which numbers that are not finite are null."""
    return to_json(content, indent=indent, inf_nan_mode="null").decode()


def write_text(path: Path, text: str) -> None:
    """Write text into a file, completely or not at all."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays into an .npz file, completely or not at all."""
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def train(
    recipe: Recipe | EmulatorRecipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train the recipe's network, or continue the run in `out_dir`; returns the content of its result.json.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one).

    Raises InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    gpus = torch.cuda.device_count()
    devices = ["cpu", *["cuda"][:gpus], *(f"cuda:{k}" for k in range(gpus))]
    if device is not None and device not in devices:
        message = f"there is no device {device!r} for torch {torch.__version__} here; there is {', '.join(devices)}"
        raise InputError(message, "training.device")
    chosen = torch.device(device or ("cuda" if gpus else "cpu"))
    with writable_folder(out_dir) as folder, torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        if isinstance(recipe, Recipe):
            return PointTraining(recipe, load(data_dir), folder, chosen).run(progress)
        return EmulatorTraining(recipe, data_dir, folder, chosen).run(progress)


def export(
    recipe: Recipe | EmulatorRecipe, run_dir: str | Path, out_dir: str | Path, *, card_date: date | None = None
) -> Path:
    """Write NAME.npz and NAME.json for a finished run; returns the path of NAME.npz. card_date: date on the card.

    Raises:
        InputError: the run is not finished, or is not of this recipe; or its weights take more than 8 MB.
        RuntimeError: what numpy computes from the file differs from the trained network by more than TOLERANCE.
    """
    run = Path(run_dir)
    result = read_result(run)
    changed = difference(result, recipe.settings())
    require(not changed, f"{run} was not trained with this recipe: {changed}", "export.another_recipe")
    with damaged_as_input_error(run / "best.safetensors"):
        network = load_network(recipe, run / "best.safetensors")
    with damaged_as_input_error(run / "test.npz"), np.load(run / "test.npz", allow_pickle=False) as test:
        inputs = test["inputs"][:MOST_COMPARED]
    stream, arrays = BytesIO(), dict[str, Any](arrays_of(network))
    np.savez(stream, **arrays)
    content = stream.getvalue()
    if len(content) > MAX_BYTES:
        message = f"the weights take {len(content) / 1e6:.1f} MB, and {MAX_BYTES / 1e6:g} MB are read: train fewer"
        raise InputError(message, "export.size")
    with torch.inference_mode():
        expected = network.answers(torch.from_numpy(inputs)).numpy()
    deviation = float(np.abs(computed(recipe, unpack(content), inputs) - expected).max())
    if not deviation <= TOLERANCE:
        raise RuntimeError(f"exported and trained network differ by {deviation:.2g}, more than {TOLERANCE:g}")
    packages = {package: version(package) for package in ("cavirheo", "numpy")}
    with writable_folder(out_dir) as folder, damaged_as_input_error(run / "result.json"):
        target = folder / f"{recipe.export.name}.npz"
        about = {
            "schema": 2,
            "name": target.stem,
            **(_point_entries(recipe, result) if isinstance(recipe, Recipe) else _emulator_entries(result)),
            "weights": {"sha256": sha256(content).hexdigest(), "largest_difference_from_torch": deviation},
            "versions": {"python": platform.python_version(), "torch": result["torch"], **packages},
            "license": "MIT",
            "date": (card_date or datetime.now(UTC).date()).isoformat(),
        }
        kind: Any = ModelCard if isinstance(recipe, Recipe) else EmulatorCard
        kind.model_validate(about)
        with atomic_file(target) as temporary:
            temporary.write_bytes(content)
        text = as_json(about, indent=2)
        # put each list of numbers or words on one line
        text = re.sub(r"\[\s+([^][{}]+?)\s+\]", lambda match: f"[{' '.join(match[1].split())}]", text)
        write_text(target.with_suffix(".json"), text + "\n")
    return target


def load_network(recipe: Recipe | EmulatorRecipe, checkpoint: Path) -> BubbleTransformer | EmulatorNetwork:
    """The network of a best.safetensors, in evaluation mode."""
    weights, _ = read_tensors(checkpoint)
    network = BubbleTransformer.of(recipe) if isinstance(recipe, Recipe) else EmulatorNetwork(recipe.network)
    network.load_state_dict(weights)
    return network.eval()


def computed(recipe: Recipe | EmulatorRecipe, arrays: Arrays, inputs: Any) -> Floats:
    """What numpy computes from the arrays of a file of weights."""
    if isinstance(recipe, EmulatorRecipe):
        return np.asarray(Emulator(arrays).trajectories(inputs))
    layers = Layers.model_validate(recipe.network.model_dump())
    return Forward(layers, len(recipe.outputs), arrays)(inputs.astype(float))


def _point_entries(recipe: Recipe, result: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of the card on a network that gives one value, and on its training."""
    problem = recipe.problem
    meaning = "R/R_max at R_max and at equal steps after it; the step is grid_step(R_max, medium)"
    training = {key: result[key] for key in ("best_epoch", "best_validation_loss", "seconds", "device")}
    scales = {output: "log10" if output.startswith(LOG10) else "linear" for output in recipe.outputs}
    return {
        "kind": "point",  # one value per output, no uncertainty
        "material": problem.material_name,
        "problem_id": problem.id,
        "problem": problem.to_dict(),
        "input": {"name": "radius", "shape": ["batch", problem.grid.frames], "meaning": meaning},
        "outputs": [{"name": name, "unit": parameter_of(name).unit, "scale": scale} for name, scale in scales.items()],
        "network": result["network"] | {"parameters": result["parameters"]},
        "training": result["training"] | training,
        # for the figure of the losses; with all their digits they would be most of the card
        "history": {part: [float(f"{loss:.5g}") for loss in losses] for part, losses in result["history"].items()},
        "data": result["data"],
        "metrics": result["metrics"],  # of the test part
    }


def _emulator_entries(result: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of the card on an emulator, and on its training."""
    training = {key: result[key] for key in ("seconds", "device")}
    return {
        "kind": "emulator",
        "domain": result["domain"],
        "network": result["network"] | {"parameters": result["parameters"]},
        "training": result["training"] | training,
        "data": result["data"],
        "errors": result["errors"],  # of the test part
    }
