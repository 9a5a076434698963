"""The network of the Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936), all of it in this file.

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
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

if TYPE_CHECKING:
    from cavirheo.training.recipe import NetworkTable


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
