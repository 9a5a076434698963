"""Training: a recipe and a training set in, the weights of its network out.

Everything follows from (seed, step): a run that was cut off ends at the weights it would have had.

Files in the run's folder, each written whole or not at all:
    last.safetensors   weights and optimiser at the last validation, settings, history
    best.safetensors   weights that are exported: of the lowest validation loss, or of a posterior network the average
    history.jsonl      one line per validation: losses of the training and the validation part, seconds
    test.npz           curves, truth and predictions of the test part, which is looked at once, at the end
    result.json        what came out, and of what: becomes the card of the exported model

Only numpy, scipy, h5py, pydantic, rich, safetensors and torch are needed here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from cavirheo.errors import require
from cavirheo.training.dataset import load, load_curves
from cavirheo.training.point_network import PointTraining
from cavirheo.training.posterior_network import PosteriorTraining
from cavirheo.training.recipe import PosteriorRecipe, Recipe
from cavirheo.writing.document import into


def train(
    recipe: Recipe | PosteriorRecipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train the recipe's network, or go on with the run in `out_dir`; the content of its result.json.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one, and the processor for a posterior network).

    Raises:
        InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    cards = torch.cuda.device_count()
    devices = ["cpu", *["cuda"][:cards], *(f"cuda:{k}" for k in range(cards))]
    message = f"there is no device {device!r} for torch {torch.__version__} here; there is {', '.join(devices)}"
    require(device is None or device in devices, message, "training.device")
    posterior = not isinstance(recipe, Recipe)
    message = f"a posterior network is trained on the processor: leave out --device {device}"
    require(not posterior or device in (None, "cpu"), message, "training.device")
    chosen = torch.device(device or ("cuda" if cards and not posterior else "cpu"))
    with into(out_dir) as folder, torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        if isinstance(recipe, Recipe):
            return PointTraining(recipe, load(data_dir, folder), folder, chosen).run(progress)
        return PosteriorTraining(recipe, load_curves(recipe.posterior, data_dir, folder), folder).run(progress)
