"""Networks, each wrong in one way, with a card whose sha256 fits: `BROKEN[name]` is the code by which it is refused,
and what writes it into a folder. Where it is the card that is wrong, it is made of that of the shipped network."""

import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.inference.cards import path_of
from cavirheo.prior import FrameGrid, Prior, TrainingProblem

FRAMES, WIDTH = 20, 4
PRIOR = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}
SHIPPED = path_of("bdt-viscoelastic").with_suffix(".json")


def weights() -> dict[str, np.ndarray]:
    """Of a tiny network, in which every layer has WIDTH units."""
    rng = np.random.default_rng(0)
    square = ("query_key_value", 3 * WIDTH), ("attended", WIDTH), ("expand", WIDTH), ("contract", WIDTH)
    dense = {"dense": (WIDTH, 1 + WIDTH)}
    norms = ["norm"]
    for branch in ("branches.0", "branches.1"):
        dense |= {f"{branch}.dense": (WIDTH, WIDTH), f"{branch}.output": (1, WIDTH)}
        dense |= {f"{branch}.layers.0.{name}": (size, WIDTH) for name, size in square}
        norms += [f"{branch}.layers.0.norm_attention", f"{branch}.layers.0.norm_feed_forward"]
    made = {"position": rng.random((FRAMES, WIDTH)), "mean": np.array([4.5, -1.5]), "std": np.array([0.9, 0.9])}
    for name, shape in dense.items():
        made |= {f"{name}.weight": rng.standard_normal(shape), f"{name}.bias": np.zeros(shape[0])}
    for name in norms:
        made |= {f"{name}.weight": np.ones(WIDTH), f"{name}.bias": np.zeros(WIDTH)}
    return {name: np.asarray(array, np.float32) for name, array in made.items()}


def packed(arrays: Mapping[str, Any], **changed: Any) -> bytes:
    stream = BytesIO()
    np.savez(stream, **{**arrays, **changed})
    return stream.getvalue()


def zipped(content: bytes, kind: int = zipfile.ZIP_STORED) -> bytes:
    """A file with one part."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", kind) as file:
        file.writestr("mean.npy", content)
    return stream.getvalue()


def header(shape: tuple[int, ...]) -> bytes:
    """An array that says it has this shape, and has no numbers."""
    stream = BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def card(content: bytes) -> dict[str, Any]:
    problem = TrainingProblem("nhkv", Prior.uniform(PRIOR), grid=FrameGrid(frames=FRAMES))
    return json.loads(SHIPPED.read_text("utf-8")) | {
        "name": "model",
        "problem_id": problem.id,
        "problem": problem.to_dict(),
        "network": {"heads": 2, "layers": 1, "activation": "relu", "norm_epsilon": 1e-6},
        "weights": {"sha256": hashlib.sha256(content).hexdigest(), "largest_difference_from_torch": 0.0},
    }


def put(folder: Path, content: bytes, about: Any = None) -> Path:
    """The path of model.npz, with its card (text, bytes or an object; by default a right one)."""
    path = folder / "model.npz"
    path.write_bytes(content)
    about = card(content) if about is None else about
    if not isinstance(about, bytes):
        about = (about if isinstance(about, str) else json.dumps(about)).encode()
    path.with_suffix(".json").write_bytes(about)
    return path


SOUND = packed(weights())


def sound(folder: Path) -> Path:
    """What all others are made of; it is right."""
    return put(folder, SOUND)


def without(name: str) -> bytes:
    return packed({key: array for key, array in weights().items() if key != name})


MODELS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "empty": ("model.weights", lambda: b""),
    "cut short": ("model.weights", lambda: SOUND[:-300]),
    "with objects": ("model.weights", lambda: packed(weights(), mean=np.array([{}, {}], dtype=object))),
    "with nan": ("model.weights", lambda: packed(weights(), mean=np.float32([np.nan, 1.0]))),
    "with an array less": ("model.weights", lambda: without("branches.1.layers.0.expand.bias")),
    "of other frames": ("model.weights", lambda: packed(weights(), position=np.ones((21, 4), np.float32))),
    "that unpacks to a gigabyte": ("model.weights", lambda: zipped(bytes(10**9), zipfile.ZIP_DEFLATED)),
    "of a terabyte": ("model.weights", lambda: zipped(header((10**6, 10**6)))),
    "of negative sizes": ("model.weights", lambda: zipped(header((-1, 2)) + bytes(8))),
    "that answers beyond all numbers": ("model.not_finite", lambda: packed(weights(), mean=np.float32([1e30, 0.0]))),
}
MANY_FRAMES = {"camera": {"frame_interval": 1e-6, "frames": 10**9}}
LARGE = {"heads": 4096, "layers": 1, "activation": "relu", "norm_epsilon": 1e-6}
CARDS: dict[str, tuple[str, Callable[[dict[str, Any]], Any]]] = {  # a right file, and what becomes of its card
    "nested deeply": ("files.json", lambda _: b"[" * 200_000),
    "of another file": ("model.changed", lambda about: about | {"weights": about["weights"] | {"sha256": 64 * "0"}}),
    "of an output twice": ("model.card", lambda about: about | {"outputs": 2 * about["outputs"][1:]}),
    "of a later schema": ("model.card", lambda about: about | {"schema": 3}),
    "of many frames": ("model.card", lambda about: about | {"problem": about["problem"] | MANY_FRAMES}),
    "of other heads": ("model.weights", lambda about: about | {"network": LARGE | {"heads": 3}}),
    "of an unknown function": ("model.card", lambda about: about | {"network": LARGE | {"activation": "system"}}),
}
PATHS: dict[str, tuple[str, Callable[[Path], object]]] = {  # a right file with its card, and what becomes of it
    "without a card": ("model.missing", lambda path: path.with_suffix(".json").unlink()),
    "a pipe": ("model.missing", lambda path: (path.unlink(), os.mkfifo(path))),
    "of 6 GB": ("files.size", lambda path: os.truncate(path, 6 << 30)),
}
BROKEN: dict[str, tuple[str, Callable[[Path], Path]]] = {}
for name, (code, make) in MODELS.items():
    BROKEN[name] = code, lambda folder, make=make: put(folder, make())
for name, (code, change) in CARDS.items():
    BROKEN[f"card {name}"] = code, lambda folder, change=change: put(folder, SOUND, change(card(SOUND)))
for name, (code, change) in PATHS.items():
    BROKEN[name] = code, lambda folder, change=change: (path := sound(folder), change(path))[0]
