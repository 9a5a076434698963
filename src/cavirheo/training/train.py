"""Training: a recipe and a training set in, the weights of the best validation epoch out.

All randomness of an epoch (order of the curves, dropout) follows from (seed, epoch): a run that was cut off ends at
the weights it would have had.

Files in the run's folder (tensors with a JSON note, never pickle; each is written whole or not at all):
    last.safetensors   weights and optimiser after the last complete epoch, settings, history
    best.safetensors   weights of the epoch with the lowest validation loss
    history.jsonl      one line per epoch: losses of the training and the validation part, seconds
    test.npz           curves, truth and predictions of the test part, which is looked at once, at the end
    result.json        what came out, and of what: becomes the card of the exported model

Only numpy, scipy, h5py, pydantic, rich, safetensors and torch are needed here.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor
from torch.nn.functional import mse_loss

from cavirheo.errors import InputError, require
from cavirheo.files import read_object
from cavirheo.prior import Prior
from cavirheo.training.dataset import Indices, difference, load
from cavirheo.training.metrics import metrics
from cavirheo.training.network import BubbleTransformer
from cavirheo.training.recipe import Recipe, TrainingTable
from cavirheo.writing.document import into, whole
from cavirheo.writing.terminal import bar

EVALUATION_BATCH = 512
NOTE = "cavirheo"
LARGEST = 200_000_000  # bytes of a result.json


def train(
    recipe: Recipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train the recipe's network, or go on with the run in `out_dir`; the content of its result.json.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one).

    Raises:
        InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    cards = torch.cuda.device_count()
    known = ["cpu", *["cuda"][:cards], *(f"cuda:{k}" for k in range(cards))]
    message = f"there is no device {device!r} for torch {torch.__version__} here; there is {', '.join(known)}"
    require(device is None or device in known, message, "training.device")
    chosen = torch.device(device or ("cuda" if cards else "cpu"))
    with into(out_dir) as folder, torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        training = _Training(recipe, Path(data_dir), folder, chosen)
        training.resume()
        if not (folder / "result.json").exists():
            training.fit(progress)
            training.finish()
        return read_result(folder)


def scaling(prior: Prior, outputs: tuple[str, ...]) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (outputs,) of the prior, by which targets are standardised."""
    columns = [prior.names.index(name) for name in outputs]
    low, high = prior.low[columns], prior.high[columns]
    mean, std = torch.from_numpy((low + high) / 2), torch.from_numpy((high - low) / math.sqrt(12))
    return mean.float(), std.float()


def learning_rate(settings: TrainingTable, step: int, steps_per_epoch: int) -> float:
    """Adam's step size at an optimiser step, from 0: linear warm-up, then constant or half a cosine to 0."""
    rate = settings.lr * min(1.0, (step + 1) / max(1, settings.warmup_steps))
    if settings.schedule == "cosine":
        rate *= 0.5 * (1.0 + math.cos(math.pi * step / (settings.epochs * steps_per_epoch)))
    return rate


