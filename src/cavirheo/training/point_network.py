"""The network of the Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936), and its training.

    radius (batch, 100)
      -> tokens: each radius beside a learned embedding of its place      (batch, 100, 1 + 64)
      -> dense, softplus, layer norm, dropout                             (batch, 100, 64)
      -> for each output its own branch:
           two encoder layers, normalised after each residual sum         (batch, 100, 64)
           mean over the tokens, dense, softplus, one linear unit         (batch, 1)

The paper's feed-forward layers have softplus, too; those of the shipped networks have ReLU (`activation` of a recipe).
What the description leaves open, chosen here: eight numbers per attention head (64 = 8 x 8), dropout on both residual
paths but not on the attention weights, and Keras' initial weights (Glorot uniform, zero biases, embeddings uniform
within 0.05).

The training minimises the mean squared error, epoch by epoch; all randomness of an epoch (order of the curves, dropout)
follows from (seed, epoch).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.errors import require
from cavirheo.prior import Prior
from cavirheo.training.dataset import Dataset, Indices
from cavirheo.training.evaluate import metrics
from cavirheo.training.loop import Training
from cavirheo.training.recipe import NetworkTable, Recipe, TrainingTable
from cavirheo.writing.document import whole

EVALUATION_BATCH = 512


class EncoderLayer(nn.Module):
    """Self-attention and a feed-forward layer, each added to its input and then normalised."""

    def __init__(self, size: NetworkTable) -> None:
        super().__init__()
        self.heads, self.head_width = size.heads, size.head_width
        inner = size.heads * size.head_width
        self.query_key_value = nn.Linear(size.width, 3 * inner)
        self.attended = nn.Linear(inner, size.width)
        self.norm_attention = nn.LayerNorm(size.width, eps=size.norm_epsilon)
        self.expand = nn.Linear(size.width, size.feed_forward)
        self.contract = nn.Linear(size.feed_forward, size.width)
        self.norm_feed_forward = nn.LayerNorm(size.width, eps=size.norm_epsilon)
        self.dropout = nn.Dropout(size.dropout)
        self.activation = getattr(functional, size.activation)

    def forward(self, x: Tensor) -> Tensor:
        tokens = x.shape[1]
        split = self.query_key_value(x).view(-1, tokens, 3, self.heads, self.head_width)
        query, key, value = split.permute(2, 0, 3, 1, 4)  # each (batch, heads, tokens, head_width)
        mixed = functional.scaled_dot_product_attention(query, key, value)
        mixed = mixed.transpose(1, 2).reshape(-1, tokens, self.heads * self.head_width)
        x = self.norm_attention(x + self.dropout(self.attended(mixed)))  # (batch, tokens, width)
        hidden = self.activation(self.expand(x))  # (batch, tokens, feed_forward)
        return self.norm_feed_forward(x + self.dropout(self.contract(hidden)))


class Branch(nn.Module):
    """The way to one output."""

    def __init__(self, size: NetworkTable) -> None:
        super().__init__()
        self.layers = nn.Sequential(*(EncoderLayer(size) for _ in range(size.layers)))
        self.dense = nn.Linear(size.width, size.width)
        self.output = nn.Linear(size.width, 1)

    def forward(self, x: Tensor) -> Tensor:
        pooled = self.layers(x).mean(dim=1)  # (batch, width)
        return self.output(functional.softplus(self.dense(pooled)))  # (batch, 1)


class BubbleTransformer(nn.Module):
    """(batch, tokens) R/R_max -> (batch, outputs) standardised targets."""

    def __init__(self, size: NetworkTable, tokens: int, outputs: int) -> None:
        super().__init__()
        self.position = nn.Parameter(torch.empty(tokens, size.position))
        self.dense = nn.Linear(1 + size.position, size.width)
        self.norm = nn.LayerNorm(size.width, eps=size.norm_epsilon)
        self.dropout = nn.Dropout(size.dropout)
        self.branches = nn.ModuleList(Branch(size) for _ in range(outputs))
        self.apply(_initialise)
        nn.init.uniform_(self.position, -0.05, 0.05)

    def forward(self, radius: Tensor) -> Tensor:
        position = self.position.expand(radius.shape[0], -1, -1)
        x = torch.cat([radius.unsqueeze(-1), position], dim=-1)  # (batch, tokens, 1 + position)
        x = self.dropout(self.norm(functional.softplus(self.dense(x))))  # (batch, tokens, width)
        return torch.cat([branch(x) for branch in self.branches], dim=-1)


class Standardised(nn.Module):
    """The network with the scaling of its targets undone: outputs in the prior's scale, log10 of SI."""

    mean: Tensor
    std: Tensor

    def __init__(self, network: BubbleTransformer, mean: Tensor, std: Tensor) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("mean", mean)  # (outputs,)
        self.register_buffer("std", std)  # (outputs,)

    def forward(self, radius: Tensor) -> Tensor:
        return self.network(radius) * self.std + self.mean


