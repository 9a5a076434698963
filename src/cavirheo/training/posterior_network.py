"""The posterior network, and its training.

A residual network reads the bins, a chain of mixtures answers coordinate by coordinate. The training minimises the
plain negative log density of the truth, of another recording each time. The rate warms up, stays, and falls in the last
fifth, so that a part of a training can be continued; weights are averaged along the way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from cavirheo.inference.posterior_network import COORDINATES, SIZE, used
from cavirheo.training.loop import Training
from cavirheo.training.recipe import PosteriorNetworkTable, PosteriorRecipe
from cavirheo.training.recordings import CurveStore, Filmed, film

VALIDATION = 0.03  # of the curves, which no step sees
MOST_HELD = 4000  # of them: all of these are in memory, as the network reads them
FEWEST_VALIDATED = 100  # recordings of them, of which some have no readable R_max
EVERY = 800  # steps from one validation to the next
KIND_LOSS = 0.1  # weight of the loss of law and bubble
DRAWS = 300  # of each recording, by which the coverage is counted
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


class PosteriorTraining(Training[PosteriorNetwork]):
    """One training on recordings of simulated curves; everything follows from (seed, step)."""

    every, clip = EVERY, 2.0

    def __init__(self, recipe: PosteriorRecipe, curves: CurveStore, folder: Path) -> None:
        super().__init__(recipe, folder, torch.device("cpu"))
        self.curves, self.schedule, self.steps = curves, recipe.training, recipe.training.steps
        self.kinds = [(law, bubble) for law, bubble, _ in recipe.problem.kinds]
        self.network = PosteriorNetwork(len(self.kinds), recipe.network)
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), self.schedule.rate, weight_decay=self.schedule.decay, fused=True
        )
        self.mask = torch.zeros(len(self.kinds), len(COORDINATES))  # which coordinates a kind has
        for i, kind in enumerate(self.kinds):
            self.mask[i, used(*kind)] = 1.0
        n = len(curves.kind)
        self.identity = {"curves": n}
        first_held = max(round((1.0 - VALIDATION) * n), n - MOST_HELD)
        self.train, self.held = np.arange(first_held), np.arange(first_held, n)
        repeated = np.resize(self.held, max(len(self.held), FEWEST_VALIDATED))  # each several times where they are few
        self.validation = film(curves, repeated, 2**31 - 1)

    def rate(self, step: int) -> float:
        schedule = self.schedule
        left = (self.steps - step) / max(schedule.falling * self.steps, 1.0)
        return schedule.rate * min(1.0, (step + 1) / schedule.warm_up) * min(1.0, max(left, 0.0) + 0.003)

    def loss(self, step: int) -> tuple[Tensor, Tensor, int]:
        batch = self._batch(step)
        kind = torch.from_numpy(batch.kind)
        encoded, kind_score = self.network.encode(torch.from_numpy(batch.inputs))
        density = self.network.log_density(encoded, kind, torch.from_numpy(batch.z))
        loss = -(density * self.mask[kind]).sum(dim=1).mean()
        kind_loss = nn.functional.cross_entropy(kind_score, kind)
        return loss + KIND_LOSS * kind_loss, torch.stack([loss, kind_loss]).double(), 1

    def _batch(self, step: int) -> Filmed:
        """As many recordings as a step shows."""
        rng = np.random.default_rng([self.schedule.seed, step])
        size, parts = self.schedule.batch, list[Filmed]()
        while (count := sum(len(part.z) for part in parts)) < size:
            index = rng.choice(self.train, int(1.8 * (size - count)) + 32)
            parts.append(film(self.curves, index, int(rng.integers(2**31 - 1))))
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Filmed(*(np.concatenate(column)[:size] for column in columns))

    @torch.inference_mode()
    def line(self, losses: Sequence[float]) -> dict[str, Any]:
        """With losses of the averaged weights on recordings of curves that were never shown."""
        kind, inputs, z = (torch.from_numpy(getattr(self.validation, name)) for name in ("kind", "inputs", "z"))
        encoded, kind_score = self.exported.encode(inputs)
        density = self.exported.log_density(encoded, kind, z) * self.mask[kind]
        by_slot = [float(-density[:, k][self.mask[kind][:, k] > 0].mean()) for k in range(len(COORDINATES))]
        by_kind = [float(-density[kind == k].sum(dim=1).mean()) for k in range(len(self.kinds))]
        return {
            "step": self.step,
            "samples": self.step * self.schedule.batch,
            "train": losses[0],
            "guess": losses[1],
            "validation": float(-density.sum(dim=1).mean()),
            "right_kind": float((kind_score.argmax(dim=1) == kind).float().mean()),
            "slots": [round(loss, 3) for loss in by_slot],
            "kinds": [round(loss, 3) for loss in by_kind],
        }

    def result(self) -> dict[str, Any]:
        return {
            "samples": self.history[-1]["samples"],
            "curves": len(self.train),
            "held_out": len(self.held),
            "loss_by_kind": self.history[-1]["kinds"],
            "coverage": self._coverage(),
        }

    @torch.inference_mode()
    def _coverage(self) -> dict[str, Any]:
        """Shares of the recordings whose truth is in the central 50 and 90 % of the network's draws, by slot."""
        recordings, one_hot, nothing = self.validation, torch.eye(len(self.kinds)), torch.zeros(len(COORDINATES))
        rng, sequential = torch.Generator().manual_seed(0), SequentialDraws(self.exported.eval())
        below = np.full(recordings.z.shape, np.nan)
        for i, kind in enumerate(recordings.kind.tolist()):
            uniform = torch.rand((DRAWS, len(COORDINATES), self.exported.parts), generator=rng).clamp(1e-9)
            normal = torch.randn((DRAWS, len(COORDINATES)), generator=rng)
            inputs = torch.from_numpy(recordings.inputs[i : i + 1])
            has, choice = self.mask[kind], -torch.log(-torch.log(uniform))
            z, _, _ = sequential(inputs, one_hot[kind : kind + 1], has, has, choice, normal, normal, nothing)
            places = used(*self.kinds[kind])
            below[i, places] = (z < torch.from_numpy(recordings.z[i])).float().mean(dim=0)[places]
        by_slot = {}
        for name, shares in zip(COORDINATES, below.T, strict=True):
            if len(off := np.abs(2.0 * shares[np.isfinite(shares)] - 1.0)):
                by_slot[name] = {str(level): round(float(np.mean(off < level / 100)), 4) for level in (50, 90)}
        return {"recordings": len(recordings.kind), "by_slot": by_slot}
