"""Export of a posterior network: one .onnx file, weights at half precision, computed at single."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import warnings
from datetime import UTC, date, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from cavirheo.inference.bins import SIZE
from cavirheo.inference.card import PosteriorCard
from cavirheo.inference.flow import INPUTS
from cavirheo.inference.graph import check_graph
from cavirheo.inference.latent import SLOTS, used
from cavirheo.physics.media import WATER
from cavirheo.training.export import OPSET, without_notes
from cavirheo.training.posterior.camera import FASTEST, FEWEST, MOST, SLOWEST, Filmed
from cavirheo.training.posterior.network import LOG_2PI, PosteriorNetwork
from cavirheo.training.posterior.recipe import PosteriorRecipe
from cavirheo.training.posterior.store import load
from cavirheo.training.posterior.train import PosteriorTraining
from cavirheo.training.train import write_text
from cavirheo.writing.document import into, whole

_HALVED = 1000  # numbers in an array, from which it is kept at half precision


class Answering(nn.Module):
    """Draws of one recording, or given ones, and their density.

    cells: (1, SIZE). kind: (1, kinds), zeros and a one. has: (9,) 1 for the slots of that kind, else 0. counted: (9,) 1
    for the slots whose density is asked for. choice: (draws, 9, parts) from Gumbel's distribution and normal: (draws,
    9) from the standard normal one, of which draws are made. given: (draws, 9), taken instead where `take` (9,) is 1.
    Returns z (draws, 9), log density of the counted slots given those before them (draws,), and log odds of the kinds
    (1, kinds).
    """

    def __init__(self, network: PosteriorNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(
        self, cells: Tensor, kind: Tensor, has: Tensor, counted: Tensor, choice: Tensor, normal: Tensor, given: Tensor,
        take: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        net = self.network
        read, guess = net.encode(cells)
        read = read + torch.einsum("bk,kdh->bdh", kind, net.kind)
        found: list[Tensor] = []
        log_density = torch.zeros_like(normal[:, 0])
        for k in range(len(SLOTS)):
            share, mean, width = net.slot(k, read[:, k].expand(normal.shape[0], -1), found)
            part = torch.argmax(share + choice[:, k], dim=1, keepdim=True)
            at = torch.gather(mean, 1, part)[:, 0], torch.gather(width, 1, part)[:, 0]
            z = take[k] * given[:, k] + (1.0 - take[k]) * (at[0] + torch.exp(at[1]) * normal[:, k])
            terms = share - width - 0.5 * (((z[:, None] - mean) * torch.exp(-width)) ** 2 + LOG_2PI)
            log_density = log_density + counted[k] * torch.logsumexp(terms, dim=1)
            found.append(has[k] * z)
        return torch.stack(found, dim=1), log_density, torch.log_softmax(guess, dim=-1)


def made(
    recipe: PosteriorRecipe, data_dir: str | Path, out_dir: str | Path, *, threads: int | None = None,
    progress: bool = True,
) -> tuple[Path, float]:  # fmt: skip
    """Train the recipe's network in `out_dir`, or go on there, and export it; the .onnx file and the last loss.

    Raises:
        InputError: the curves are of another recipe or incomplete, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    with into(out_dir) as folder:
        training = PosteriorTraining(recipe, load(recipe, data_dir, folder), folder)
        training.fit(progress=progress)
        return export(training, recipe, folder), float(training.history[-1]["validation"])


