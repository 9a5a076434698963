"""The posterior network: a residual network reads the bins, a chain of mixtures answers slot by slot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from cavirheo.inference.bins import SIZE
from cavirheo.inference.latent import COORDINATES

if TYPE_CHECKING:
    from cavirheo.training.posterior_recipe import PosteriorNetworkTable

LOG_2PI = math.log(2.0 * math.pi)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm, self.wide, self.back = nn.LayerNorm(width), nn.Linear(width, width), nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.back(nn.functional.silu(self.wide(self.norm(x))))


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
        hidden = nn.functional.silu(hidden)
        hidden = hidden + nn.functional.silu(torch.einsum("mkh,khg->mkg", hidden, self.middle) + self.bias)
        return _parts(torch.einsum("mkh,kho->mko", hidden, self.out) + self.out_bias)

    def slot(self, k: int, read: Tensor, earlier: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """`mixtures` of slot k alone, (draws, parts), from what was read for it and its kind (1, hidden)."""
        hidden = read
        for j, z in enumerate(earlier):
            hidden = hidden + z.clamp(-6.0, 6.0)[:, None] * self.before[k, j]
        hidden = nn.functional.silu(hidden)
        hidden = hidden + nn.functional.silu(hidden @ self.middle[k] + self.bias[k])
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
