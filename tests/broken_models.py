"""Models of strangers, each wrong in one way, with a card whose sha256 fits: `BROKEN[name]` is the code by which it is
refused, and what writes it into a folder.

Where it is the file that is wrong, it is made of `graph`; where it is the card, of that of the shipped network.
"""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from cavirheo.inference import model
from cavirheo.prior import FrameGrid, Prior, TrainingProblem

FRAMES = 20
PRIOR = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}
SHIPPED = model.path_of("bdt-viscoelastic").with_suffix(".json")
FLOAT, TEXT = TensorProto.FLOAT, TensorProto.STRING


def numbers(name: str, values: Any, kind: Any = np.float32) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(values, dtype=kind), name)


def node(kind: str, inputs: str, outputs: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(kind, inputs.split(), outputs.split(), **attributes)


def shown(name: str, kind: int, *shape: Any) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, ["batch", *shape])


def graph(nodes: Any = (), tensors: Any = (), *, last="linear", opset=18, **given: Any) -> onnx.ModelProto:
    """theta = radius @ weight + bias, which is `linear`; then `nodes`, the result of which is named by `last`."""
    weight, bias = numbers("weight", 0.1 * np.ones((FRAMES, 2))), numbers("bias", [3.5, -2.5])
    linear = [node("MatMul", "radius weight", "product"), node("Add", "product bias", "linear")]
    inputs = given.pop("inputs", [shown("radius", FLOAT, FRAMES)])
    outputs = given.pop("outputs", [shown("theta", FLOAT, 2)])
    ordered = [*linear, *nodes, node("Identity", last, "theta")]
    made = helper.make_graph(ordered, "g", inputs, outputs, [weight, bias, *tensors])
    return helper.make_model(made, **{"opset_imports": [helper.make_opsetid("", opset)], "ir_version": 10, **given})


def then(kind: str, inputs: str = "linear", tensors: Any = (), given: Any = None, **attributes: Any) -> onnx.ModelProto:
    """A graph that ends with this operator."""
    return graph([node(kind, inputs, "out", **attributes)], tensors, last="out", **(given or {}))


def card(content: bytes) -> dict[str, Any]:
    problem = TrainingProblem("nhkv", Prior.uniform(PRIOR), grid=FrameGrid(frames=FRAMES))
    return json.loads(SHIPPED.read_text("utf-8")) | {
        "name": "model",
        "problem_id": problem.id,
        "problem": problem.to_dict(),
        "input": {"name": "radius", "shape": ["batch", FRAMES], "dtype": "float32"},
        "onnx": {"sha256": hashlib.sha256(content).hexdigest()},
    }


def put(folder: Path, model: onnx.ModelProto | bytes, about: Any = None) -> Path:
    """The path of model.onnx, with its card (text, bytes or an object; by default a right one)."""
    content = model if isinstance(model, bytes) else model.SerializeToString()
    path = folder / "model.onnx"
    path.write_bytes(content)
    about = card(content) if about is None else about
    if not isinstance(about, bytes):
        about = (about if isinstance(about, str) else json.dumps(about)).encode()
    path.with_suffix(".json").write_bytes(about)
    return path


def sound(folder: Path) -> Path:
    """What all others are made of; it is right."""
    return put(folder, graph())


def with_a_function() -> onnx.ModelProto:
    opsets = [helper.make_opsetid("", 18), helper.make_opsetid("own", 1)]
    own = helper.make_function("own", "Twice", ["x"], ["y"], [node("Add", "x x", "y")], opsets[:1])
    return then("Twice", domain="own", given={"opset_imports": opsets, "functions": [own]})


def elsewhere(name: str, location: str) -> onnx.TensorProto:
    """Its numbers lie in another file."""
    tensor = onnx.TensorProto(name=name, data_type=FLOAT, dims=(2,), data_location=TensorProto.EXTERNAL)
    tensor.external_data.add(key="location", value=location)
    return tensor


def with_external_data_in_a_constant() -> onnx.ModelProto:
    made = node("Constant", "", "zero", value=elsewhere("value", "/dev/zero"))
    return graph([made, node("Add", "linear zero", "out")], last="out")


def expanded_to_a_terabyte() -> onnx.ModelProto:
    nodes = [node("Expand", "bias huge", "grown"), node("ReduceMax", "grown", "top", keepdims=0)]
    return graph([*nodes, node("Add", "linear top", "out")], [numbers("huge", [1 << 37, 2], np.int64)], last="out")


def shaped_by_values() -> onnx.ModelProto:
    """A shape that is read off the curve: small on one, enormous on the next."""
    nodes = [
        node("ReduceMax", "radius", "most", keepdims=0),
        node("Cast", "most", "count", to=TensorProto.INT64),
        node("Unsqueeze", "count zero", "shape"),
        node("ConstantOfShape", "shape", "grown"),
        node("ReduceSum", "grown", "total", keepdims=0),
        node("Add", "linear total", "out"),
    ]
    return graph(nodes, [numbers("zero", [0], np.int64)], last="out")


def slow() -> onnx.ModelProto:
    """Ten thousand products of 1000 x 1000, nothing of which is known before it runs."""
    nodes = [node("ReduceSum", "radius", "begin", keepdims=0), node("Expand", "one shape", "a")]
    nodes += [node("Mul", "a begin", "a0")] + [node("MatMul", f"a{k} a", f"a{k + 1}") for k in range(10_000)]
    nodes += [node("ReduceSum", "a10000", "total", keepdims=0), node("Add", "linear total", "out")]
    return graph(nodes, [numbers("shape", [1000, 1000], np.int64), numbers("one", [[1.0]])], last="out")


