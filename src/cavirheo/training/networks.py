"""The two networks, and their .onnx files, which are all that inference needs beside their cards.

The Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936) gives one value per output:

    radius (batch, 100)
      -> tokens: each radius beside a learned embedding of its place      (batch, 100, 1 + 64)
      -> dense, softplus, layer norm, dropout                             (batch, 100, 64)
      -> for each output its own branch:
           two encoder layers, normalised after each residual sum         (batch, 100, 64)
           mean over the tokens, dense, softplus, one linear unit         (batch, 1)

The paper's feed-forward layers have softplus, too; those of the shipped networks have ReLU (`activation` of a recipe).
What the description leaves open, chosen here: eight numbers per attention head (64 = 8 x 8), dropout on both residual
paths but not on the attention weights, and Keras' initial weights (Glorot uniform, zero biases, embeddings uniform
within 0.05). Its .onnx file maps (batch, frames) to the prior's scale, (batch, outputs): log10 of SI values.

The posterior network gives draws and densities (`SequentialDraws`): a residual network reads the bins, a chain of
mixtures answers coordinate by coordinate. The weights of its file have half precision, and it computes at single.
"""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxscript  # noqa: F401  torch exports with it: better missed now than after the training
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.inference.model import check_graph
from cavirheo.inference.posterior_network import COORDINATES, INPUTS, SIZE
from cavirheo.prior import Prior
from cavirheo.training.recipe import NetworkTable, PosteriorNetworkTable

OPSET = 18
_HALVED = 1000  # numbers in an array, from which it is stored at half precision
LOG_2PI = math.log(2.0 * math.pi)


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
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_uniform_(module.weight)
                nn.init.zeros_(module.bias)
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


