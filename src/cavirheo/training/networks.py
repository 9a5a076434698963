"""The two networks and their .onnx files; inference needs these files and their cards alone.

The Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936) gives one value per output:

    radius (batch, 100)
      -> tokens: each radius beside a learned embedding of its place      (batch, 100, 1 + 64)
      -> dense, softplus, layer norm, dropout                             (batch, 100, 64)
      -> for each output its own branch:
           two encoder layers, normalised after each residual sum         (batch, 100, 64)
           mean over the tokens, dense, softplus, one linear unit         (batch, 1)

The paper's feed-forward layers have softplus, too; those of the shipped networks have ReLU (`activation` of a recipe).
The paper leaves some choices open. Those of this module: eight numbers per attention head (64 = 8 x 8), dropout on both
residual paths but not on the attention weights, and Keras' initial weights (Glorot uniform, zero biases, embeddings
uniform within 0.05). Its .onnx file maps radii (batch, frames) to outputs (batch, outputs) in the prior's scale: SI
values or their log10.

The posterior network gives draws and densities (`SequentialDraws`): a residual network reads the bins, and a chain of
mixtures gives the coordinates one by one. Its weights are stored at half precision; it computes at single precision.
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
_LEAST_HALVED = 1000  # arrays of at least so many numbers are stored at half precision
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
    """Map R/R_max (batch, tokens) to standardised targets (batch, outputs)."""

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


class Unstandardised(nn.Module):
    """The network with the scaling of its targets undone: outputs in the prior's scale, SI values or their log10."""

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
    """Mean and standard deviation (outputs,) of the prior, which standardise the targets."""
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
    """Density of the slots z of a recording, given its bins and one of `kinds` pairs of law and bubble.

    Slot k has a mixture of `parts` Gaussians. A small network computes their shares, means and widths from the features
    of the encoder, the kind, and the slots before k. All kinds share one encoder.
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
        """Features (m, 9, hidden) and logits of the kinds (m, kinds) for inputs (m, SIZE)."""
        x = self.first(inputs)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        return self.read(x).unflatten(1, (len(COORDINATES), -1)), self.guess(x)

    def mixtures(self, read: Tensor, kind: Tensor, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Log shares, means and log widths, each (m, 9, parts), of each slot given the slots before it in z (m, 9).
        read: features (m, 9, hidden). kind: (m,) indices."""
        before = self.before * self.earlier  # [k, j]: weights of slot j for slot k
        hidden = read + self.kind[kind] + torch.einsum("mj,kjh->mkh", z.clamp(-6.0, 6.0), before)
        hidden = functional.silu(hidden)
        hidden = hidden + functional.silu(torch.einsum("mkh,khg->mkg", hidden, self.middle) + self.bias)
        return _parts(torch.einsum("mkh,kho->mko", hidden, self.out) + self.out_bias)

    def slot(self, k: int, read: Tensor, earlier: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """`mixtures` of slot k alone, (draws, parts). read: features (draws, hidden) of the slot, plus the kind's."""
        hidden = read
        for j, z in enumerate(earlier):
            hidden = hidden + z.clamp(-6.0, 6.0)[:, None] * self.before[k, j]
        hidden = functional.silu(hidden)
        hidden = hidden + functional.silu(hidden @ self.middle[k] + self.bias[k])
        return _parts(hidden @ self.out[k] + self.out_bias[k])

    def log_density(self, read: Tensor, kind: Tensor, z: Tensor) -> Tensor:
        """Log density (m, 9) of each slot in z (m, 9), given the slots before it."""
        return log_mixture(*self.mixtures(read, kind, z), z)


def log_mixture(share: Tensor, mean: Tensor, width: Tensor, z: Tensor) -> Tensor:
    """Log density at z (...) of mixtures (..., parts) with log shares, means and log widths."""
    off = (z[..., None] - mean) * torch.exp(-width)
    return torch.logsumexp(share - width - 0.5 * (off**2 + LOG_2PI), dim=-1)


def _parts(out: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Log shares, means and log widths (..., parts) from outputs (..., 3 parts)."""
    share, mean, width = out.chunk(3, dim=-1)
    return torch.log_softmax(share, dim=-1), mean, 7.0 * torch.tanh(width / 7.0)


class SequentialDraws(nn.Module):
    """Draws for one recording, slot by slot, or stated values, with their density: what an .onnx file computes.

    bins: (1, SIZE). kind: (1, kinds), one-hot. has: (9,) 1 for the slots of that kind, else 0. counted: (9,) 1 for the
    slots whose density is wanted. Random numbers of the draws: choice (draws, 9, parts) from Gumbel's distribution and
    normal (draws, 9) from the standard normal. stated: values (draws, 9) that are used where `take` (9,) is 1.
    Returns z (draws, 9), log density (draws,) of the counted slots given the slots before them, and log probabilities
    of the kinds (1, kinds).
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


def write_onnx(model: Unstandardised, frames: int, path: Path) -> None:
    """Write a self-contained .onnx file with a free batch size."""
    dynamic = {"radius": {0: torch.export.Dim("batch", min=1)}}
    onnx.save_model(_onnx(model, (torch.ones(2, frames),), ["radius"], ["theta"], dynamic), path)


def write_posterior(network: PosteriorNetwork, path: Path) -> None:
    """Write a self-contained .onnx file with a free number of draws; large weights are rounded to half precision."""
    d, kinds = len(COORDINATES), len(network.kind)
    random = torch.zeros(5, d, network.parts), torch.zeros(5, d), torch.zeros(5, d), torch.zeros(d)
    example = torch.zeros(1, SIZE), torch.zeros(1, kinds), torch.ones(d), torch.ones(d), *random
    draws = torch.export.Dim("draws", min=2)
    dynamic = (None, None, None, None, {0: draws}, {0: draws}, {0: draws}, None)
    content = _onnx(SequentialDraws(network.eval()), example, INPUTS, ["z", "log_density", "guess"], dynamic)
    _store_at_half_precision(content.graph)
    onnx.checker.check_model(content)
    onnx.save_model(content, path)
    check_graph(path.read_bytes(), INPUTS)


def _onnx(
    model: nn.Module, example: tuple[Any, ...], inputs: Sequence[str], outputs: Sequence[str], dynamic: Any
) -> onnx.ModelProto:
    """The ONNX form of a model, without the exporter's notes, which contain paths of the source code."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else it reports operators that are not used
    options: dict[str, Any] = {"input_names": list(inputs), "output_names": list(outputs), "dynamic_shapes": dynamic}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter
        program = torch.onnx.export(model, example, opset_version=OPSET, dynamo=True, verbose=False, **options)
    assert program is not None  # None only if a file is asked for
    content = program.model_proto
    for item in (*content.graph.node, *content.graph.value_info, *content.functions, content.graph, content):
        item.ClearField("doc_string")
        item.ClearField("metadata_props")
    return content


def _store_at_half_precision(graph: onnx.GraphProto) -> None:
    """Store large arrays at half precision, with nodes that cast them to single precision."""
    casts = []
    for array in graph.initializer:
        values, name = numpy_helper.to_array(array), array.name
        if values.dtype == np.float32 and values.size >= _LEAST_HALVED:
            array.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            casts.append(helper.make_node("Cast", [array.name], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