def of_nan_for_some_curves() -> onnx.ModelProto:
    nodes = [node("ReduceMin", "radius", "least", keepdims=0), node("Sub", "least most", "gap")]
    nodes += [node("Log", "gap", "bad"), node("Add", "linear bad", "out")]
    return graph(nodes, [numbers("most", 0.95)], last="out")


def with_a_tensor(dims: tuple[int, ...], raw: bytes) -> Callable[[], onnx.ModelProto]:
    tensor = onnx.TensorProto(name="odd", data_type=FLOAT, dims=dims, raw_data=raw)
    return lambda: then("Add", "linear odd", [tensor])


ANOTHER = [shown("radius", FLOAT, FRAMES), shown("more", FLOAT, 2)]
MODELS: dict[str, tuple[str, Callable[[], onnx.ModelProto | bytes]]] = {
    "empty": ("graph.damaged", lambda: b""),
    "with a length beyond the end": ("graph.damaged", lambda: graph().SerializeToString() + b"\x3a" + b"\xff" * 8),
    "with a graph within": ("graph.operator", lambda: then("Add", "linear linear", body=graph().graph)),
    "with an operator of its own": ("graph.operator", lambda: then("Pwn", domain="com.evil")),
    "with random numbers": ("graph.operator", lambda: then("RandomNormalLike")),
    "with a function": ("graph.functions", with_a_function),
    "with external data": ("graph.elsewhere", lambda: then("Add", "linear odd", [elsewhere("odd", "../../x/passwd")])),
    "with external data in a constant": ("graph.elsewhere", with_external_data_in_a_constant),
    "shaped by values": ("graph.shape", shaped_by_values),
    "expanded to a terabyte": ("model.memory", expanded_to_a_terabyte),
    "with two inputs": ("graph.order", lambda: then("Add", "linear more", given={"inputs": ANOTHER})),
    "with a ring": ("graph.order", lambda: graph([node("Add", "linear b", "a"), node("Identity", "a", "b")], last="b")),
    "of opset 999": ("model.fails", lambda: graph(opset=999)),
    "with sizes that overflow": ("model.fails", with_a_tensor((1 << 32, 1 << 32), b"")),
    "with a tensor cut short": ("model.fails", with_a_tensor((2,), bytes(4))),
    "of other frames": ("model.fails", lambda: graph(inputs=[shown("radius", FLOAT, FRAMES + 1)])),
    "of four outputs that claims two": ("model.fails", lambda: then("Concat", "linear linear", axis=1)),
    "of text answers": ("model.fails", lambda: then("Cast", to=TEXT, given={"outputs": [shown("theta", TEXT, 2)]})),
    "of nan for some curves": ("model.fails", of_nan_for_some_curves),
}
MANY_FRAMES = {"camera": {"frame_interval": 1e-6, "frames": 10**9}}
CARDS: dict[str, tuple[str, Callable[[dict[str, Any]], Any]]] = {  # a right file, and what becomes of its card
    "nested deeply": ("files.json", lambda _: b"[" * 200_000),
    "of 20 MB": ("files.size", lambda about: json.dumps(about) + " " * 20_000_000),
    "of another file": ("model.changed", lambda about: about | {"onnx": {"sha256": 64 * "0"}}),
    "of an output twice": ("model.card", lambda about: about | {"outputs": 2 * about["outputs"][1:]}),
    "of a later schema": ("model.card", lambda about: about | {"schema": 2}),
    "of the problem a list": ("model.card", lambda about: about | {"problem": []}),
    "of an unknown law": ("model.card", lambda about: about | {"problem": about["problem"] | {"material": "honey"}}),
    "of many frames": ("model.card", lambda about: about | {"problem": about["problem"] | MANY_FRAMES}),
    "of a name a path": ("model.card", lambda about: about | {"name": "../../../etc/passwd"}),
}
PATHS: dict[str, tuple[str, Callable[[Path], object]]] = {  # a right file with its card, and what becomes of it
    "without a card": ("model.missing", lambda path: path.with_suffix(".json").unlink()),
    "a folder": ("model.missing", lambda path: (path.unlink(), path.mkdir())),
    "a pipe": ("model.missing", lambda path: (path.unlink(), os.mkfifo(path))),
    "a link to zeros": ("model.missing", lambda path: (path.unlink(), path.symlink_to("/dev/zero"))),
    "of 6 GB": ("files.size", lambda path: os.truncate(path, 6 << 30)),
}
SOUND = graph().SerializeToString()
BROKEN: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "with a name of 300 letters": ("model.missing", lambda folder: folder / ("x" * 300 + ".onnx"))
}
for name, (code, make) in MODELS.items():
    BROKEN[name] = code, lambda folder, make=make: put(folder, make())
for name, (code, change) in CARDS.items():
    BROKEN[f"card {name}"] = code, lambda folder, change=change: put(folder, SOUND, change(card(SOUND)))
for name, (code, change) in PATHS.items():
    BROKEN[name] = code, lambda folder, change=change: (path := sound(folder), change(path))[0]
