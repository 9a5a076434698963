"""Training and export: from a recipe and a training set to a network's weights and one .onnx file with its card.

All random numbers follow from (seed, step): a run that is interrupted and continued ends with the same weights.

Files in the run's folder, each written completely or not at all; tensors have a JSON note, and nothing is pickled:
    last.safetensors   weights and optimiser at the last validation, settings, history
    best.safetensors   weights to export: of the lowest validation loss; for a posterior network the averaged ones
    history.jsonl      one line per validation: losses of the training and the validation part, seconds
    test.npz           curves, true values and predictions of the test part, which is used once, at the end
    result.json        settings and results of the run, for the card of the exported model (inference/model.py)
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
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from pydantic_core import to_json
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.errors import InputError, read_object, require, sha256
from cavirheo.inference.model import ModelCard, PosteriorCard, check_graph, predict
from cavirheo.inference.posterior_network import COORDINATES, INPUTS, SIZE, coordinate_indices
from cavirheo.inference.session import onnx_session
from cavirheo.parameters import LOG10, parameter_of
from cavirheo.physics.media import WATER
from cavirheo.prior import TrainingProblem
from cavirheo.training import networks
from cavirheo.training.dataset import Dataset, Indices, load, load_curves
from cavirheo.training.evaluate import metrics
from cavirheo.training.networks import BubbleTransformer, PosteriorNetwork, Unstandardised, scaling
from cavirheo.training.recipe import NetworkTable, PosteriorRecipe, Recipe, difference
from cavirheo.training.recordings import MAX_FRAMES, MAX_INTERVAL, MIN_FRAMES, MIN_INTERVAL, Columns, FilmedBatch, film
from cavirheo.writing.document import atomic_file, writable_folder
from cavirheo.writing.terminal import progress_bar

Network = TypeVar("Network", bound=nn.Module)
AVERAGE_DECAY = 0.999
NOTE_KEY = "cavirheo"
LARGEST = 200_000_000  # bytes of a result.json
EVALUATION_BATCH = 512
VALIDATION = 0.03  # part of the curves of a posterior network that is held out for validation
MOST_HELD_OUT = 4000  # largest number of held-out curves, whose recordings are all in memory
LEAST_VALIDATED = 100  # smallest number of their recordings, including some without a readable R_max
KIND_LOSS_WEIGHT = 0.1  # weight of the loss of the classification of law and bubble
COVERAGE_DRAWS = 300  # of each recording, from which the coverage is computed
# Largest difference between the exported model and the trained one, in the prior's scale: rounding to single precision
# alone moves an answer by up to 1e-4 of a decade
TOLERANCE = 5e-4
POSTERIOR_TOLERANCE = 0.05  # the same of a log density per coordinate, for weights at half precision


class Training(ABC, Generic[Network]):
    """One training in one folder, which continues where it stopped. `history` has a line for each validation."""

    network: Network  # the network that is trained
    average: Network | None = None  # with averaged weights, to export; None: export those of the lowest validation loss
    optimiser: torch.optim.Optimizer  # of the network's weights
    steps: int  # number of steps of the whole training
    validation_interval: int  # steps from one validation, and checkpoint, to the next
    clip: float = math.inf  # largest norm of a gradient
    identity: dict[str, Any]  # identifies the data, which must not change within a run, like the settings

    def __init__(self, recipe: Recipe | PosteriorRecipe, folder: Path, device: torch.device) -> None:
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
    def exported(self) -> Network:
        return self.network if self.average is None else self.average

    @property
    def _networks(self) -> nn.ModuleDict:
        networks: dict[str, nn.Module] = {"network": self.network}
        return nn.ModuleDict(networks if self.average is None else networks | {"mean": self.average})

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
        adam = self.optimiser.state_dict()["state"].items()
        state = {f"adam.{index}.{name}": tensor for index, values in adam for name, tensor in values.items()}
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
            adam: dict[int, dict[str, Tensor]] = {}
            for key in [key for key in state if key.startswith("adam.")]:
                _, index, name = key.split(".")
                adam.setdefault(int(index), {})[name] = state.pop(key)
            self.optimiser.load_state_dict(self.optimiser.state_dict() | {"state": adam})
            self._networks.load_state_dict(state)


class PointTraining(Training[BubbleTransformer]):
    """Training by the mean squared error on curves on a grid of times. All random numbers of an epoch (order of curves,
    dropout) follow from (seed, epoch). Raises InputError: the set is of another problem, or has too few curves."""

    def __init__(self, recipe: Recipe, data: Dataset, folder: Path, device: torch.device) -> None:
        super().__init__(recipe, folder, device)
        self.recipe, self.data, problem = recipe, data, recipe.problem
        message = f"the training set was made for problem {data.problem.id}, the recipe is of {problem.id}: generate "
        require(data.problem.id == problem.id, f"{message}the data with this recipe", "training.another_problem")
        self.mean, self.std = scaling(problem.prior, recipe.outputs)
        target = (torch.tensor(data.truth(recipe.outputs)).float() - self.mean) / self.std
        split = data.split(self.schedule.seed)
        for name, curves in split.items():
            require(len(curves) >= 2, f"too few usable curves in the {name} part of {len(target)}")
        # indices (curves,) and target (curves, outputs) of "train", "validation", "test"; radii stay on the disk
        self.parts = {name: (i, target[i].to(device)) for name, i in split.items()}
        self.validation_interval = math.ceil(len(split["train"]) / self.schedule.batch)
        self.steps = recipe.training.epochs * self.validation_interval
        self.network = BubbleTransformer(recipe.network, problem.grid.frames, len(recipe.outputs)).to(device)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=recipe.training.lr)
        self.batches: Sequence[Tensor] = ()
        self.identity = {"data": data.sha256}

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        epoch, place = divmod(step, self.validation_interval)
        curves, target = self.parts["train"]
        if place == 0:
            schedule = self.recipe.training
            torch.manual_seed(int(np.random.SeedSequence([schedule.seed, epoch]).generate_state(1)[0]))
            self.batches = torch.randperm(len(curves)).split(schedule.batch)
            self.network.train(epoch < (schedule.dropout_epochs or schedule.epochs))  # switches only dropout
        batch = self.batches[place]
        loss = functional.mse_loss(self.network(self._radius(curves[batch.numpy()])), target[batch.to(self.device)])
        return loss, loss[None], len(batch)

    def history_line(self, losses: Sequence[float]) -> dict[str, Any]:
        validation = float(functional.mse_loss(self._predict("validation"), self.parts["validation"][1]))
        return {"epoch": self.step // self.validation_interval, "train": losses[0], "validation": validation}

    def result(self) -> dict[str, Any]:
        """Entries of result.json; the test part is used here alone."""
        data, (curves, target) = self.data, self.parts["test"]
        truth, predicted = ((t * self.std + self.mean).numpy() for t in (target.cpu(), self._predict("test").cpu()))
        with atomic_file(self.folder / "test.npz") as temporary, temporary.open("wb") as file:
            np.savez(file, radius=data.radius[curves], truth=truth, predicted=predicted)
        origin = {"n": len(data.theta), "seed": data.seed, "sha256": data.sha256, "failures": data.failures}
        parts = {part: len(curves) for part, (curves, _) in self.parts.items()}
        return {
            "problem_id": self.recipe.problem.id,
            "data": origin | {"made_by": data.made_by} | parts,
            "metrics": metrics(self.recipe.outputs, truth, predicted),
        }

    def _radius(self, curves: Indices) -> Tensor:
        """Radii (curves, frames) of these curves."""
        return torch.from_numpy(self.data.radius[curves]).to(self.device)

    @torch.inference_mode()
    def _predict(self, part: str) -> Tensor:
        self.network.eval()
        curves, _ = self.parts[part]
        starts = range(0, len(curves), EVALUATION_BATCH)
        return torch.cat([self.network(self._radius(curves[start : start + EVALUATION_BATCH])) for start in starts])


class PosteriorTraining(Training[PosteriorNetwork]):
    """Training by the negative log density of the true values, on new recordings at each step; the weights are
    averaged over the steps. All random numbers follow from (seed, step)."""

    validation_interval, clip = 800, 2.0

    def __init__(self, recipe: PosteriorRecipe, curves: Columns, folder: Path) -> None:
        super().__init__(recipe, folder, torch.device("cpu"))
        schedule = recipe.training
        self.curves, self.steps = curves, schedule.steps
        self.kinds = [(law, bubble) for law, bubble, _ in recipe.problem.kinds]
        self.network = PosteriorNetwork(len(self.kinds), recipe.network)
        self.average = deepcopy(self.network).requires_grad_(False)
        weights, decay = self.network.parameters(), schedule.decay
        self.optimiser = torch.optim.AdamW(weights, schedule.rate, weight_decay=decay, fused=True)
        self.mask = torch.zeros(len(self.kinds), len(COORDINATES))  # which coordinates a kind has
        for i, kind in enumerate(self.kinds):
            self.mask[i, coordinate_indices(*kind)] = 1.0
        n = len(curves["kind"])
        require(n >= 2, f"a posterior network needs 2 curves or more, one of them for validation; the data have {n}")
        self.identity = {"curves": n}
        first_held_out = max(min(round((1.0 - VALIDATION) * n), n - 1), n - MOST_HELD_OUT)
        self.train, self.held_out = np.arange(first_held_out), np.arange(first_held_out, n)
        repeated = np.resize(self.held_out, max(len(self.held_out), LEAST_VALIDATED))  # each several times if few
        self.validation = film(curves, repeated, 2**31 - 1)

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        batch = self._batch(step)
        kind = torch.from_numpy(batch.kind)
        encoded, kind_score = self.network.encode(torch.from_numpy(batch.inputs))
        density = self.network.log_density(encoded, kind, torch.from_numpy(batch.z))
        loss = -(density * self.mask[kind]).sum(dim=1).mean()
        kind_loss = functional.cross_entropy(kind_score, kind)
        return loss + KIND_LOSS_WEIGHT * kind_loss, torch.stack([loss, kind_loss]).double(), 1

    def _batch(self, step: int) -> FilmedBatch:
        """The recordings of a step."""
        rng = np.random.default_rng([self.schedule.seed, step])
        size, parts = self.schedule.batch, list[FilmedBatch]()
        while (count := sum(len(part.z) for part in parts)) < size:
            index = rng.choice(self.train, int(1.8 * (size - count)) + 32)
            parts.append(film(self.curves, index, int(rng.integers(2**31 - 1))))
        return FilmedBatch(*(np.concatenate(column)[:size] for column in zip(*parts, strict=True)))

    @torch.inference_mode()
    def history_line(self, losses: Sequence[float]) -> dict[str, Any]:
        """A line of the history, with losses of the averaged weights on recordings of held-out curves."""
        kind, inputs, z = (torch.from_numpy(getattr(self.validation, name)) for name in ("kind", "inputs", "z"))
        encoded, kind_score = self.exported.encode(inputs)
        density = self.exported.log_density(encoded, kind, z) * self.mask[kind]
        by_slot = [float(-density[:, k][self.mask[kind][:, k] > 0].mean()) for k in range(len(COORDINATES))]
        by_kind = [float(-density[kind == k].sum(dim=1).mean()) for k in range(len(self.kinds))]
        return {
            "step": self.step,
            "samples": self.step * self.schedule.batch,
            "train": losses[0],
            "guess": losses[1],
            "validation": float(-density.sum(dim=1).mean()),
            "right_kind": float((kind_score.argmax(dim=1) == kind).float().mean()),
            "slots": [round(loss, 3) for loss in by_slot],
            "kinds": [round(loss, 3) for loss in by_kind],
        }

    @torch.inference_mode()
    def result(self) -> dict[str, Any]:
        """Entries of result.json, with the coverage by slot: the shares of recordings whose true value lies in the
        central 50 and 90 % of the network's draws."""
        recordings, one_hot, nothing = self.validation, torch.eye(len(self.kinds)), torch.zeros(len(COORDINATES))
        rng, sequential = torch.Generator().manual_seed(0), networks.SequentialDraws(self.exported.eval())
        below = np.full(recordings.z.shape, np.nan)
        for i, kind in enumerate(recordings.kind.tolist()):
            uniform = torch.rand((COVERAGE_DRAWS, len(COORDINATES), self.exported.parts), generator=rng).clamp(1e-9)
            normal = torch.randn((COVERAGE_DRAWS, len(COORDINATES)), generator=rng)
            inputs = torch.from_numpy(recordings.inputs[i : i + 1])
            has, choice = self.mask[kind], -torch.log(-torch.log(uniform))
            z, _, _ = sequential(inputs, one_hot[kind : kind + 1], has, has, choice, normal, normal, nothing)
            places = coordinate_indices(*self.kinds[kind])
            below[i, places] = (z < torch.from_numpy(recordings.z[i])).float().mean(dim=0)[places]
        by_slot = {}
        for name, shares in zip(COORDINATES, below.T, strict=True):
            if len(off := np.abs(2.0 * shares[np.isfinite(shares)] - 1.0)):
                by_slot[name] = {str(level): round(float(np.mean(off < level / 100)), 4) for level in (50, 90)}
        return {
            "samples": self.history[-1]["samples"],
            "curves": len(self.train),
            "held_out": len(self.held_out),
            "loss_by_kind": self.history[-1]["kinds"],
            "coverage": {"recordings": len(recordings.kind), "by_slot": by_slot},
        }


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


