"""Networks, each wrong in one way, with a card whose sha256 fits: `BROKEN[name]` is the code by which it is refused,
and what writes it into a folder. All are made of a shipped network and its card."""

import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

import cavirheo

SHIPPED = Path(cavirheo.__file__).parent / "models" / "bdt-viscoelastic.npz"
FRAMES = 100


def weights() -> dict[str, np.ndarray]:
    with np.load(SHIPPED) as file:
        return dict(file)


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
    about = json.loads(SHIPPED.with_suffix(".json").read_text("utf-8")) | {"name": "model"}
    return about | {"weights": about["weights"] | {"sha256": hashlib.sha256(content).hexdigest()}}


def put(folder: Path, content: bytes, about: Any = None) -> Path:
    """The path of model.npz, with its card (text, bytes or an object; by default a right one)."""
    path = folder / "model.npz"
    path.write_bytes(content)
    about = card(content) if about is None else about
    if not isinstance(about, bytes):
        about = (about if isinstance(about, str) else json.dumps(about)).encode()
    path.with_suffix(".json").write_bytes(about)
    return path


SOUND = SHIPPED.read_bytes()


def sound(folder: Path) -> Path:
    """What all others are made of; it is right."""
    return put(folder, SOUND)


MODELS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "empty": ("model.weights", lambda: b""),
    "cut short": ("model.weights", lambda: SOUND[:-300]),
    "with objects": ("model.weights", lambda: packed(weights(), mean=np.array([{}, {}], dtype=object))),
    "with nan": ("model.weights", lambda: packed(weights(), mean=np.float32([np.nan, 1.0]))),
    "with a single array": ("model.weights", lambda: packed({"mean": weights()["mean"]})),
    "of other frames": ("model.weights", lambda: packed(weights(), position=np.ones((FRAMES + 1, 64), np.float32))),
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
    "of 6 GB": ("limits.bytes", lambda path: os.truncate(path, 6 << 30)),
}
BROKEN: dict[str, tuple[str, Callable[[Path], Path]]] = {}
for name, (code, make) in MODELS.items():
    BROKEN[name] = code, lambda folder, make=make: put(folder, make())
for name, (code, change) in CARDS.items():
    BROKEN[f"card {name}"] = code, lambda folder, change=change: put(folder, SOUND, change(card(SOUND)))
for name, (code, change) in PATHS.items():
    BROKEN[name] = code, lambda folder, change=change: (path := sound(folder), change(path))[0]
