"""The two kinds of networks, as torch trains them: their layers, what they learn (data on the device, loss,
validation), and what their cards say of them. Inference computes them in numpy from files of weights alone.

The Bubble Dynamics Transformer (Bu et al. 2025, arXiv:2506.11936) gives one value per output. The paper's feed-forward
layers have softplus, too; those of the shipped networks have ReLU (`activation` of a recipe). The paper leaves some
choices open. Those of this module: eight numbers per attention head (64 = 8 x 8), dropout on both residual paths but
not on the attention weights, and Keras' initial weights (Glorot uniform, zero biases, embeddings uniform within 0.05).
Outputs are in the prior's scale: SI values or their log10. In numpy: inference/bdt.py.

The emulator gives the trajectory of a bubble. In numpy: inference/emulator.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.inference.bdt import Forward
from cavirheo.inference.emulator import FARTHEST, INPUTS, NODES, Emulator, seen
from cavirheo.inference.network_files import Arrays, Layers
from cavirheo.parameters import LOG10, parameter_of
from cavirheo.training.dataset import Dataset
from cavirheo.training.recipe import EmulatorNetworkTable, EmulatorRecipe, NetworkTable, PointRecipe, Recipe
from cavirheo.training.trajectories import compared_end

EVALUATION_BATCH = 512
HELD_OUT = 0.03  # part of the trajectories of an emulator that is held out: one half for validation, one for the test
LEAST_HELD_OUT, MOST_HELD_OUT = 20, 8000
MOST_FITTED = 12_000  # trajectories that give the principal components
FIRST_FLOOR, LAST_FLOOR = -5.5, -7.5  # log10 of the floor of squared errors, which falls
FALLING = 0.7  # share of the steps in which it does
LATE_WEIGHT = 0.05  # of squared errors after the rebound of the third collapse
FAST = 3.0  # velocity, in R_max/T, from which errors count less
SLOW = 0.03  # least velocity by which an error of the time counts
FRAMES = 100  # of a bubble, of which the errors on the card are


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
    """The network of a recipe, first with random weights. It maps R/R_max (batch, tokens) to standardised targets
    (batch, outputs); `mean` and `std` (outputs,) of the prior, which are not trained, scale these."""

    mean: Tensor
    std: Tensor

    def __init__(self, recipe: PointRecipe) -> None:
        super().__init__()
        size, prior = recipe.network, recipe.problem.prior.marginal(recipe.outputs)
        self.position = nn.Parameter(torch.empty(recipe.problem.frames, size.position))
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


class PointTask:
    """A network that gives one value for each parameter, and the curves that it learns: by the mean squared error of
    standardised values."""

    average = None  # network of averaged weights, if there is one

    def __init__(self, recipe: PointRecipe, data: Dataset, device: torch.device) -> None:
        training = recipe.training
        self.recipe, self.data, self.device = recipe, data, device
        self.network = network = BubbleTransformer(recipe).to(device)
        self.exported = network  # the one that is validated and exported
        self.trained = nn.ModuleDict({"network": network})  # what a checkpoint holds
        self.optimisers: list[torch.optim.Optimizer] = [torch.optim.Adam(network.parameters(), lr=training.lr)]
        self.dropout_epochs = training.dropout_epochs or training.epochs
        # R/R_max (curves, frames) and standardised values (curves, outputs) of "train", "validation", "test"
        self.parts: dict[str, tuple[Tensor, Tensor]] = {}
        for name, curves in data.split(training.seed).items():
            if len(curves) < 2:
                raise InputError(f"too few usable curves in the {name} part of {len(data)}", "training.few")
            truth = torch.tensor(data.truth(recipe.outputs)[curves]).float().to(device)
            radius = torch.from_numpy(data.columns["radius"][curves]).to(device)
            self.parts[name] = radius, (truth - network.mean) / network.std
        self.count = len(self.parts["train"][0])  # of training curves
        self.test_inputs = self.parts["test"][0].cpu().numpy()

    def loss(self, rows: Tensor, step: int, steps: int) -> tuple[Tensor, Tensor]:
        """Loss at a step (from 0) of `steps`, of these curves of the training part, and the loss that is reported."""
        radius, target = self.parts["train"]
        at = rows.to(self.device)
        loss = functional.mse_loss(self.network(radius[at]), target[at])
        return loss, loss

    @torch.inference_mode()
    def validation_loss(self) -> float:
        """Loss of the exported network on the validation part."""
        radius, target = self.parts["validation"]
        self.network.eval()
        predicted = torch.cat([self.network(batch) for batch in radius.split(EVALUATION_BATCH)])
        return float(functional.mse_loss(predicted, target))

    def computed(self, arrays: Arrays, inputs: NDArray[np.float32]) -> Floats:
        """What numpy computes from the arrays of a file of weights."""
        layers = Layers.model_validate(self.recipe.network.model_dump())
        return Forward(layers, len(self.recipe.outputs), arrays)(inputs.astype(float))

    def entries(self, predicted: Floats) -> dict[str, Any]:
        """Entries of the card, with the errors of what the exported file gives for the test part."""
        problem, outputs = self.recipe.problem, self.recipe.outputs
        truth = self.data.truth(outputs)[self.data.split(self.recipe.training.seed)["test"]]
        meaning = "R/R_max at R_max and at equal steps after it; the step is grid_step(R_max, medium)"
        scales = {output: "log10" if output.startswith(LOG10) else "linear" for output in outputs}
        return {
            "kind": "point",  # one value per output, no uncertainty
            "material": problem.material_name,
            "problem_id": problem.id,
            "problem": problem.to_dict(),
            "input": {"name": "radius", "shape": ["batch", problem.frames], "meaning": meaning},
            "outputs": [{"name": name, "unit": parameter_of(name).unit, "scale": scales[name]} for name in outputs],
            "data": self.data.origin | {part: len(radius) for part, (radius, _) in self.parts.items()},
            "metrics": metrics(outputs, truth, predicted),
        }


class EmulatorTask:
    """An emulator, and the trajectories that it learns, as `PointTask`; the weights are averaged over the steps.

    Matrices learn by Muon (Jordan et al. 2024), other weights by Adam: with as many minutes of one core, frames are 2.5
    times as exact as by Adam alone.

    The loss of a trajectory is the logarithm of its mean squared error above a floor, which falls: bubbles that are
    hard do not decide alone. The error of a node is that of R at its time t, so what is wrong in t counts by the
    velocity, or by SLOW where that is slower, so that slow bubbles do not end early; it counts less where the wall is
    fast, and after the rebound of the third collapse.
    """

    dropout_epochs = 0

    def __init__(self, recipe: EmulatorRecipe, data: Dataset, device: torch.device) -> None:
        if data.made_by != version("cavirheo"):  # it may tell other inputs
            message = f"the training set was made by cavirheo {data.made_by}: generate it with this version"
            raise InputError(message, "training.another_version")
        self.data, self.device, self.warm_up = data, device, recipe.training.warmup_steps
        columns = {name: values[data.ok] for name, values in data.columns.items() if name != "status"}
        self.inputs, self.radius = columns["inputs"], columns["radius"]
        self.trajectories = np.hstack([self.radius, columns["time"]])
        n, components = len(self.inputs), recipe.network.components
        held_out = min(max(round(HELD_OUT * n), LEAST_HELD_OUT), MOST_HELD_OUT)
        if n < held_out + components:
            message = f"{components} components need {LEAST_HELD_OUT} trajectories more; the data have {n}"
            raise InputError(message, "training.few")
        self.count = n - held_out  # those held out are the last; each has a law and a medium of its own
        self.validation, self.test = torch.arange(self.count, n).chunk(2)
        network = EmulatorNetwork(recipe.network)
        first = slice(0, min(self.count, MOST_FITTED))
        network.fit(self.inputs[: self.count].astype(float), self.trajectories[first].astype(float))
        self.network = network.to(device)
        self.average = self.exported = deepcopy(self.network).requires_grad_(False)
        self.trained = nn.ModuleDict({"network": self.network, "average": self.average})
        lr, matrices = recipe.training.lr, [weight for weight in self.network.parameters() if weight.ndim == 2]
        muon = torch.optim.Muon(matrices, lr, weight_decay=0.0, adjust_lr_fn="match_rms_adamw")
        vectors = [weight for weight in self.network.parameters() if weight.ndim == 1]
        self.optimisers: list[torch.optim.Optimizer] = [muon, torch.optim.Adam(vectors, lr)]
        self.test_inputs = self.inputs[self.test]

    def loss(self, rows: Tensor, step: int, steps: int) -> tuple[Tensor, Tensor]:
        inputs, truth, weight = self._batch(rows)
        predicted = self.network(inputs)
        squared = squared_errors(predicted, truth, weight)
        reported = torch.median(torch.sqrt(squared))
        if step < self.warm_up:
            return squared.mean() + functional.mse_loss(predicted, truth), reported
        floor = 10.0 ** (FIRST_FLOOR + (LAST_FLOOR - FIRST_FLOOR) * min(1.0, step / (FALLING * steps)))
        return torch.log(squared + floor).mean(), reported

    def _batch(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Inputs (k, INPUTS), R/R_max and t/T (k, 2 NODES), and weights (k, NODES) of bubbles."""
        counts = np.arange(NODES) <= compared_end(self.radius[rows])[:, None]
        weight = np.where(counts, 1.0, LATE_WEIGHT).astype(np.float32)
        arrays = self.inputs[rows], self.trajectories[rows], weight
        inputs, truth, weights = (torch.from_numpy(array).to(self.device) for array in arrays)
        return inputs, truth, weights

    @torch.inference_mode()
    def validation_loss(self) -> float:
        """The median error."""
        inputs, truth, weight = self._batch(self.validation)
        return float(torch.median(torch.sqrt(squared_errors(self.exported(inputs), truth, weight))))

    def computed(self, arrays: Arrays, inputs: NDArray[np.float32]) -> Floats:
        return np.asarray(Emulator(arrays).trajectories(inputs.astype(float)))

    def entries(self, predicted: Floats) -> dict[str, Any]:
        """The errors are of frames at equal times."""
        errors = frame_errors(self.trajectories[self.test], predicted)
        levels = {"median": 0.5, "p90": 0.9, "p95": 0.95, "p99": 0.99}
        return {
            "kind": "emulator",
            "domain": self.data.problem,
            "data": self.data.origin | {"train": self.count, "test": len(self.test)},
            "errors": {name: float(f"{np.quantile(errors, level):.3g}") for name, level in levels.items()},
        }


