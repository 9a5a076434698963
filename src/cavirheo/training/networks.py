"""The two kinds of networks, as torch trains them; inference computes them in numpy from files of weights alone.

The Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936) gives one value per output. The paper's feed-forward
layers have softplus, too; those of the shipped networks have ReLU (`activation` of a recipe). The paper leaves some
choices open. Those of this module: eight numbers per attention head (64 = 8 x 8), dropout on both residual paths but
not on the attention weights, and Keras' initial weights (Glorot uniform, zero biases, embeddings uniform within 0.05).
Outputs are in the prior's scale: SI values or their log10. In numpy: inference/bdt.py.

The emulator gives the trajectory of a bubble. In numpy: inference/emulator.py.
"""

from __future__ import annotations

import math
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.arrays import Floats
from cavirheo.inference.emulator import FARTHEST, INPUTS, NODES
from cavirheo.prior import Prior
from cavirheo.training.recipe import EmulatorNetworkTable, NetworkTable, PointRecipe


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
    """The layers of one output."""

    def __init__(self, size: NetworkTable) -> None:
        super().__init__()
        self.layers = nn.Sequential(*(EncoderLayer(size) for _ in range(size.layers)))
        self.dense = nn.Linear(size.width, size.width)
        self.output = nn.Linear(size.width, 1)

    def forward(self, x: Tensor) -> Tensor:
        pooled = self.layers(x).mean(dim=1)  # (batch, width)
        return self.output(functional.softplus(self.dense(pooled)))  # (batch, 1)


class BubbleTransformer(nn.Module):
    """Map R/R_max (batch, tokens) to standardised targets (batch, outputs); `mean` and `std` (outputs,) of the prior,
    which are not trained, scale these."""

    mean: Tensor
    std: Tensor

    def __init__(self, size: NetworkTable, tokens: int, prior: Prior) -> None:
        super().__init__()
        self.position = nn.Parameter(torch.empty(tokens, size.position))
        self.dense = nn.Linear(1 + size.position, size.width)
        self.norm = nn.LayerNorm(size.width, eps=size.norm_epsilon)
        self.dropout = nn.Dropout(size.dropout)
        self.branches = nn.ModuleList(Branch(size) for _ in prior.names)
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_uniform_(module.weight)
                nn.init.zeros_(module.bias)
        nn.init.uniform_(self.position, -0.05, 0.05)
        self.register_buffer("mean", torch.from_numpy((prior.low + prior.high) / 2).float())
        self.register_buffer("std", torch.from_numpy((prior.high - prior.low) / math.sqrt(12)).float())

    @classmethod
    def of(cls, recipe: PointRecipe) -> Self:
        """The network of a recipe, with random weights."""
        problem = recipe.problem
        return cls(recipe.network, problem.frames, problem.prior.marginal(recipe.outputs))

    def forward(self, radius: Tensor) -> Tensor:
        position = self.position.expand(radius.shape[0], -1, -1)
        x = torch.cat([radius.unsqueeze(-1), position], dim=-1)  # (batch, tokens, 1 + position)
        x = self.dropout(self.norm(functional.softplus(self.dense(x))))  # (batch, tokens, width)
        return torch.cat([branch(x) for branch in self.branches], dim=-1)

    def answers(self, radius: Tensor) -> Tensor:
        """Values (batch, outputs) in the prior's scale, SI or their log10."""
        return self(radius) * self.std + self.mean


class Residual(nn.ModuleDict):
    """Two layers, whose result is added to their input."""

    def __init__(self, width: int) -> None:
        linear = nn.Linear
        super().__init__({"norm": nn.LayerNorm(width), "in": linear(width, width), "out": linear(width, width)})

    def forward(self, x: Tensor) -> Tensor:
        return x + self["out"](functional.silu(self["in"](self["norm"](x))))


class EmulatorNetwork(nn.Module):
    """Map what is told of a bubble (batch, INPUTS) to R/R_max and t/T (batch, 2 NODES): residual blocks, and weights of
    the principal components of trajectories, which are fixed."""

    mean: Tensor
    std: Tensor
    offset: Tensor
    scale: Tensor
    decoder: Tensor

    def __init__(self, size: EmulatorNetworkTable) -> None:
        super().__init__()
        width, linear = size.width, nn.Linear
        self.first = linear(INPUTS, width)
        self.blocks = nn.ModuleList(Residual(width) for _ in range(size.depth))
        self.last = linear(width, size.components)
        shapes: dict[str, tuple[int, ...]] = {"mean": (INPUTS,), "std": (INPUTS,), "offset": (2 * NODES,)}
        shapes |= {"scale": (size.components,), "decoder": (size.components, 2 * NODES)}
        for name, shape in shapes.items():
            self.register_buffer(name, torch.zeros(shape))

    def forward(self, inputs: Tensor) -> Tensor:
        x = self.first(((inputs - self.mean) / self.std).clamp(-FARTHEST, FARTHEST))
        for block in self.blocks:
            x = block(x)
        return (self.last(x) * self.scale) @ self.decoder + self.offset

    answers = forward

    def fit(self, inputs: Floats, curves: Floats) -> None:
        """Set what is not trained: scaling of the inputs (k, INPUTS), and principal components of trajectories
        (k, 2 NODES), in which times have twice the weight."""
        self.mean.copy_(torch.from_numpy(inputs.mean(axis=0)))
        self.std.copy_(torch.from_numpy(inputs.std(axis=0) + 1e-6))
        offset = curves.mean(axis=0)
        radius, time = np.hsplit(curves, 2)
        unit = np.repeat([radius.std(), 0.5 * time.std()], NODES)
        _, values, rows = np.linalg.svd((curves - offset) / unit, full_matrices=False)
        count = len(self.scale)
        self.offset.copy_(torch.from_numpy(offset))
        self.decoder.copy_(torch.from_numpy(rows[:count] * unit))
        self.scale.copy_(torch.from_numpy(values[:count] / np.sqrt(len(curves))))


def arrays_of(network: BubbleTransformer | EmulatorNetwork) -> dict[str, NDArray[np.float32]]:
    """The arrays of a network's file of weights."""
    state = network.state_dict()
    if isinstance(network, EmulatorNetwork):
        scale = state.pop("scale")
        state["last.weight"], state["last.bias"] = state["last.weight"] * scale[:, None], state["last.bias"] * scale
    return {name.removeprefix("blocks."): tensor.cpu().numpy() for name, tensor in sorted(state.items())}
