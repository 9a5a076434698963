"""Export: a finished run becomes one .onnx file with its card beside it, which is all that inference needs.

The model maps R/R_max on the grid of its problem, (batch, frames) float32, to the prior's scale, (batch, outputs)
float32: log10 of SI values, the scaling of the targets included. The card (JSON) says what it is and what it was made
of; its keys are those of `card`.
"""

from __future__ import annotations

import hashlib
import json
import logging
import platform
import re
import warnings
from collections.abc import Mapping
from datetime import UTC, date, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxscript  # noqa: F401  torch exports with it: better missed now than after the training
import torch

from cavirheo.errors import require
from cavirheo.inference.card import ModelCard
from cavirheo.inference.graph import check_graph
from cavirheo.inference.model import predict
from cavirheo.parameters import LOG10, about
from cavirheo.problem import TrainingProblem
from cavirheo.training.dataset import difference
from cavirheo.training.network import BubbleTransformer, Standardised
from cavirheo.training.recipe import NetworkTable, Recipe
from cavirheo.training.train import of_run, read_result, read_tensors, scaling, write_text
from cavirheo.writing.document import into, whole

OPSET = 18
# Largest difference between the exported model and the trained one, in the prior's scale: rounding to single precision
# alone moves an answer by up to 1e-4 of a decade
TOLERANCE = 5e-4


def export(recipe: Recipe, run_dir: str | Path, out_dir: str | Path, *, on: date | None = None) -> Path:
    """Write NAME.onnx and NAME.json for a finished run; the path of the former. `on` is the date on the card.

    Raises:
        InputError: the run is not finished, or is not of this recipe.
        RuntimeError: the exported model differs from the trained one by more than TOLERANCE.
    """
    run = Path(run_dir)
    result = read_result(run)
    other = difference(result, recipe.settings())
    require(not other, f"{run} was not trained with this recipe: {other}", "export.another_recipe")
    with of_run(run / "best.safetensors"):
        model = load_model(run / "best.safetensors")
    with of_run(run / "test.npz"), np.load(run / "test.npz") as test:
        radius = test["radius"]
    with into(out_dir) as folder:
        target = folder / f"{recipe.export.name}.onnx"
        with whole(target) as temporary:
            write_onnx(model, recipe.problem.grid.frames, temporary)
            deviation = largest_difference(model, temporary, radius)
            if not deviation <= TOLERANCE:
                raise RuntimeError(f"exported and trained model differ by {deviation:.2g}, more than {TOLERANCE:g}")
            check_graph(temporary.read_bytes())  # else nobody could use it
        with of_run(run / "result.json"):
            about = card(target, recipe, result, deviation, on or datetime.now(UTC).date())
            ModelCard.model_validate(about)
        text = json.dumps(about, indent=2)
        # a list of numbers on one line
        text = re.sub(r"\[\s+([-+.\deE,\s]+?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", text)
        write_text(target.with_suffix(".json"), text + "\n")
    return target


def load_model(checkpoint: Path) -> Standardised:
    """The network of a best.safetensors with its scaling, ready to answer."""
    weights, note = read_tensors(checkpoint)
    problem, outputs = TrainingProblem.from_dict(note["problem"]), tuple(note["outputs"])
    network = BubbleTransformer(NetworkTable(**note["network"]), problem.grid.frames, len(outputs))
    network.load_state_dict(weights)
    return Standardised(network, *scaling(problem.prior, outputs)).eval()


def write_onnx(model: Standardised, frames: int, path: Path) -> None:
    """One self-contained file with a free batch size, and without the exporter's notes of where our code lies."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else it tells of operators that we do not use
    free = {"radius": {0: torch.export.Dim("batch", min=1)}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter, not ours to mend
        program = torch.onnx.export(
            model, (torch.ones(2, frames),), input_names=["radius"], output_names=["theta"],
            dynamic_shapes=free, opset_version=OPSET, dynamo=True, verbose=False,
        )  # fmt: skip
    assert program is not None  # it is None only where a file is asked for
    content = without_notes(program.model_proto)
    onnx.save_model(content, path)


def without_notes(content: onnx.ModelProto) -> onnx.ModelProto:
    """A model without the exporter's notes of where our code lies."""
    for item in (*content.graph.node, *content.graph.value_info, *content.functions, content.graph, content):
        item.ClearField("doc_string")
        item.ClearField("metadata_props")
    return content


@torch.inference_mode()
def largest_difference(model: Standardised, path: Path, radius: np.ndarray) -> float:
    """Largest difference over curves (curves, frames), fed together and one alone, in the prior's scale."""
    expected = model(torch.from_numpy(radius)).numpy()
    together, alone = predict(path, radius), predict(path, radius[:1])
    return float(max(np.abs(together - expected).max(), np.abs(alone - expected[:1]).max()))


def card(path: Path, recipe: Recipe, result: Mapping[str, Any], deviation: float, on: date) -> dict[str, Any]:
    """What an exported model is, and what it was made of."""
    problem, sha256 = recipe.problem, hashlib.sha256(path.read_bytes()).hexdigest()
    meaning = "R/R_max at R_max and at equal steps after it; the step is grid_step(R_max, medium)"
    how = {key: result[key] for key in ("best_epoch", "best_validation_loss", "seconds", "device")}
    packages = {package: version(package) for package in ("cavirheo", "numpy", "onnxruntime")}
    scales = {output: "log10" if output.startswith(LOG10) else "linear" for output in recipe.outputs}
    return {
        "schema": 1,
        "name": path.stem,
        "kind": "point",  # one value per output, no uncertainty
        "material": problem.material_name,
        "problem_id": problem.id,
        "problem": problem.to_dict(),
        "input": {"name": "radius", "shape": ["batch", problem.grid.frames], "dtype": "float32", "meaning": meaning},
        "outputs": [{"name": name, "unit": about(name).unit, "scale": scale} for name, scale in scales.items()],
        "network": result["network"] | {"parameters": result["parameters"]},
        "training": result["training"] | how,
        # of the figure of the losses; more digits than can be seen would be most of the card
        "history": {part: [float(f"{loss:.5g}") for loss in losses] for part, losses in result["history"].items()},
        "data": result["data"],
        "metrics": result["metrics"],  # of the test part
        "onnx": {"sha256": sha256, "opset": OPSET, "largest_difference_from_torch": deviation},
        "versions": {"python": platform.python_version(), "torch": result["torch"]} | packages,
        "license": "MIT",
        "date": on.isoformat(),
    }