Task = PointTask | EmulatorTask


def task_of(recipe: Recipe, data: Dataset, device: torch.device) -> Task:
    """The task of a recipe. Raises InputError: the set is of another problem, or has too few curves."""
    made_for, wanted = (getattr(problem, "id", "the emulator") for problem in (data.problem, recipe.problem))
    if made_for != wanted:
        message = f"the training set was made for {made_for}, the recipe is of {wanted}: generate it with this recipe"
        raise InputError(message, "training.another_problem")
    return EmulatorTask(recipe, data, device) if isinstance(recipe, EmulatorRecipe) else PointTask(recipe, data, device)


def metrics(names: Sequence[str], truth: Floats, predicted: Floats) -> dict[str, dict[str, float]]:
    """Accuracy of each output from truth and prediction (curves, outputs), in the prior's scale (decades for log10
    names): R², and the median of the absolute errors."""
    found = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        r2 = 1.0 - np.sum((p - t) ** 2) / np.sum((t - t.mean()) ** 2)
        found[name] = {"r2": float(r2), "median_absolute_error": float(np.median(np.abs(p - t)))}
    return found


def squared_errors(predicted: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """(k,) mean squared error of R/R_max along trajectories (k, 2 NODES), with weights (k, NODES)."""
    radius, time = truth.chunk(2, dim=1)
    off_radius, off_time = (predicted - truth).chunk(2, dim=1)
    velocity = torch.gradient(radius, dim=1)[0] / torch.gradient(time, dim=1)[0].clamp(min=1e-6)
    off = (off_radius - velocity * off_time) ** 2 / (1.0 + (velocity / FAST) ** 2) + (SLOW * off_time) ** 2
    return (off * weight).mean(dim=1)


def frame_errors(truth: NDArray[Any], emulated: NDArray[Any]) -> Floats:
    """(k,) RMS error over R_max of FRAMES at equal times, up to the rebound that follows the third collapse."""
    radius, time = np.hsplit(truth, 2)
    end = np.take_along_axis(time, compared_end(radius)[:, None], axis=1)
    expected, found = np.empty((2, len(truth), FRAMES))
    instants, nothing = np.linspace(0.0, 1.0, FRAMES), np.zeros(len(truth))
    for curves, frames in ((truth, expected), (emulated, found)):
        seen(curves, 1.0 / end[:, 0].astype(float), instants, np.zeros(1), np.ones(1), nothing, frames)
    return np.asarray(np.sqrt(np.mean((found - expected) ** 2, axis=1)))