def export(
    training: PosteriorTraining, recipe: PosteriorRecipe, out_dir: str | Path, *, on: date | None = None
) -> Path:
    """Write NAME.onnx and NAME.json of a training's averaged weights; the path of the former."""
    network, check = training.mean.eval(), training.check
    with into(out_dir) as folder:
        target = folder / f"{recipe.export.name}.onnx"
        with whole(target) as temporary:
            write_onnx(network, temporary)
            check_graph(temporary.read_bytes(), INPUTS)
        line, (low, high) = training.history[-1], recipe.posterior.max_radius_um
        medium = {"density": WATER.density, "pressure": WATER.pressure}
        about = {
            "schema": 1, "name": recipe.export.name, "kind": "posterior", "kinds": training.kinds,
            "trained": {
                "max_radius_um": (1.2 * low, high / 1.08), "frame_interval_us": (FASTEST * 1e6, SLOWEST * 1e6),
                "frames": (0.75 * FEWEST, MOST), "noise_over_rmax": (0.0, 0.06),
                **{name: (0.89 * value, 1.11 * value) for name, value in medium.items()},
            },
            "network": recipe.network.model_dump() | {"parameters": sum(p.numel() for p in network.parameters())},
            "training": recipe.training.model_dump() | {
                "samples": line["samples"], "seconds": round(line["seconds"]), "loss": line["validation"],
                "curves": len(training.train), "held_out": len(training.held),
            },
            "loss_by_kind": line["kinds"],
            "coverage": coverage(network, training.kinds, check),
            "onnx": {"sha256": hashlib.sha256(target.read_bytes()).hexdigest()},
            "made_with": {package: version(package) for package in ("cavirheo", "numpy", "torch")},
            "license": "MIT", "date": (on or datetime.now(UTC).date()).isoformat(),
        }  # fmt: skip
        about["trained"] = {name: [float(f"{end:.3g}") for end in ends] for name, ends in about["trained"].items()}
        PosteriorCard.model_validate(about)
        text = re.sub(
            r"\[\s+([^][{}]+?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", json.dumps(about, indent=2)
        )
        write_text(target.with_suffix(".json"), text + "\n")
    return target


@torch.inference_mode()
def coverage(
    network: PosteriorNetwork, kinds: list[tuple[str, str]], check: Filmed, draws: int = 300
) -> dict[str, Any]:
    """Shares of recordings whose truth is in the central 50 and 90 % of the network's draws, by slot; those of curves
    that were never shown."""
    rng, answering = torch.Generator().manual_seed(0), Answering(network)
    inside: dict[str, list[float]] = {name: [] for name in SLOTS}
    for i, kind in enumerate(check.kind.tolist()):
        has = torch.zeros(len(SLOTS))
        has[used(*kinds[kind])] = 1.0
        uniform = torch.rand((draws, len(SLOTS), network.parts), generator=rng).clamp(1e-9)
        normal, cells = torch.randn((draws, len(SLOTS)), generator=rng), torch.from_numpy(check.inputs[i : i + 1])
        one = torch.eye(len(kinds))[kind : kind + 1]
        z, _, _ = answering(
            cells, one, has, has, -torch.log(-torch.log(uniform)), normal, normal, torch.zeros(len(SLOTS))
        )
        below = (z < torch.from_numpy(check.z[i])).float().mean(dim=0)
        for k in used(*kinds[kind]):
            inside[SLOTS[k]].append(float(below[k]))
    shares = {name: np.abs(2.0 * np.array(values) - 1.0) for name, values in inside.items() if values}
    found = {
        name: {str(level): round(float(np.mean(off < level / 100)), 4) for level in (50, 90)}
        for name, off in shares.items()
    }
    return {"recordings": len(check.kind), "by_slot": found}


def write_onnx(network: PosteriorNetwork, path: Path) -> None:
    """One self-contained file with a free number of draws."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    kinds = len(network.kind)
    d = len(SLOTS)
    random = torch.zeros(5, d, network.parts), torch.zeros(5, d), torch.zeros(5, d), torch.zeros(d)
    example = torch.zeros(1, SIZE), torch.zeros(1, kinds), torch.ones(d), torch.ones(d), *random
    draws = torch.export.Dim("draws", min=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            Answering(network.eval()), example,
            input_names=list(INPUTS),
            output_names=["z", "log_density", "guess"], opset_version=OPSET, dynamo=True, verbose=False,
            dynamic_shapes=(None, None, None, None, {0: draws}, {0: draws}, {0: draws}, None),
        )  # fmt: skip
    assert program is not None
    content = without_notes(program.model_proto)
    _halve(content.graph)
    onnx.checker.check_model(content)
    onnx.save_model(content, path)


def _halve(graph: onnx.GraphProto) -> None:
    """Large arrays at half precision, cast back where they are used."""
    kept, casts = [], []
    for array in graph.initializer:
        values = numpy_helper.to_array(array)
        if values.dtype == np.float32 and values.size >= _HALVED:
            name = array.name
            kept.append(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
            casts.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
        else:
            kept.append(array)
    nodes = [*casts, *graph.node]
    del graph.initializer[:], graph.node[:]
    graph.initializer.extend(kept)
    graph.node.extend(nodes)
