"""Training: a recipe and a training set in, the weights of the best validation epoch out.

All randomness of an epoch (order of the curves, dropout) follows from (seed, epoch), and last.safetensors
holds the weights and the state of the optimiser: a run that was cut off ends at the weights it would have had.

Files in the run's folder:
    last.safetensors   the state after the last complete epoch, with the settings and the history
    best.safetensors   the weights of the epoch with the lowest validation loss
    history.jsonl      one line per epoch: loss on the training and the validation part, seconds
    test.npz           curves, truth and predictions of the test part, which is looked at once, at the end
    result.json        what came out, and of what: becomes the card of the exported model

`python -m cavirheo.training.train RECIPE DATA -o DIR` needs numpy, h5py, pydantic, rich, safetensors, torch.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from cavirheo.errors import InputError
from cavirheo.prior import Prior
from cavirheo.training.checkpoint import difference, read_tensors, write_tensors, write_text
from cavirheo.training.dataset import load
from cavirheo.training.metrics import metrics
from cavirheo.training.network import BubbleTransformer
from cavirheo.training.recipe import Recipe, TrainingTable, read_recipe
from cavirheo.writing.terminal import bar

EVALUATION_BATCH = 512
Parts = dict[str, tuple[Tensor, Tensor]]  # "train", ...: radius (curves, frames), target (curves, outputs)


def train(
    recipe: Recipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
    on_epoch: Callable[[Mapping[str, float]], None] | None = None,
) -> dict[str, Any]:
    """Train the recipe's network, or go on with the run in `out_dir`; a finished run is only reported.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one). `on_epoch` is told each line of
    the history, after the epoch is safe on disk.

    Returns:
        The content of result.json.

    Raises:
        InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    chosen = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    with torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        run = _Run(recipe, Path(data_dir), folder, chosen)
        run.resume()
        if not (folder / "result.json").exists():
            run.fit(progress, on_epoch)
            run.finish()
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return result