class _Training:
    """One training in one folder."""

    def __init__(self, recipe: Recipe, data_dir: Path, folder: Path, device: torch.device) -> None:
        self.recipe, self.settings, self.folder, self.device = recipe, recipe.training, folder, device
        self.data, problem = load(data_dir, folder), recipe.problem
        other = f"{data_dir} was made for problem {self.data.problem.id}, the recipe is of {problem.id}"
        fine = self.data.problem.id == problem.id
        require(fine, f"{other}: generate the data with this recipe", "training.another_problem")
        self.mean, self.std = scaling(problem.prior, recipe.outputs)
        target = (torch.tensor(self.data.truth(recipe.outputs)).float() - self.mean) / self.std
        split = self.data.split(self.settings.seed)
        for name, curves in split.items():
            require(len(curves) >= 2, f"too few usable curves in the {name} part of {len(target)}")
        # indices (curves,) and target (curves, outputs) of "train", "validation", "test"; radii stay on the disk
        self.parts = {name: (i, target[i].to(device)) for name, i in split.items()}
        self.steps_per_epoch = math.ceil(len(split["train"]) / self.settings.batch)
        torch.manual_seed(self.settings.seed)
        self.network = BubbleTransformer(recipe.network, problem.grid.frames, len(recipe.outputs)).to(device)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.settings.lr)
        self.history: list[dict[str, float]] = []
        # what must not change within a run
        self.identity = json.loads(json.dumps(recipe.settings() | {"data": self.data.sha256}))

    def fit(self, progress: bool) -> None:
        epochs, done = self.settings.epochs, len(self.history)
        with bar("training", epochs * self.steps_per_epoch, shown=progress, unit="steps") as advance:
            advance(done * self.steps_per_epoch)
            for epoch in range(done, epochs):
                best = min((line["validation"] for line in self.history), default=math.inf)
                advance(0, what=f"training, epoch {epoch + 1}/{epochs}, best validation loss {best:.5f}")
                began = time.perf_counter()
                loss = self._epoch(epoch, advance)
                validation = float(mse_loss(self._predict("validation"), self.parts["validation"][1]))
                finite = math.isfinite(loss) and math.isfinite(validation)
                require(finite, f"the loss is not finite in epoch {epoch + 1}: lower lr or add warmup_steps")
                line = {"epoch": epoch + 1, "train": loss, "validation": validation}
                self.history.append(line | {"seconds": round(time.perf_counter() - began, 3)})
                self._save(validation <= best)

    def _epoch(self, epoch: int, step_done: Callable[[], None]) -> float:
        """One pass over the training part; the mean of its curves' losses, each taken before its step."""
        curves, target = self.parts["train"]
        torch.manual_seed(int(np.random.SeedSequence([self.settings.seed, epoch]).generate_state(1)[0]))
        order = torch.randperm(len(curves))
        summed = torch.zeros((), device=self.device)
        self.network.train(epoch < (self.settings.dropout_epochs or self.settings.epochs))  # only dropout heeds it
        for step, batch in enumerate(order.split(self.settings.batch), start=epoch * self.steps_per_epoch):
            for group in self.optimiser.param_groups:
                group["lr"] = learning_rate(self.settings, step, self.steps_per_epoch)
            loss = mse_loss(self.network(self._radius(curves[batch.numpy()])), target[batch.to(self.device)])
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()
            summed += loss.detach() * len(batch)
            step_done()
        return float(summed) / len(curves)

    def _radius(self, curves: Indices) -> Tensor:
        """(curves, frames) of these."""
        return torch.from_numpy(self.data.radius[curves]).to(self.device)

    @torch.inference_mode()
    def _predict(self, part: str) -> Tensor:
        self.network.eval()
        curves, _ = self.parts[part]
        starts = range(0, len(curves), EVALUATION_BATCH)
        return torch.cat([self.network(self._radius(curves[start : start + EVALUATION_BATCH])) for start in starts])

    def _save(self, best: bool) -> None:
        weights, line = self.network.state_dict(), self.history[-1]
        if best:
            about = self.recipe.settings() | {"epoch": line["epoch"], "validation_loss": line["validation"]}
            write_tensors(self.folder / "best.safetensors", weights, about)
        state = {f"network.{name}": tensor for name, tensor in weights.items()}
        state |= adam_tensors(self.optimiser)
        write_tensors(self.folder / "last.safetensors", state, {"identity": self.identity, "history": self.history})
        write_text(self.folder / "history.jsonl", "".join(json.dumps(entry) + "\n" for entry in self.history))

    def resume(self) -> None:
        """Take up the state of the folder, if there is one."""
        path = self.folder / "last.safetensors"
        if not path.exists():
            done = (self.folder / "result.json").exists()
            require(not done, f"{self.folder} holds a result but not the run's {path.name}: use another folder")
            return
        state, about = read_tensors(path)
        with of_run(path):
            other = difference(about["identity"], self.identity)
        mend = "use another folder, or the recipe and data that it was begun with"
        require(not other, f"{self.folder} holds another run ({other}): {mend}", "training.another_run")
        with of_run(path):
            self.history = [line for line in about["history"] if line["validation"] + line["train"] + line["seconds"]]
            load_adam(self.optimiser, state)
            self.network.load_state_dict({key.removeprefix("network."): tensor for key, tensor in state.items()})

    def finish(self) -> None:
        """Look at the test part with the best weights and write the result."""
        weights, about = read_tensors(self.folder / "best.safetensors")
        with of_run(self.folder / "best.safetensors"):
            self.network.load_state_dict(weights)
        curves, target = self.parts["test"]
        truth, predicted = ((t * self.std + self.mean).numpy() for t in (target.cpu(), self._predict("test").cpu()))
        with whole(self.folder / "test.npz") as temporary, temporary.open("wb") as file:
            np.savez(file, radius=self.data.radius[curves], truth=truth, predicted=predicted)
        data, cuda = self.data, self.device.type == "cuda"
        made = {"n": len(data.theta), "seed": data.seed, "sha256": data.sha256, "failures": data.failures}
        parts = {part: len(curves) for part, (curves, _) in self.parts.items()}
        result = self.recipe.settings() | {
            "kind": "training",
            "schema": 1,
            "version": version("cavirheo"),
            "command": f"cavirheo train (recipe of {self.recipe.export.name})",
            "problem_id": self.recipe.problem.id,
            "epochs": len(self.history),
            "best_epoch": about["epoch"],
            "best_validation_loss": about["validation_loss"],
            "seconds": round(sum(entry["seconds"] for entry in self.history), 1),
            "device": torch.cuda.get_device_name(self.device) if cuda else self.device.type,
            "parameters": sum(p.numel() for p in self.network.parameters()),
            "history": {key: [entry[key] for entry in self.history] for key in ("train", "validation")},
            "data": made | {"made_by": data.made_by} | parts,
            "metrics": metrics(self.recipe.outputs, truth, predicted),
            "torch": torch.__version__,
        }
        write_text(self.folder / "result.json", json.dumps(result, indent=2) + "\n")