def scaling(prior: Prior, outputs: tuple[str, ...]) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (outputs,) of the prior, by which targets are standardised."""
    columns = [prior.names.index(name) for name in outputs]
    low, high = prior.low[columns], prior.high[columns]
    mean, std = torch.from_numpy((low + high) / 2), torch.from_numpy((high - low) / math.sqrt(12))
    return mean.float(), std.float()


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm, self.wide, self.back = nn.LayerNorm(width), nn.Linear(width, width), nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.back(functional.silu(self.wide(self.norm(x))))


class PosteriorNetwork(nn.Module):
    """Density of the slots z of one of `kinds` laws and bubbles, given a recording's bins.

    Slot k is a mixture of `parts` Gaussians whose shares, means and widths a small network makes of what the encoder
    read, the kind, and the slots before it. One encoder reads for all kinds.
    """

    def __init__(self, kinds: int, size: PosteriorNetworkTable) -> None:
        super().__init__()
        d, width, hidden, parts = len(COORDINATES), size.width, size.hidden, size.parts
        self.parts = parts
        self.first = nn.Linear(SIZE, width)
        self.blocks = nn.ModuleList([_Residual(width) for _ in range(size.depth)])
        self.norm = nn.LayerNorm(width)
        self.read = nn.Linear(width, d * hidden)
        self.kind = nn.Parameter(0.1 * torch.randn(kinds, d, hidden))
        self.before = nn.Parameter(torch.randn(d, d, hidden) / math.sqrt(d))
        self.middle = nn.Parameter(torch.randn(d, hidden, hidden) / math.sqrt(hidden))
        self.bias = nn.Parameter(torch.zeros(d, hidden))
        self.out = nn.Parameter(0.3 * torch.randn(d, hidden, 3 * parts) / math.sqrt(hidden))
        start = torch.zeros(d, 3, parts)
        start[:, 1] = torch.linspace(-1.5, 1.5, parts)
        self.out_bias = nn.Parameter(start.reshape(d, 3 * parts))
        self.guess = nn.Linear(width, kinds)
        self.earlier: Tensor
        self.register_buffer("earlier", torch.tril(torch.ones(d, d), -1)[:, :, None])

    def encode(self, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """(m, 9, hidden) of inputs (m, SIZE), and (m, kinds) log odds of the kinds."""
        x = self.first(inputs)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        return self.read(x).unflatten(1, (len(COORDINATES), -1)), self.guess(x)

    def mixtures(self, read: Tensor, kind: Tensor, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Log shares, means and log widths, each (m, 9, parts), of each slot given the slots before it in z (m, 9);
        read (m, 9, hidden), kind (m,)."""
        before = self.before * self.earlier  # [k, j]: of slot j for slot k
        hidden = read + self.kind[kind] + torch.einsum("mj,kjh->mkh", z.clamp(-6.0, 6.0), before)
        hidden = functional.silu(hidden)
        hidden = hidden + functional.silu(torch.einsum("mkh,khg->mkg", hidden, self.middle) + self.bias)
        return _parts(torch.einsum("mkh,kho->mko", hidden, self.out) + self.out_bias)

    def slot(self, k: int, read: Tensor, earlier: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """`mixtures` of slot k alone, (draws, parts), from what was read for it and its kind (1, hidden)."""
        hidden = read
        for j, z in enumerate(earlier):
            hidden = hidden + z.clamp(-6.0, 6.0)[:, None] * self.before[k, j]
        hidden = functional.silu(hidden)
        hidden = hidden + functional.silu(hidden @ self.middle[k] + self.bias[k])
        return _parts(hidden @ self.out[k] + self.out_bias[k])

    def log_density(self, read: Tensor, kind: Tensor, z: Tensor) -> Tensor:
        """(m, 9) of each slot in z, given those before it."""
        return log_mixture(*self.mixtures(read, kind, z), z)


def log_mixture(share: Tensor, mean: Tensor, width: Tensor, z: Tensor) -> Tensor:
    """Log density at z (...) of mixtures (..., parts)."""
    off = (z[..., None] - mean) * torch.exp(-width)
    return torch.logsumexp(share - width - 0.5 * (off**2 + LOG_2PI), dim=-1)


def _parts(out: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Log shares, means and log widths of the components."""
    share, mean, width = out.chunk(3, dim=-1)
    return torch.log_softmax(share, dim=-1), mean, 7.0 * torch.tanh(width / 7.0)


class SequentialDraws(nn.Module):
    """Draws of one recording, slot by slot, or stated ones, and their density: what an .onnx file computes.

    bins: (1, SIZE). kind: (1, kinds), zeros and a one. has: (9,) 1 for the slots of that kind, else 0. counted: (9,) 1
    for the slots whose density is asked for. choice: (draws, 9, parts) from Gumbel's distribution and normal: (draws,
    9) from the standard normal one, of which draws are made. stated: (draws, 9), taken instead where `take` (9,) is 1.
    Returns z (draws, 9), log density of the counted slots given those before them (draws,), and log odds of the kinds
    (1, kinds).
    """

    def __init__(self, network: PosteriorNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(
        self,
        bins: Tensor,
        kind: Tensor,
        has: Tensor,
        counted: Tensor,
        choice: Tensor,
        normal: Tensor,
        stated: Tensor,
        take: Tensor,
    ) -> tuple[Tensor, ...]:
        net = self.network
        encoded, kind_score = net.encode(bins)
        encoded = encoded + torch.einsum("bk,kdh->bdh", kind, net.kind)
        earlier: list[Tensor] = []
        log_density = torch.zeros_like(normal[:, 0])
        for k in range(len(COORDINATES)):
            share, mean, width = net.slot(k, encoded[:, k].expand(normal.shape[0], -1), earlier)
            part = torch.argmax(share + choice[:, k], dim=1, keepdim=True)
            centre, scale = torch.gather(mean, 1, part)[:, 0], torch.exp(torch.gather(width, 1, part)[:, 0])
            z = take[k] * stated[:, k] + (1.0 - take[k]) * (centre + scale * normal[:, k])
            log_density = log_density + counted[k] * log_mixture(share, mean, width, z)
            earlier.append(has[k] * z)
        return torch.stack(earlier, dim=1), log_density, torch.log_softmax(kind_score, dim=-1)


def write_onnx(model: Standardised, frames: int, path: Path) -> None:
    """A self-contained file with a free batch size."""
    free = {"radius": {0: torch.export.Dim("batch", min=1)}}
    onnx.save_model(_onnx(model, (torch.ones(2, frames),), ["radius"], ["theta"], free), path)


def write_posterior(network: PosteriorNetwork, path: Path) -> None:
    """The same with a free number of draws; it computes what was trained, but for its weights' precision."""
    d, kinds = len(COORDINATES), len(network.kind)
    random = torch.zeros(5, d, network.parts), torch.zeros(5, d), torch.zeros(5, d), torch.zeros(d)
    example = torch.zeros(1, SIZE), torch.zeros(1, kinds), torch.ones(d), torch.ones(d), *random
    draws = torch.export.Dim("draws", min=2)
    free = (None, None, None, None, {0: draws}, {0: draws}, {0: draws}, None)
    content = _onnx(SequentialDraws(network.eval()), example, INPUTS, ["z", "log_density", "guess"], free)
    _halve(content.graph)
    onnx.checker.check_model(content)
    onnx.save_model(content, path)
    check_graph(path.read_bytes(), INPUTS)


def _onnx(
    model: nn.Module, example: tuple[Any, ...], inputs: Sequence[str], outputs: Sequence[str], free: Any
) -> onnx.ModelProto:
    """A model without the exporter's notes of where our code lies."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else it tells of operators that we do not use
    how: dict[str, Any] = {"input_names": list(inputs), "output_names": list(outputs), "dynamic_shapes": free}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter, not ours to mend
        program = torch.onnx.export(model, example, opset_version=OPSET, dynamo=True, verbose=False, **how)
    assert program is not None  # it is None only where a file is asked for
    content = program.model_proto
    for item in (*content.graph.node, *content.graph.value_info, *content.functions, content.graph, content):
        item.ClearField("doc_string")
        item.ClearField("metadata_props")
    return content


def _halve(graph: onnx.GraphProto) -> None:
    """Large arrays at half precision, cast back where they are used."""
    casts = []
    for array in graph.initializer:
        values, name = numpy_helper.to_array(array), array.name
        if values.dtype == np.float32 and values.size >= _HALVED:
            array.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            casts.append(helper.make_node("Cast", [array.name], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
