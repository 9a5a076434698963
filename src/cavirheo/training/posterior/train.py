"""Training of a posterior network: plain negative log density of the truth, another recording each time.

The rate warms up, stays, and falls in the last fifth, so that a part of a training can be continued; weights are
averaged along the way. Everything follows from (seed, step): a run that was cut off ends where it would have.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.inference.latent import SLOTS, used
from cavirheo.training.dataset import difference
from cavirheo.training.posterior.camera import Filmed, film
from cavirheo.training.posterior.network import PosteriorNetwork
from cavirheo.training.posterior.recipe import PosteriorRecipe
from cavirheo.training.posterior.store import CurveStore
from cavirheo.training.train import adam_tensors, load_adam, read_tensors, write_tensors
from cavirheo.writing.terminal import bar

VALIDATION = 0.03  # of the curves, which no step sees
MOST_HELD = 4000  # of them: all of these are in memory, as the network reads them
AVERAGED = 0.999
GUESS = 0.1  # weight of the law's loss
CLIP = 2.0


def masks(kinds: Sequence[tuple[str, str]]) -> Tensor:
    """(kinds, 9) which slots a kind has."""
    found = torch.zeros(len(kinds), len(SLOTS))
    for i, kind in enumerate(kinds):
        found[i, used(*kind)] = 1.0
    return found


class PosteriorTraining:
    """One training in a folder, resumed where it stopped. Raises InputError: the folder holds another one."""

    def __init__(self, recipe: PosteriorRecipe, shots: CurveStore, folder: Path) -> None:
        schedule = recipe.training
        torch.manual_seed(schedule.seed)
        kinds = [(law, bubble) for law, bubble, _ in recipe.posterior.kinds]
        self.shots, self.kinds, self.folder, self.schedule = shots, kinds, folder, schedule
        self.identity = recipe.settings() | recipe.network.model_dump() | {"curves": len(shots.kind)}
        self.network = PosteriorNetwork(len(kinds), **recipe.network.model_dump())
        self.mean = PosteriorNetwork(len(kinds), **recipe.network.model_dump())
        self.mean.load_state_dict(self.network.state_dict())
        for values in self.mean.parameters():
            values.requires_grad_(False)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), schedule.rate, weight_decay=schedule.decay, fused=True
        )
        self.mask = masks(kinds)
        self.step, self.history, self.seconds = 0, list[dict[str, Any]](), 0.0
        shown = round((1.0 - VALIDATION) * len(shots.kind))
        held = max(shown, len(shots.kind) - MOST_HELD)
        if held > shown:
            self.identity["held"] = MOST_HELD
        self.train, self.held = np.arange(held), np.arange(held, len(shots.kind))
        self.check = film(shots, self.held, 2**31 - 1)
        self._resume()

    def fit(self, *, every: int = 800, progress: bool = True) -> None:
        """Train to the end; a checkpoint and a line of the history each `every` steps."""
        with bar("training", self.schedule.steps, shown=progress, unit="steps") as advance:
            advance(self.step)
            self._fit(every, advance)

    def _fit(self, every: int, advance: Callable[..., None]) -> None:
        began, summed, losses = time.perf_counter(), np.zeros(2), 0
        while self.step < self.schedule.steps:
            shown = self._batch()
            for group in self.optimiser.param_groups:
                group["lr"] = self.schedule.rate_at(self.step)
            loss, parts = self._loss(self.network, shown)
            self.optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), CLIP)
            self.optimiser.step()
            self.step += 1
            advance(1)
            keep = min(AVERAGED, self.step / (self.step + 10.0))
            with torch.no_grad():
                torch._foreach_lerp_(list(self.mean.parameters()), list(self.network.parameters()), 1.0 - keep)
            summed, losses = summed + parts, losses + 1
            if self.step % every == 0 or self.step == self.schedule.steps:
                self.seconds += time.perf_counter() - began
                began = time.perf_counter()
                line = {"step": self.step, "samples": self.step * self.schedule.batch, "seconds": self.seconds}
                line |= {"train": float(summed[0] / losses), "guess": float(summed[1] / losses)} | self.validate()
                self.history.append(line)
                self._save()
                advance(0, what=f"training, loss {line['validation']:.3f} on curves that are not shown")
                summed, losses = np.zeros(2), 0

    def _batch(self) -> Filmed:
        """As many recordings as a step shows."""
        rng = np.random.default_rng([self.schedule.seed, self.step])
        wanted, parts = self.schedule.batch, list[Filmed]()
        while (have := sum(len(part.z) for part in parts)) < wanted:
            index = rng.choice(self.train, int(1.8 * (wanted - have)) + 32)
            parts.append(film(self.shots, index, int(rng.integers(2**31 - 1))))
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Filmed(*(np.concatenate(column)[:wanted] for column in columns))

    def _loss(self, network: PosteriorNetwork, shown: Filmed) -> tuple[Tensor, Floats]:
        kind = torch.from_numpy(shown.kind)
        read, guess = network.encode(torch.from_numpy(shown.inputs))
        density = network.log_density(read, kind, torch.from_numpy(shown.z))
        loss = -(density * self.mask[kind]).sum(dim=1).mean()
        guessed = torch.nn.functional.cross_entropy(guess, kind)
        return loss + GUESS * guessed, np.array([loss.item(), guessed.item()])

    @torch.inference_mode()
    def validate(self) -> dict[str, Any]:
        """Loss of the averaged weights on recordings of curves that were never shown, and by kind."""
        found, check = dict[str, Any](), self.check
        kind, inputs, z = torch.from_numpy(check.kind), torch.from_numpy(check.inputs), torch.from_numpy(check.z)
        read, guess = self.mean.encode(inputs)
        density = self.mean.log_density(read, kind, z) * self.mask[kind]
        found["validation"] = float(-density.sum(dim=1).mean())
        found["right_kind"] = float((guess.argmax(dim=1) == kind).float().mean())
        found["slots"] = [round(float(-density[:, k][self.mask[kind][:, k] > 0].mean()), 3) for k in range(len(SLOTS))]
        found["kinds"] = [round(float(-density[kind == k].sum(dim=1).mean()), 3) for k in range(len(self.kinds))]
        return found

    def _state(self) -> dict[str, Tensor]:
        state = {f"network.{name}": values for name, values in self.network.state_dict().items()}
        state |= {f"mean.{name}": values for name, values in self.mean.state_dict().items()}
        return state | adam_tensors(self.optimiser)

    def _save(self) -> None:
        note = {"step": self.step, "history": self.history, "seconds": self.seconds, "identity": self.identity}
        write_tensors(self.folder / "last.safetensors", self._state(), note)

    def _resume(self) -> None:
        path = self.folder / "last.safetensors"
        if not path.exists():
            return
        state, note = read_tensors(path)
        other = difference(note["identity"], json.loads(json.dumps(self.identity)))
        mend = "use another folder, or the recipe and data that it was begun with"
        require(not other, f"{self.folder} holds another run ({other}): {mend}", "training.another_run")
        load_adam(self.optimiser, state)
        for part, network in (("network.", self.network), ("mean.", self.mean)):
            network.load_state_dict({k.removeprefix(part): v for k, v in state.items() if k.startswith(part)})
        self.step, self.history, self.seconds = note["step"], note["history"], note["seconds"]
