"""Training of a posterior network: plain negative log density of the truth, another recording each time.

The rate warms up, stays, and falls in the last fifth, so that a part of a training can be continued; weights are
averaged along the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from cavirheo.inference.latent import COORDINATES, used
from cavirheo.training.camera import Filmed, film
from cavirheo.training.curves import CurveStore
from cavirheo.training.loop import Training
from cavirheo.training.posterior_network import PosteriorNetwork, SequentialDraws
from cavirheo.training.posterior_recipe import PosteriorRecipe

VALIDATION = 0.03  # of the curves, which no step sees
MOST_HELD = 4000  # of them: all of these are in memory, as the network reads them
FEWEST_VALIDATED = 100  # recordings of them, of which some have no readable R_max
EVERY = 800  # steps from one validation to the next
KIND_LOSS = 0.1  # weight of the loss of law and bubble
DRAWS = 300  # of each recording, by which the coverage is counted


class PosteriorTraining(Training[PosteriorNetwork]):
    """One training on recordings of simulated curves; everything follows from (seed, step)."""

    every, clip = EVERY, 2.0

    def __init__(self, recipe: PosteriorRecipe, curves: CurveStore, folder: Path) -> None:
        self.curves, self.folder, self.schedule = curves, folder, recipe.training
        self.name, self.settings, self.device = recipe.export.name, recipe.settings(), torch.device("cpu")
        self.steps = self.schedule.steps
        torch.manual_seed(self.schedule.seed)
        self.kinds = [(law, bubble) for law, bubble, _ in recipe.posterior.kinds]
        self.network = PosteriorNetwork(len(self.kinds), recipe.network)
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), self.schedule.rate, weight_decay=self.schedule.decay, fused=True
        )
        self.mask = torch.zeros(len(self.kinds), len(COORDINATES))  # which coordinates a kind has
        for i, kind in enumerate(self.kinds):
            self.mask[i, used(*kind)] = 1.0
        n = len(curves.kind)
        identity: dict[str, Any] = self.settings | {"curves": n}
        first_unseen = round((1.0 - VALIDATION) * n)
        first_held = max(first_unseen, n - MOST_HELD)
        if first_held > first_unseen:
            identity["held"] = MOST_HELD
        self.identity = identity
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
        kind_loss = torch.nn.functional.cross_entropy(kind_score, kind)
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
        below: dict[str, list[float]] = {name: [] for name in COORDINATES}
        for i, kind in enumerate(recordings.kind.tolist()):
            uniform = torch.rand((DRAWS, len(COORDINATES), self.exported.parts), generator=rng).clamp(1e-9)
            normal, inputs = (
                torch.randn((DRAWS, len(COORDINATES)), generator=rng),
                torch.from_numpy(recordings.inputs[i : i + 1]),
            )
            has, choice = self.mask[kind], -torch.log(-torch.log(uniform))
            z, _, _ = sequential(inputs, one_hot[kind : kind + 1], has, has, choice, normal, normal, nothing)
            share = (z < torch.from_numpy(recordings.z[i])).float().mean(dim=0)
            for k in used(*self.kinds[kind]):
                below[COORDINATES[k]].append(float(share[k]))
        away = {name: np.abs(2.0 * np.array(shares) - 1.0) for name, shares in below.items() if shares}
        by_slot = {
            name: {str(level): round(float(np.mean(off < level / 100)), 4) for level in (50, 90)}
            for name, off in away.items()
        }
        return {"recordings": len(recordings.kind), "by_slot": by_slot}