def train(
    recipe: Recipe | PosteriorRecipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train the recipe's network, or continue the run in `out_dir`; returns the content of its result.json.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one, and the processor for a posterior network).

    Raises InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    gpus = torch.cuda.device_count()
    devices = ["cpu", *["cuda"][:gpus], *(f"cuda:{k}" for k in range(gpus))]
    message = f"there is no device {device!r} for torch {torch.__version__} here; there is {', '.join(devices)}"
    require(device is None or device in devices, message, "training.device")
    posterior = not isinstance(recipe, Recipe)
    message = f"a posterior network is trained on the processor: leave out --device {device}"
    require(not posterior or device in (None, "cpu"), message, "training.device")
    chosen = torch.device(device or ("cuda" if gpus and not posterior else "cpu"))
    with writable_folder(out_dir) as folder, torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        if isinstance(recipe, Recipe):
            return PointTraining(recipe, load(data_dir, folder), folder, chosen).run(progress)
        return PosteriorTraining(recipe, load_curves(recipe.problem, data_dir, folder), folder).run(progress)


def export(
    recipe: Recipe | PosteriorRecipe, run_dir: str | Path, out_dir: str | Path, *, card_date: date | None = None
) -> Path:
    """Write NAME.onnx and NAME.json for a finished run; returns the path of NAME.onnx. card_date: date on the card.

    Raises:
        InputError: the run is not finished, or is not of this recipe.
        RuntimeError: the exported model differs from the trained one by more than TOLERANCE.
    """
    run = Path(run_dir)
    result = read_result(run)
    changed = difference(result, recipe.settings())
    require(not changed, f"{run} was not trained with this recipe: {changed}", "export.another_recipe")
    point: Any = (_export_point, _point_card, ModelCard)
    posterior: Any = (_export_posterior, _posterior_card, PosteriorCard)
    write, describe, card = point if isinstance(recipe, Recipe) else posterior
    with writable_folder(out_dir) as folder:
        target = folder / f"{recipe.export.name}.onnx"
        with atomic_file(target) as temporary:
            added = write(recipe, run, temporary)
        with damaged_as_input_error(run / "result.json"):
            packages = {package: version(package) for package in ("cavirheo", "numpy", "onnxruntime")}
            content = {
                "schema": 1,
                "name": target.stem,
                **describe(recipe, result),
                "onnx": {"sha256": sha256(target), **added},
                "versions": {"python": platform.python_version(), "torch": result["torch"], **packages},
                "license": "MIT",
                "date": (card_date or datetime.now(UTC).date()).isoformat(),
            }
            card.model_validate(content)
        text = as_json(content, indent=2)
        # put each list of numbers or words on one line
        text = re.sub(r"\[\s+([^][{}]+?)\s+\]", lambda match: f"[{' '.join(match[1].split())}]", text)
        write_text(target.with_suffix(".json"), text + "\n")
    return target


def _export_point(recipe: Recipe, run: Path, path: Path) -> dict[str, Any]:
    """Write the model; returns the card's entries on the file, with its largest difference from the trained network: in
    the prior's scale, on the test curves as one batch and on the first of them alone."""
    with damaged_as_input_error(run / "best.safetensors"):
        model = load_model(run / "best.safetensors")
    with damaged_as_input_error(run / "test.npz"), np.load(run / "test.npz") as test:
        radius = test["radius"]
    networks.write_onnx(model, recipe.problem.grid.frames, path)
    with torch.inference_mode():
        expected = model(torch.from_numpy(radius)).numpy()
    together, single = predict(path, radius), predict(path, radius[:1])
    deviation = float(max(np.abs(together - expected).max(), np.abs(single - expected[:1]).max()))
    if not deviation <= TOLERANCE:
        raise RuntimeError(f"exported and trained model differ by {deviation:.2g}, more than {TOLERANCE:g}")
    check_graph(path.read_bytes())  # inference would refuse such a file
    return {"opset": networks.OPSET, "largest_difference_from_torch": deviation}


def _export_posterior(recipe: PosteriorRecipe, run: Path, path: Path) -> dict[str, Any]:
    """Write the model; returns the card's entry on the file: the largest difference of its log density, per coordinate,
    from that of the trained network, whose weights are not rounded to half precision."""
    with damaged_as_input_error(run / "best.safetensors"):
        network = PosteriorNetwork(len(recipe.problem.kinds), recipe.network)
        network.load_state_dict(read_tensors(run / "best.safetensors")[0])
    networks.write_posterior(network, path)
    rng, count, d, kinds = np.random.default_rng(0), 64, len(COORDINATES), len(recipe.problem.kinds)
    shapes = {"cells": (1, SIZE), "choice": (count, d, network.parts), "normal": (count, d), "given": (count, d)}
    values: Any = {name: rng.standard_normal(shape).astype(np.float32) for name, shape in shapes.items()}
    ones = dict.fromkeys(("has", "counted", "take"), np.ones(d, np.float32))
    session, deviation = onnx_session(path.read_bytes()), 0.0
    for kind in np.eye(kinds, dtype=np.float32)[:, None]:
        feed = values | ones | {"kind": kind}
        with torch.inference_mode():
            expected = networks.SequentialDraws(network.eval())(*(torch.from_numpy(feed[name]) for name in INPUTS))[1]
        deviation = max(deviation, float(np.abs(session.run(None, feed)[1] - expected.numpy()).max()) / d)
    if not deviation <= POSTERIOR_TOLERANCE:
        raise RuntimeError(f"exported and trained model differ by {deviation:.2g}, more than {POSTERIOR_TOLERANCE:g}")
    return {"largest_difference_from_torch": deviation}


def load_model(checkpoint: Path) -> Unstandardised:
    """The network of a best.safetensors with its scaling, in evaluation mode."""
    weights, note = read_tensors(checkpoint)
    problem, outputs = TrainingProblem.from_dict(note["problem"]), tuple(note["outputs"])
    network = BubbleTransformer(NetworkTable(**note["network"]), problem.grid.frames, len(outputs))
    network.load_state_dict(weights)
    return Unstandardised(network, *scaling(problem.prior, outputs)).eval()


def _point_card(recipe: Recipe, result: Mapping[str, Any]) -> dict[str, Any]:
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
        "input": {"name": "radius", "shape": ["batch", problem.grid.frames], "dtype": "float32", "meaning": meaning},
        "outputs": [{"name": name, "unit": parameter_of(name).unit, "scale": scale} for name, scale in scales.items()],
        "network": result["network"] | {"parameters": result["parameters"]},
        "training": result["training"] | training,
        # for the figure of the losses; with all their digits they would be most of the card
        "history": {part: [float(f"{loss:.5g}") for loss in losses] for part, losses in result["history"].items()},
        "data": result["data"],
        "metrics": result["metrics"],  # of the test part
    }


def _posterior_card(recipe: PosteriorRecipe, result: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of the card on a posterior network, and on its training."""
    low, high = recipe.problem.max_radius_um
    ranges = {
        "max_radius_um": (1.2 * low, high / 1.08),
        "frame_interval_us": (MIN_INTERVAL * 1e6, MAX_INTERVAL * 1e6),
        "frames": (0.75 * MIN_FRAMES, MAX_FRAMES),
        "noise_over_rmax": (0.0, 0.06),
        "density": (0.89 * WATER.density, 1.11 * WATER.density),
        "pressure": (0.89 * WATER.pressure, 1.11 * WATER.pressure),
    }
    training = {key: result[key] for key in ("samples", "curves", "held_out")} | {"seconds": round(result["seconds"])}
    return {
        "kind": "posterior",
        "kinds": [(law, bubble) for law, bubble, _ in recipe.problem.kinds],
        "trained": {name: [float(f"{end:.3g}") for end in ends] for name, ends in ranges.items()},
        "network": recipe.network.model_dump() | {"parameters": result["parameters"]},
        "training": recipe.training.model_dump() | training | {"loss": result["best_validation_loss"]},
        "loss_by_kind": result["loss_by_kind"],
        "coverage": result["coverage"],
    }