def scaling(prior: Prior, outputs: tuple[str, ...]) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (outputs,) of the prior, by which targets are standardised."""
    columns = [prior.names.index(name) for name in outputs]
    low, high = prior.low[columns], prior.high[columns]
    mean, std = torch.from_numpy((low + high) / 2), torch.from_numpy((high - low) / math.sqrt(12))
    return mean.float(), std.float()


class _Run:
    """One training in one folder."""

    def __init__(self, recipe: Recipe, data_dir: Path, folder: Path, device: torch.device) -> None:
        self.recipe, self.settings, self.folder, self.device = recipe, recipe.training, folder, device
        self.data = load(data_dir)
        if self.data.problem.id != recipe.problem.id:
            raise InputError(
                f"{data_dir} was made for problem {self.data.problem.id}, "
                f"the recipe is of {recipe.problem.id}: generate the data with this recipe"
            )
        self.parts = self._parts()
        torch.manual_seed(self.settings.seed)
        frames, outputs = recipe.problem.camera.frames, len(recipe.outputs)
        self.network = BubbleTransformer(recipe.network, frames, outputs).to(device)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.settings.lr)
        self.history: list[dict[str, float]] = []
        # what must not change within a run
        self.identity = json.loads(json.dumps(recipe.settings() | {"data": self.data.sha256}))

    def _parts(self) -> Parts:
        mean, std = scaling(self.recipe.problem.prior, self.recipe.outputs)
        columns = [self.recipe.problem.prior.names.index(name) for name in self.recipe.outputs]
        theta = torch.tensor(self.data.theta[:, columns], dtype=torch.float32)
        radius, target = torch.from_numpy(self.data.radius), (theta - mean) / std
        split = vars(self.data.split(self.settings.seed))
        if small := [name for name, indices in split.items() if len(indices) < 2]:
            raise InputError(f"too few usable curves in the {', '.join(small)} part of {len(theta)}")
        return {name: (radius[i].to(self.device), target[i].to(self.device)) for name, i in split.items()}

    def fit(self, progress: bool, on_epoch: Callable[[Mapping[str, float]], None] | None) -> None:
        epochs, steps = self.settings.epochs, self.steps_per_epoch
        done = len(self.history)
        what = f"training, epoch {min(done + 1, epochs)}/{epochs}"
        with bar(what, epochs * steps, shown=progress) as advance:
            advance(done * steps)
            for epoch in range(done, epochs):
                began = time.perf_counter()
                train_loss = self._epoch(epoch, advance)
                validation_loss = self._loss("validation")
                if not (math.isfinite(train_loss) and math.isfinite(validation_loss)):
                    raise InputError(f"the loss is not finite in epoch {epoch + 1}: lower lr or add warmup_steps")
                line = {"epoch": epoch + 1, "train": train_loss, "validation": validation_loss}
                self.history.append(line | {"seconds": round(time.perf_counter() - began, 3)})
                self._save()
                best = min(entry["validation"] for entry in self.history)
                losses = f"loss {train_loss:.5f}, validation {validation_loss:.5f} (best {best:.5f})"
                advance(0, what=f"training, epoch {min(epoch + 2, epochs)}/{epochs}, {losses}")
                if on_epoch is not None:
                    on_epoch(self.history[-1])

    @property
    def steps_per_epoch(self) -> int:
        return math.ceil(len(self.parts["train"][0]) / self.settings.batch)

    def _epoch(self, epoch: int, step_done: Callable[[], None]) -> float:
        """One pass over the training part; the mean of its curves' losses, each taken before its step."""
        radius, target = self.parts["train"]
        torch.manual_seed(int(np.random.SeedSequence([self.settings.seed, epoch]).generate_state(1)[0]))
        order = torch.randperm(len(radius)).to(self.device)
        summed = torch.zeros((), device=self.device)
        self.network.train(epoch < (self.settings.dropout_epochs or self.settings.epochs))  # only dropout heeds it
        first = epoch * self.steps_per_epoch
        for step, batch in enumerate(order.split(self.settings.batch), start=first):
            for group in self.optimiser.param_groups:
                group["lr"] = learning_rate(self.settings, step, self.steps_per_epoch)
            loss = functional.mse_loss(self.network(radius[batch]), target[batch])
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()
            summed += loss.detach() * len(batch)
            step_done()
        return float(summed) / len(radius)

    def _loss(self, part: str) -> float:
        return float(functional.mse_loss(self._predict(part), self.parts[part][1]))

    @torch.inference_mode()
    def _predict(self, part: str) -> Tensor:
        self.network.eval()
        return torch.cat([self.network(block) for block in self.parts[part][0].split(EVALUATION_BATCH)])

    def _save(self) -> None:
        weights = self.network.state_dict()
        line = self.history[-1]
        if line["validation"] <= min(entry["validation"] for entry in self.history):
            about = self.recipe.settings() | {"epoch": line["epoch"], "validation_loss": line["validation"]}
            write_tensors(self.folder / "best.safetensors", weights, about)
        state = {f"network.{name}": tensor for name, tensor in weights.items()}
        for index, values in self.optimiser.state_dict()["state"].items():
            state |= {f"adam.{index}.{name}": tensor for name, tensor in values.items()}
        write_tensors(self.folder / "last.safetensors", state, {"identity": self.identity, "history": self.history})
        write_text(self.folder / "history.jsonl", "".join(json.dumps(entry) + "\n" for entry in self.history))

    def resume(self) -> None:
        """Take up the state of the folder, if there is one."""
        path = self.folder / "last.safetensors"
        if not path.exists():
            if (self.folder / "result.json").exists():
                raise InputError(f"{self.folder} holds a result but not the run's {path.name}: use another folder")
            return
        state, about = read_tensors(path)
        if other := difference(about["identity"], self.identity):
            raise InputError(
                f"{self.folder} holds another run ({other}): "
                f"use another folder, or the recipe and data that it was begun with"
            )
        self.history = about["history"]
        self.network.load_state_dict({k.removeprefix("network."): v for k, v in state.items() if k[0] == "n"})
        adam: dict[int, dict[str, Tensor]] = {}
        for key, tensor in state.items():
            if key.startswith("adam."):
                _, index, name = key.split(".")
                adam.setdefault(int(index), {})[name] = tensor
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": adam, "param_groups": groups})

    def finish(self) -> None:
        """Look at the test part with the best weights and write the result."""
        weights, about = read_tensors(self.folder / "best.safetensors")
        self.network.load_state_dict(weights)
        mean, std = scaling(self.recipe.problem.prior, self.recipe.outputs)
        radius, target = (tensor.cpu() for tensor in self.parts["test"])
        truth, predicted = target * std + mean, self._predict("test").cpu() * std + mean
        np.savez(self.folder / "test.npz", radius=radius.numpy(), truth=truth.numpy(), predicted=predicted.numpy())
        data = self.data
        result = self.recipe.settings() | {
            "problem_id": self.recipe.problem.id,
            "epochs": len(self.history),
            "best_epoch": about["epoch"],
            "best_validation_loss": about["validation_loss"],
            "seconds": round(sum(entry["seconds"] for entry in self.history), 1),
            "device": torch.cuda.get_device_name(self.device) if self.device.type == "cuda" else self.device.type,
            "parameters": sum(p.numel() for p in self.network.parameters()),
            "history": {key: [entry[key] for entry in self.history] for key in ("train", "validation")},
            "data": {
                "n": len(data.theta),
                "seed": data.seed,
                "sha256": data.sha256,
                "failures": data.failures,
                "made_by": data.made_by,
                **{part: len(self.parts[part][0]) for part in self.parts},
            },
            "metrics": metrics(self.recipe.outputs, truth.numpy(), predicted.numpy()),
            "torch": torch.__version__,
        }
        write_text(self.folder / "result.json", json.dumps(result, indent=2) + "\n")


def learning_rate(settings: TrainingTable, step: int, steps_per_epoch: int) -> float:
    """Adam's step size at an optimiser step, from 0: linear warm-up, then constant or half a cosine to 0."""
    rate = settings.lr * min(1.0, (step + 1) / max(1, settings.warmup_steps))
    if settings.schedule == "cosine":
        rate *= 0.5 * (1.0 + math.cos(math.pi * step / (settings.epochs * steps_per_epoch)))
    return rate


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m cavirheo.training.train", description="Train a recipe's network.")
    parser.add_argument("recipe", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--device", help="cpu, cuda, ... (default: cuda if there is one)")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args(arguments)
    try:
        result = train(
            read_recipe(options.recipe),
            options.data,
            options.out,
            device=options.device,
            threads=options.threads,
        )
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    keys = ("device", "seconds", "epochs", "best_epoch", "best_validation_loss", "data", "metrics")
    print(json.dumps({key: result[key] for key in keys}, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
