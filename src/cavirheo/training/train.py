"""Training and export: a recipe and a training set in, the weights of its network and one .onnx file with its card out.

Everything follows from (seed, step): a run that was cut off ends at the weights it would have had.

Files in the run's folder, each written whole or not at all:
    last.safetensors   weights and optimiser at the last validation, settings, history
    best.safetensors   weights that are exported: of the lowest validation loss, or of a posterior network the average
    history.jsonl      one line per validation: losses of the training and the validation part, seconds
    test.npz           curves, truth and predictions of the test part, which is looked at once, at the end
    result.json        what came out, and of what: becomes the card of the exported model

The .onnx file and its card are all that inference needs.
A network that gives one value maps R/R_max on the grid of its problem, (batch, frames) float32, to the prior's scale,
(batch, outputs) float32: log10 of SI values, the scaling of the targets included. A posterior network gives draws and
densities (`SequentialDraws`); its weights have half precision, and it computes at single. The card (JSON) says what the
model is and what it was made of (inference/model.py).
"""

from __future__ import annotations

import hashlib
import json
import logging
import platform
import re
import warnings
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxscript  # noqa: F401  torch exports with it: better missed now than after the training
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from cavirheo.errors import require
from cavirheo.inference.model import ModelCard, PosteriorCard, check_graph, predict
from cavirheo.inference.posterior_network import COORDINATES, INPUTS, SIZE
from cavirheo.parameters import LOG10, parameter_of
from cavirheo.physics.media import WATER
from cavirheo.problem import TrainingProblem
from cavirheo.training.dataset import load, load_curves
from cavirheo.training.loop import of_run, read_result, read_tensors, write_text
from cavirheo.training.point_network import BubbleTransformer, PointTraining, Standardised, scaling
from cavirheo.training.posterior_network import PosteriorNetwork, PosteriorTraining, SequentialDraws
from cavirheo.training.recipe import NetworkTable, PosteriorRecipe, Recipe, difference
from cavirheo.training.recordings import FASTEST, FEWEST, MOST, SLOWEST
from cavirheo.writing.document import into, whole

OPSET = 18
# Largest difference between the exported model and the trained one, in the prior's scale: rounding to single precision
# alone moves an answer by up to 1e-4 of a decade
TOLERANCE = 5e-4
_HALVED = 1000  # numbers in an array, from which it is stored at half precision