def adam_tensors(optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """The optimiser's state by names that begin with "adam."."""
    states = optimiser.state_dict()["state"].items()
    return {f"adam.{index}.{name}": tensor for index, values in states for name, tensor in values.items()}


def load_adam(optimiser: torch.optim.Optimizer, state: dict[str, Tensor]) -> None:
    """Take what `adam_tensors` gave out of `state` and into the optimiser."""
    adam: dict[int, dict[str, Tensor]] = {}
    for key in [key for key in state if key.startswith("adam.")]:
        _, index, name = key.split(".")
        adam.setdefault(int(index), {})[name] = state.pop(key)
    optimiser.load_state_dict(optimiser.state_dict() | {"state": adam})


def write_tensors(path: Path, tensors: Mapping[str, Tensor], note: Mapping[str, Any]) -> None:
    """Put tensors and what is to be known about them into one file."""
    content = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with whole(path) as temporary:
        try:
            save_file(content, temporary, metadata={NOTE: json.dumps(note)})
        except SafetensorError as error:  # a full disk
            raise OSError(str(error)) from error


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors and the note of `write_tensors`. Raises InputError if the file is not one of ours."""
    with of_run(path):
        if not path.is_file():  # a pipe would be waited for
            raise OSError("no file")
        with safe_open(path, framework="pt") as file:
            note: dict[str, Any] = json.loads(file.metadata()[NOTE])
            return {name: file.get_tensor(name) for name in list(file.keys())}, note


@contextmanager
def of_run(path: Path) -> Iterator[None]:
    """Around the use of what was read from it. Raises InputError: it holds something else."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # libraries raise nearly anything of a damaged file
        said = str(error).partition("\n")[0]
        message = f"{path} is damaged or not of this run ({said}); delete its folder, or use another, and train anew"
        raise InputError(message, "training.checkpoint") from error


def read_result(run: Path) -> dict[str, Any]:
    """The result.json of a finished run. Raises InputError."""
    try:
        return read_object(run / "result.json", LARGEST)
    except InputError as error:
        mend = "finish the run with `cavirheo train`; if the file is damaged, delete it first"
        raise InputError(f"{error}; {mend}", "export.unfinished") from error


def write_text(path: Path, text: str) -> None:
    """Put text into a file that is never seen half-written."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
