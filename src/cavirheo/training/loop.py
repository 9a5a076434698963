"""The loop of a training in a folder, and the files of a run: tensors with a JSON note, never pickle."""

from __future__ import annotations

import json
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from cavirheo.errors import InputError, read_object, require
from cavirheo.training.recipe import PosteriorRecipe, Recipe, difference
from cavirheo.writing.document import whole
from cavirheo.writing.terminal import bar

Network = TypeVar("Network", bound=nn.Module)
AVERAGED = 0.999
NOTE = "cavirheo"
LARGEST = 200_000_000  # bytes of a result.json


class Training(ABC, Generic[Network]):
    """One training in one folder, taken up where it stopped. `history` has a line for each validation."""

    network: Network  # that learns
    average: Network | None = None  # of its weights, which is exported; None: those of the lowest validation loss
    optimiser: torch.optim.Optimizer  # of the network's weights
    steps: int  # of the whole training
    every: int  # steps from one validation, and checkpoint, to the next
    clip: float = math.inf  # largest norm of a gradient
    identity: dict[str, Any]  # of the data, which like the recipe's settings must not change within a run

    def __init__(self, recipe: Recipe | PosteriorRecipe, folder: Path, device: torch.device) -> None:
        self.name, self.settings, self.folder, self.device = recipe.export.name, recipe.settings(), folder, device
        self.step, self.history = 0, list[dict[str, Any]]()
        torch.manual_seed(recipe.training.seed)

    @abstractmethod
    def rate(self, step: int) -> float:
        """Of the optimiser."""

    @abstractmethod
    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        """Loss of the recordings of a step, losses (n,) that are reported, and their weight in the reported mean."""

    @abstractmethod
    def line(self, losses: Sequence[float]) -> dict[str, Any]:
        """A line of the history: a validation, beside the means of `losses` since the line before it."""

    @abstractmethod
    def result(self) -> dict[str, Any]:
        """What is to be said of the weights that are exported, for result.json."""

    def run(self, progress: bool) -> dict[str, Any]:
        """Train to the end and write the result; what result.json holds."""
        path = self.folder / "result.json"
        self._resume(path)
        if self.step < self.steps or not path.exists():
            path.unlink(missing_ok=True)
            with bar("training", self.steps, visible=progress, unit="steps") as advance:
                advance(self.step)
                while self.step < self.steps:
                    best = min((line["validation"] for line in self.history), default=math.inf)
                    advance(0, what=f"training, best validation loss {best:.5f}")
                    self._stretch(advance)
            weights, note = read_tensors(self.folder / "best.safetensors")
            with of_run(self.folder / "best.safetensors"):
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
            write_text(path, json.dumps(document | self.result(), indent=2) + "\n")
        return read_result(self.folder)

    @property
    def exported(self) -> Network:
        return self.network if self.average is None else self.average

    def _stretch(self, advance: Any) -> None:
        """The steps to the next validation, and this."""
        began, summed, weights = time.perf_counter(), torch.zeros(1, device=self.device), 0
        while True:
            for group in self.optimiser.param_groups:
                group["lr"] = self.rate(self.step)
            loss, reported, weight = self.loss(self.step)
            self.optimiser.zero_grad()
            loss.backward()
            if self.clip < math.inf:
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.clip)
            self.optimiser.step()
            summed, weights, self.step = summed + reported.detach() * weight, weights + weight, self.step + 1
            if self.average is not None:
                share = min(AVERAGED, self.step / (self.step + 10.0))
                with torch.no_grad():
                    torch._foreach_lerp_(list(self.average.parameters()), list(self.network.parameters()), 1.0 - share)
            advance(1)
            if self.step % self.every == 0 or self.step == self.steps:
                break
        line = self.line([value / weights for value in summed.tolist()])
        message = f"the loss is not finite after {self.step} steps: lower lr (rate) or lengthen the warm-up"
        require(math.isfinite(line["train"]) and math.isfinite(line["validation"]), message)
        self.history.append(line | {"seconds": round(time.perf_counter() - began, 3)})
        if self.average is not None or line["validation"] <= min(line["validation"] for line in self.history):
            note = self.settings | {"epoch": len(self.history), "validation_loss": line["validation"]}
            write_tensors(self.folder / "best.safetensors", self.exported.state_dict(), note)
        parts = {part: network.state_dict() for part, network in self._networks.items()}
        adam = self.optimiser.state_dict()["state"].items()
        parts["adam"] = {f"{index}.{name}": tensor for index, values in adam for name, tensor in values.items()}
        state = {f"{part}.{name}": tensor for part, tensors in parts.items() for name, tensor in tensors.items()}
        note = {"identity": self.settings | self.identity, "history": self.history, "step": self.step}
        write_tensors(self.folder / "last.safetensors", state, note)
        write_text(self.folder / "history.jsonl", "".join(json.dumps(entry) + "\n" for entry in self.history))

    @property
    def _networks(self) -> dict[str, nn.Module]:
        networks: dict[str, nn.Module] = {"network": self.network}
        return networks if self.average is None else networks | {"mean": self.average}

    def _resume(self, result: Path) -> None:
        path = self.folder / "last.safetensors"
        if not path.exists():
            message = f"{self.folder} holds a result but not the run's {path.name}: use another folder"
            require(not result.exists(), message)
            return
        state, note = read_tensors(path)
        with of_run(path):
            changed = difference(note["identity"], json.loads(json.dumps(self.settings | self.identity)))
        hint = "use another folder, or the recipe and data that it was begun with"
        require(not changed, f"{self.folder} holds another run ({changed}): {hint}", "training.another_run")
        with of_run(path):
            self.history = [line for line in note["history"] if line["validation"] + line["train"] + line["seconds"]]
            self.step = int(note["step"])
            parts: dict[str, dict[str, Tensor]] = {"adam": {}}
            for key, tensor in state.items():
                part, _, name = key.partition(".")
                parts.setdefault(part, {})[name] = tensor
            adam: dict[int, dict[str, Tensor]] = {}
            for key, tensor in parts["adam"].items():
                index, _, name = key.partition(".")
                adam.setdefault(int(index), {})[name] = tensor
            self.optimiser.load_state_dict(self.optimiser.state_dict() | {"state": adam})
            for part, network in self._networks.items():
                network.load_state_dict(parts[part])


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
        reason = str(error).partition("\n")[0]
        message = f"{path} is damaged or not of this run ({reason}); delete its folder, or use another, and train anew"
        raise InputError(message, "training.checkpoint") from error


def read_result(run: Path) -> dict[str, Any]:
    """The result.json of a finished run. Raises InputError."""
    try:
        return read_object(run / "result.json", LARGEST)
    except InputError as error:
        hint = "finish the run with `cavirheo train`; if the file is damaged, delete it first"
        raise InputError(f"{error}; {hint}", "export.unfinished") from error


def write_text(path: Path, text: str) -> None:
    """Put text into a file that is never seen half-written."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