def _initialise(module: nn.Module) -> None:
    if isinstance(module, nn.Linear):
        nn.init.xavier_uniform_(module.weight)
        nn.init.zeros_(module.bias)


class PointTraining(Training[BubbleTransformer]):
    """One training on a set of curves on a grid. Raises InputError: of another problem, or with too few curves."""

    def __init__(self, recipe: Recipe, data: Dataset, folder: Path, device: torch.device) -> None:
        super().__init__(recipe, folder, device)
        self.recipe, self.schedule, self.data, problem = recipe, recipe.training, data, recipe.problem
        message = f"the training set was made for problem {data.problem.id}, the recipe is of {problem.id}"
        fine = data.problem.id == problem.id
        require(fine, f"{message}: generate the data with this recipe", "training.another_problem")
        self.mean, self.std = scaling(problem.prior, recipe.outputs)
        target = (torch.tensor(data.truth(recipe.outputs)).float() - self.mean) / self.std
        split = data.split(self.schedule.seed)
        for name, curves in split.items():
            require(len(curves) >= 2, f"too few usable curves in the {name} part of {len(target)}")
        # indices (curves,) and target (curves, outputs) of "train", "validation", "test"; radii stay on the disk
        self.parts = {name: (i, target[i].to(device)) for name, i in split.items()}
        self.every = math.ceil(len(split["train"]) / self.schedule.batch)
        self.steps = self.schedule.epochs * self.every
        self.network = BubbleTransformer(recipe.network, problem.grid.frames, len(recipe.outputs)).to(device)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.schedule.lr)
        self.batches: Sequence[Tensor] = ()
        self.identity = {"data": data.sha256}

    def rate(self, step: int) -> float:
        return learning_rate(self.schedule, step, self.every)

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        epoch, place = divmod(step, self.every)
        curves, target = self.parts["train"]
        if place == 0:
            torch.manual_seed(int(np.random.SeedSequence([self.schedule.seed, epoch]).generate_state(1)[0]))
            self.batches = torch.randperm(len(curves)).split(self.schedule.batch)
            self.network.train(epoch < (self.schedule.dropout_epochs or self.schedule.epochs))  # only dropout heeds it
        batch = self.batches[place]
        loss = functional.mse_loss(self.network(self._radius(curves[batch.numpy()])), target[batch.to(self.device)])
        return loss, loss[None], len(batch)

    def line(self, losses: Sequence[float]) -> dict[str, Any]:
        validation = float(functional.mse_loss(self._predict("validation"), self.parts["validation"][1]))
        return {"epoch": self.step // self.every, "train": losses[0], "validation": validation}

    def result(self) -> dict[str, Any]:
        """The test part is looked at here, and nowhere else."""
        curves, target = self.parts["test"]
        truth, predicted = ((t * self.std + self.mean).numpy() for t in (target.cpu(), self._predict("test").cpu()))
        with whole(self.folder / "test.npz") as temporary, temporary.open("wb") as file:
            np.savez(file, radius=self.data.radius[curves], truth=truth, predicted=predicted)
        data = self.data
        origin = {"n": len(data.theta), "seed": data.seed, "sha256": data.sha256, "failures": data.failures}
        parts = {part: len(curves) for part, (curves, _) in self.parts.items()}
        return {
            "problem_id": self.recipe.problem.id,
            "data": origin | {"made_by": data.made_by} | parts,
            "metrics": metrics(self.recipe.outputs, truth, predicted),
        }

    def _radius(self, curves: Indices) -> Tensor:
        """(curves, frames) of these."""
        return torch.from_numpy(self.data.radius[curves]).to(self.device)

    @torch.inference_mode()
    def _predict(self, part: str) -> Tensor:
        self.network.eval()
        curves, _ = self.parts[part]
        starts = range(0, len(curves), EVALUATION_BATCH)
        return torch.cat([self.network(self._radius(curves[start : start + EVALUATION_BATCH])) for start in starts])


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
