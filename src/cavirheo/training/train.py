"""Training and export: from a recipe and a training set to a file of weights with its card.

All random numbers follow from (seed, epoch): a run that is interrupted and continued ends with the same weights.

Files in the run's folder, each written completely or not at all:
    checkpoint.state     weights (also the best ones) and optimiser at the last epoch; settings and history as JSON
    NAME.npz, NAME.json  at the end: the best weights, and their card (inference/network_files.py)
"""

from __future__ import annotations

import json
import math
import platform
import re
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from pydantic_core import to_json
from torch import Tensor

from cavirheo.errors import InputError
from cavirheo.inference.network_files import MAX_BYTES, EmulatorCard, ModelCard, unpack
from cavirheo.training.dataset import load
from cavirheo.training.networks import Task, arrays_of, task_of
from cavirheo.training.recipe import Recipe, TrainingTable, difference
from cavirheo.writing.document import atomic_file, writable_folder
from cavirheo.writing.terminal import progress_bar

AVERAGE_DECAY = 0.998
LARGEST_GRADIENT = 1.0  # norm, in the training of an emulator
NOTE = "note"  # array of a checkpoint with the bytes of its settings and history
MOST_COMPARED = 1000  # curves of the test part on which the exported network is compared with the trained one
# Largest difference between the exported network and the trained one: rounding to single precision alone moves an
# answer by up to 1e-4 of a decade
TOLERANCE = 5e-4


class Progress(NamedTuple):
    """Of a training. history: a line for each epoch. best: weights of the epoch with the lowest validation loss."""

    history: list[dict[str, float]]
    best: Mapping[str, Tensor]

    @property
    def lowest(self) -> float:
        """The lowest validation loss."""
        return min((line["validation"] for line in self.history), default=math.inf)