def train(
    recipe: Recipe | PosteriorRecipe,
    data_dir: str | Path,
    out_dir: str | Path,
    *,
    device: str | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train the recipe's network, or go on with the run in `out_dir`; the content of its result.json.

    `device` is torch's name ("cpu", "cuda"; default: cuda if there is one, and the processor for a posterior network).

    Raises:
        InputError: the data were made for another problem, or the folder holds another run.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    cards = torch.cuda.device_count()
    devices = ["cpu", *["cuda"][:cards], *(f"cuda:{k}" for k in range(cards))]
    message = f"there is no device {device!r} for torch {torch.__version__} here; there is {', '.join(devices)}"
    require(device is None or device in devices, message, "training.device")
    posterior = not isinstance(recipe, Recipe)
    message = f"a posterior network is trained on the processor: leave out --device {device}"
    require(not posterior or device in (None, "cpu"), message, "training.device")
    chosen = torch.device(device or ("cuda" if cards and not posterior else "cpu"))
    with into(out_dir) as folder, torch.random.fork_rng(devices=[chosen] if chosen.type == "cuda" else []):
        if isinstance(recipe, Recipe):
            return PointTraining(recipe, load(data_dir, folder), folder, chosen).run(progress)
        return PosteriorTraining(recipe, load_curves(recipe.problem, data_dir, folder), folder).run(progress)


def export(
    recipe: Recipe | PosteriorRecipe, run_dir: str | Path, out_dir: str | Path, *, on: date | None = None
) -> Path:
    """Write NAME.onnx and NAME.json for a finished run; the path of the former. `on` is the date on the card.

    Raises:
        InputError: the run is not finished, or is not of this recipe.
        RuntimeError: the exported model differs from the trained one by more than TOLERANCE.
    """
    run = Path(run_dir)
    result = read_result(run)
    changed = difference(result, recipe.settings())
    require(not changed, f"{run} was not trained with this recipe: {changed}", "export.another_recipe")
    parts: Any = (_export_posterior, _posterior_card, PosteriorCard)
    if isinstance(recipe, Recipe):
        parts = (_export_point, _point_card, ModelCard)
    write, describe, card = parts
    with into(out_dir) as folder:
        target = folder / f"{recipe.export.name}.onnx"
        with whole(target) as temporary:
            added = write(recipe, run, temporary)
        with of_run(run / "result.json"):
            packages = {package: version(package) for package in ("cavirheo", "numpy", "onnxruntime")}
            content = {
                "schema": 1,
                "name": target.stem,
                **describe(recipe, result),
                "onnx": {"sha256": hashlib.sha256(target.read_bytes()).hexdigest(), **added},
                "versions": {"python": platform.python_version(), "torch": result["torch"], **packages},
                "license": "MIT",
                "date": (on or datetime.now(UTC).date()).isoformat(),
            }
            card.model_validate(content)
        text = json.dumps(content, indent=2)
        # a list of numbers or words on one line
        text = re.sub(r"\[\s+([^][{}]+?)\s+\]", lambda match: f"[{' '.join(match[1].split())}]", text)
        write_text(target.with_suffix(".json"), text + "\n")
    return target


def _export_point(recipe: Recipe, run: Path, path: Path) -> dict[str, Any]:
    """Write the model; what the card says of the file, its largest difference from the trained network among it: in the
    prior's scale, on the curves of the test part, which are fed together and one alone."""
    with of_run(run / "best.safetensors"):
        model = load_model(run / "best.safetensors")
    with of_run(run / "test.npz"), np.load(run / "test.npz") as test:
        radius = test["radius"]
    write_onnx(model, recipe.problem.grid.frames, path)
    with torch.inference_mode():
        expected = model(torch.from_numpy(radius)).numpy()
    together, single = predict(path, radius), predict(path, radius[:1])
    deviation = float(max(np.abs(together - expected).max(), np.abs(single - expected[:1]).max()))
    if not deviation <= TOLERANCE:
        raise RuntimeError(f"exported and trained model differ by {deviation:.2g}, more than {TOLERANCE:g}")
    check_graph(path.read_bytes())  # else nobody could use it
    return {"opset": OPSET, "largest_difference_from_torch": deviation}


def _export_posterior(recipe: PosteriorRecipe, run: Path, path: Path) -> dict[str, Any]:
    """Write the model, with a free number of draws; it computes what was trained, but for its weights' precision."""
    with of_run(run / "best.safetensors"):
        network = PosteriorNetwork(len(recipe.problem.kinds), recipe.network)
        network.load_state_dict(read_tensors(run / "best.safetensors")[0])
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
    return {}


def load_model(checkpoint: Path) -> Standardised:
    """The network of a best.safetensors with its scaling, ready to answer."""
    weights, note = read_tensors(checkpoint)
    problem, outputs = TrainingProblem.from_dict(note["problem"]), tuple(note["outputs"])
    network = BubbleTransformer(NetworkTable(**note["network"]), problem.grid.frames, len(outputs))
    network.load_state_dict(weights)
    return Standardised(network, *scaling(problem.prior, outputs)).eval()


def write_onnx(model: Standardised, frames: int, path: Path) -> None:
    """A self-contained file with a free batch size."""
    free = {"radius": {0: torch.export.Dim("batch", min=1)}}
    onnx.save_model(_onnx(model, (torch.ones(2, frames),), ["radius"], ["theta"], free), path)


def _onnx(
    model: nn.Module, example: tuple[Any, ...], inputs: Sequence[str], outputs: Sequence[str], free: Any
) -> onnx.ModelProto:
    """A model without the exporter's notes of where our code lies."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else it tells of operators that we do not use
    names: dict[str, Any] = {"input_names": list(inputs), "output_names": list(outputs)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter, not ours to mend
        program = torch.onnx.export(
            model, example, dynamic_shapes=free, opset_version=OPSET, dynamo=True, verbose=False, **names
        )
    assert program is not None  # it is None only where a file is asked for
    content = program.model_proto
    for item in (*content.graph.node, *content.graph.value_info, *content.functions, content.graph, content):
        item.ClearField("doc_string")
        item.ClearField("metadata_props")
    return content


def _halve(graph: onnx.GraphProto) -> None:
    """Large arrays at half precision, cast back where they are used."""
    arrays, casts = [], []
    for array in graph.initializer:
        values = numpy_helper.to_array(array)
        if values.dtype == np.float32 and values.size >= _HALVED:
            arrays.append(numpy_helper.from_array(values.astype(np.float16), f"{array.name}_half"))
            casts.append(helper.make_node("Cast", [f"{array.name}_half"], [array.name], to=TensorProto.FLOAT))
        else:
            arrays.append(array)
    nodes = [*casts, *graph.node]
    del graph.initializer[:], graph.node[:]
    graph.initializer.extend(arrays)
    graph.node.extend(nodes)


def _point_card(recipe: Recipe, result: Mapping[str, Any]) -> dict[str, Any]:
    """What a network that gives one value is, and what it was made of."""
    problem = recipe.problem
    meaning = "R/R_max at R_max and at equal steps after it; the step is grid_step(R_max, medium)"
    training = {key: result[key] for key in ("best_epoch", "best_validation_loss", "seconds", "device")}
    scales = {output: "log10" if output.startswith(LOG10) else "linear" for output in recipe.outputs}
    return {
        "kind": "point",  # one value per output, no uncertainty
        "material": problem.material_name,
        "problem_id": problem.id,
        "problem": problem.to_dict(),
        "input": {"name": "radius", "shape": ["batch", problem.grid.frames], "dtype": "float32", "meaning": meaning},
        "outputs": [{"name": name, "unit": parameter_of(name).unit, "scale": scale} for name, scale in scales.items()],
        "network": result["network"] | {"parameters": result["parameters"]},
        "training": result["training"] | training,
        # of the figure of the losses; more digits than can be seen would be most of the card
        "history": {part: [float(f"{loss:.5g}") for loss in losses] for part, losses in result["history"].items()},
        "data": result["data"],
        "metrics": result["metrics"],  # of the test part
    }


def _posterior_card(recipe: PosteriorRecipe, result: Mapping[str, Any]) -> dict[str, Any]:
    """What a posterior network is, and what it was made of."""
    low, high = recipe.problem.max_radius_um
    ranges = {
        "max_radius_um": (1.2 * low, high / 1.08),
        "frame_interval_us": (FASTEST * 1e6, SLOWEST * 1e6),
        "frames": (0.75 * FEWEST, MOST),
        "noise_over_rmax": (0.0, 0.06),
        "density": (0.89 * WATER.density, 1.11 * WATER.density),
        "pressure": (0.89 * WATER.pressure, 1.11 * WATER.pressure),
    }
    training = {key: result[key] for key in ("samples", "curves", "held_out")} | {"seconds": round(result["seconds"])}
    return {
        "kind": "posterior",
        "kinds": [(law, bubble) for law, bubble, _ in recipe.problem.kinds],
        "trained": {name: [float(f"{end:.3g}") for end in ends] for name, ends in ranges.items()},
        "network": recipe.network.model_dump() | {"parameters": result["parameters"]},
        "training": recipe.training.model_dump() | training | {"loss": result["best_validation_loss"]},
        "loss_by_kind": result["loss_by_kind"],
        "coverage": result["coverage"],
    }