def train(
    recipe: Recipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> Path:
    """Train the recipe's network, or continue the run in `out_dir`, and score it on the test part; returns the path of
    NAME.npz. `device` is torch's name ("cpu", "cuda"; default: cuda if there is one).

    Raises InputError: the data were made for another problem, the folder holds another run, or the weights take more
    than 8 MB; RuntimeError: what numpy computes from the file differs from the trained network by more than TOLERANCE.
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
        data = load(data_dir)
        torch.manual_seed(recipe.training.seed)
        task = task_of(recipe, data, chosen)
        identity = json.loads(as_json(recipe.settings() | {"data": data.sha256}))
        done = fit(task, recipe.training, folder, identity, progress)
        cuda = chosen.type == "cuda"
        return export(task, recipe, done, folder, torch.cuda.get_device_name(chosen) if cuda else chosen.type)


def fit(task: Task, table: TrainingTable, folder: Path, identity: Mapping[str, Any], progress: bool) -> Progress:
    """Train to the last epoch, with a checkpoint after each. Raises InputError: the folder holds another run."""
    path = folder / "checkpoint.state"
    done = resumed(path, task, identity)
    batches = -(-task.count // table.batch)
    with progress_bar("training", table.epochs * batches, visible=progress, unit="steps") as advance:
        advance(len(done.history) * batches)
        for epoch in range(len(done.history), table.epochs):
            advance(0, what=f"training, best validation loss {done.lowest:.5f}")
            began = time.perf_counter()
            loss = train_epoch(task, table, epoch, advance)
            line = {"epoch": epoch + 1, "train": loss, "validation": task.validation_loss()}
            if not all(map(math.isfinite, line.values())):
                message = f"the loss is not finite in epoch {epoch + 1}: lower lr or lengthen the warm-up"
                raise InputError(message, "training.diverged")
            best = done.best
            if line["validation"] < done.lowest:
                best = {name: tensor.clone() for name, tensor in task.exported.state_dict().items()}
            done = Progress([*done.history, line | {"seconds": round(time.perf_counter() - began, 3)}], best)
            save(path, task, identity, done)
    return done


def train_epoch(task: Task, table: TrainingTable, epoch: int, advance: Callable[[int], None]) -> float:
    """Show every curve of the training part once; returns the mean of the reported losses."""
    torch.manual_seed(int(np.random.SeedSequence([table.seed, epoch]).generate_state(1)[0]))
    batches = torch.randperm(task.count).split(table.batch)
    task.network.train(epoch < task.dropout_epochs)  # switches only dropout
    step, steps = epoch * len(batches), table.epochs * len(batches)
    summed = torch.zeros((), device=next(task.network.parameters()).device)
    for rows in batches:
        loss, reported = task.loss(rows, step, steps)
        task.network.zero_grad()
        loss.backward()
        if task.average is not None:
            torch.nn.utils.clip_grad_norm_(task.network.parameters(), LARGEST_GRADIENT)
        for optimiser in task.optimisers:
            optimiser.param_groups[0]["lr"] = table.learning_rate(step, steps)
            optimiser.step()
        step += 1
        if task.average is not None:
            share = min(AVERAGE_DECAY, step / (step + 10.0))
            with torch.no_grad():
                torch._foreach_lerp_(list(task.average.parameters()), list(task.network.parameters()), 1.0 - share)
        summed += reported.detach() * len(rows)
        advance(1)
    return float(summed) / task.count


def save(path: Path, task: Task, identity: Mapping[str, Any], done: Progress) -> None:
    """Write a checkpoint."""
    tensors = task.trained.state_dict() | {f"best.{name}": tensor for name, tensor in done.best.items()}
    for k, optimiser in enumerate(task.optimisers):
        for index, moments in optimiser.state_dict()["state"].items():
            tensors |= {f"moments.{k}.{index}.{name}": tensor for name, tensor in moments.items()}
    content: dict[str, Any] = {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}
    content[NOTE] = np.frombuffer(as_json({"identity": identity, "history": done.history}).encode(), np.uint8)
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **content)


def resumed(path: Path, task: Task, identity: Mapping[str, Any]) -> Progress:
    """Load the last checkpoint, if there is one, into the task. Raises InputError: it is damaged, or of another run."""
    if not path.exists():
        return Progress([], {})
    try:
        if not path.is_file():  # reading a pipe would wait for ever
            raise OSError("no file")
        with np.load(path, allow_pickle=False) as file:
            note: dict[str, Any] = json.loads(file[NOTE].tobytes())
            networks = {name: torch.from_numpy(file[name]) for name in file.files if name != NOTE}
        if changed := difference(note["identity"], identity):
            hint = "use another folder, or the recipe and data that it was begun with"
            raise InputError(f"{path.parent} holds another run ({changed}): {hint}", "training.another_run")
        best = {name.removeprefix("best."): networks.pop(name) for name in [*networks] if name.startswith("best.")}
        moments: list[dict[int, dict[str, Tensor]]] = [{} for _ in task.optimisers]
        for name in [name for name in networks if name.startswith("moments.")]:
            _, k, index, which = name.split(".")
            moments[int(k)].setdefault(int(index), {})[which] = networks.pop(name)
        task.exported.load_state_dict(best)  # an error if it is of another network
        for optimiser, state in zip(task.optimisers, moments, strict=True):
            optimiser.load_state_dict(optimiser.state_dict() | {"state": state})
        task.trained.load_state_dict(networks)
        losses = ("epoch", "train", "validation", "seconds")
        return Progress([{key: float(line[key]) for key in losses} for line in note["history"]], best)
    except InputError:
        raise
    except Exception as error:  # libraries raise nearly any error for a damaged file
        reason = str(error).partition("\n")[0]
        message = f"{path} is damaged or not of this run ({reason}); delete its folder, or use another, and train anew"
        raise InputError(message, "training.checkpoint") from error


def export(task: Task, recipe: Recipe, done: Progress, folder: Path, device: str) -> Path:
    """Write NAME.npz and NAME.json with the best weights; returns the path of NAME.npz. device: of the training."""
    network = task.exported
    network.load_state_dict(done.best)
    network.cpu().eval()
    stream, arrays = BytesIO(), dict[str, Any](arrays_of(network))
    np.savez(stream, **arrays)
    content = stream.getvalue()
    if len(content) > MAX_BYTES:
        message = f"the weights take {len(content) / 1e6:.1f} MB, and {MAX_BYTES / 1e6:g} MB are read: train fewer"
        raise InputError(message, "export.size")
    predicted = task.computed(unpack(content), task.test_inputs)
    with torch.inference_mode():
        expected = network.answers(torch.from_numpy(task.test_inputs[:MOST_COMPARED])).numpy()
    deviation = float(np.abs(predicted[:MOST_COMPARED] - expected).max())
    if not deviation <= TOLERANCE:
        raise RuntimeError(f"exported and trained network differ by {deviation:.2g}, more than {TOLERANCE:g}")
    settings, target = recipe.settings(), folder / f"{recipe.export.name}.npz"
    training = {
        "best_epoch": 1 + [line["validation"] for line in done.history].index(done.lowest),
        "best_validation_loss": done.lowest,
        "seconds": round(sum(line["seconds"] for line in done.history), 1),
        "device": device,
    }
    about = {
        "schema": 2,
        "name": target.stem,
        **task.entries(predicted),
        "network": settings["network"] | {"parameters": sum(p.numel() for p in network.parameters())},
        "training": settings["training"] | training,
        # for the figure of the losses; with all their digits they would be most of the card
        "history": {part: [float(f"{line[part]:.5g}") for line in done.history] for part in ("train", "validation")},
        "weights": {"sha256": sha256(content).hexdigest(), "largest_difference_from_torch": deviation},
        "versions": {
            "python": platform.python_version(),
            "torch": torch.__version__,
            **{package: version(package) for package in ("cavirheo", "numpy")},
        },
        "license": "MIT",
        "date": datetime.now(UTC).date().isoformat(),
    }
    (ModelCard if about["kind"] == "point" else EmulatorCard).model_validate(about)
    with atomic_file(target) as temporary:
        temporary.write_bytes(content)
    text = as_json(about, indent=2)
    # put each list of numbers or words on one line
    text = re.sub(r"\[\s+([^][{}]+?)\s+\]", lambda match: f"[{' '.join(match[1].split())}]", text)
    with atomic_file(target.with_suffix(".json")) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return target


def as_json(content: Mapping[str, Any], indent: int | None = None) -> str:
    """The text of a JSON object, in which numbers that are not finite are null."""
    return to_json(content, indent=indent, inf_nan_mode="null").decode()
