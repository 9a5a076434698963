"""Models of strangers, each wrong in one way, with a card whose sha256 fits: `BROKEN[name]` is the code by which it is
refused, and what writes it into a folder.

Where it is the file that is wrong, it is made of `graph`; where it is the card, of `card`.
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

from cavirheo.prior import Prior
from cavirheo.problem import FrameGrid, TrainingProblem

FRAMES = 20
PRIOR = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}
OUTPUTS = list(PRIOR)[:2]
BROKEN: dict[str, tuple[str, Callable[[Path], Path]]] = {}
FLOAT, INT, TEXT = TensorProto.FLOAT, TensorProto.INT64, TensorProto.STRING


def numbers(name: str, values: Any, kind: Any = np.float32) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(values, dtype=kind), name)


def node(kind: str, inputs: str, outputs: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(kind, inputs.split(), outputs.split(), **attributes)


def graph(nodes: Any = (), tensors: Any = (), *, last="linear", opset=18, **given: Any) -> onnx.ModelProto:
    """theta = radius @ weight + bias, which is `linear`; then `nodes`, the result of which is named by `last`."""
    weight, bias = numbers("weight", 0.1 * np.ones((FRAMES, 2))), numbers("bias", [3.5, -2.5])
    linear = [node("MatMul", "radius weight", "product"), node("Add", "product bias", "linear")]
    inputs = given.pop("inputs", [helper.make_tensor_value_info("radius", FLOAT, ["batch", FRAMES])])
    outputs = given.pop("outputs", [helper.make_tensor_value_info("theta", FLOAT, ["batch", 2])])
    ordered = [*linear, *nodes, node("Identity", last, "theta")]
    made = helper.make_graph(ordered, "g", inputs, outputs, [weight, bias, *tensors])
    return helper.make_model(made, **{"opset_imports": [helper.make_opsetid("", opset)], "ir_version": 10, **given})


def card(content: bytes, **changed: Any) -> dict[str, Any]:
    problem = TrainingProblem("nhkv", Prior.uniform(PRIOR), grid=FrameGrid(frames=FRAMES))
    score = dict.fromkeys(("r2", "r2_natural", "median_absolute_error", "p90_absolute_error", "rmse", "bias"), 0.1)
    made = {
        "schema": 1, "name": "model", "kind": "point", "material": "nhkv", "problem_id": problem.id,
        "problem": problem.to_dict(),
        "input": {"name": "radius", "shape": ["batch", FRAMES], "dtype": "float32", "meaning": "R/R_max"},
        "outputs": [
            {"name": OUTPUTS[0], "unit": "Pa", "scale": "log10"}, {"name": OUTPUTS[1], "unit": "Pa s", "scale": "log10"}
        ],
        "network": {"parameters": 42}, "training": {"epochs": 1, "seed": 1, "best_epoch": 1},
        "history": {"train": [1.0], "validation": [1.0]},
        "data": {"n": 100, "seed": 1, "sha256": 64 * "0", "failures": {}, "train": 80, "validation": 10, "test": 10},
        "metrics": {name: score | {"median_relative_error": 0.1} for name in OUTPUTS},
        "onnx": {"sha256": hashlib.sha256(content).hexdigest(), "opset": 18}, "license": "MIT", "date": "2026-01-02",
    }  # fmt: skip
    return made | changed


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


def models(code: str, **made: Callable[[], onnx.ModelProto | bytes]) -> None:
    for name, make in made.items():
        BROKEN[name] = code, lambda folder, make=make: put(folder, make())


def cards(code: str, **made: Callable[[dict[str, Any]], Any]) -> None:
    """A right file, and what becomes of its card."""
    content = graph().SerializeToString()
    for name, change in made.items():
        BROKEN[name] = code, lambda folder, change=change: put(folder, content, change(card(content)))


def files(code: str, **made: Callable[[Path], object]) -> None:
    """A right file with its card, and what becomes of the path."""
    for name, change in made.items():

        def write(folder: Path, change: Callable[[Path], object] = change) -> Path:
            path = sound(folder)
            change(path)
            return path

        BROKEN[name] = code, write


def changed(**new: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda about: about | new


def of_problem(**new: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda about: about | {"problem": about["problem"] | new}


def nested(depth: int) -> bytes:
    """A model of an If within an If within ..., which only its bytes can hold."""
    inner = b""
    for _ in range(depth):
        branch = onnx.AttributeProto(name="then_branch", type=onnx.AttributeProto.GRAPH).SerializeToString()
        inner = message(1, onnx.NodeProto(op_type="If").SerializeToString() + message(5, branch + message(6, inner)))
    return message(7, inner)


def message(number: int, content: bytes) -> bytes:
    """A field of a protobuf message."""
    length, size = b"", len(content)
    while size > 127:
        length, size = length + bytes([size & 127 | 128]), size >> 7
    return bytes([number << 3 | 2]) + length + bytes([size]) + content


def with_a_function() -> onnx.ModelProto:
    opsets = [helper.make_opsetid("", 18), helper.make_opsetid("own", 1)]
    own = helper.make_function("own", "Twice", ["x"], ["y"], [node("Add", "x x", "y")], opsets[:1])
    return graph([node("Twice", "linear", "out", domain="own")], last="out", opset_imports=opsets, functions=[own])


def elsewhere(tensor: onnx.TensorProto, location: str) -> onnx.TensorProto:
    """Its numbers lie in another file."""
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=location)
    return tensor


def with_external_data() -> onnx.ModelProto:
    model = graph()
    elsewhere(model.graph.initializer[0], "../../../../etc/passwd")
    return model


def with_external_data_in_a_constant() -> onnx.ModelProto:
    made = node("Constant", "", "zero", value=elsewhere(numbers("value", np.zeros(2)), "/dev/zero"))
    made.ClearField("input")
    return graph([made, node("Add", "linear zero", "out")], last="out")


def of_operator(kind: str, **settings: Any) -> Callable[[], Any]:
    return lambda: graph([node(kind, "linear", "out", **settings)], last="out")


models("graph.damaged", empty=lambda: b"")
models("graph.damaged", with_a_length_beyond_the_end=lambda: graph().SerializeToString() + b"\x3a" + b"\xff" * 8)
models(
    "graph.operator",
    nested_deeply=lambda: nested(3000),
    with_an_operator_of_its_own=of_operator("Pwn", domain="com.evil"),
    with_random_numbers=of_operator("RandomNormalLike"),
)
models("graph.functions", with_a_function=with_a_function)
models(
    "graph.elsewhere",
    with_external_data=with_external_data,
    with_external_data_in_a_constant=with_external_data_in_a_constant,
)


def expanded_to_a_terabyte() -> onnx.ModelProto:
    nodes = [
        node("Expand", "bias huge", "grown"),
        node("ReduceMax", "grown", "top", keepdims=0),
        node("Add", "linear top", "out"),
    ]
    return graph(nodes, [numbers("huge", [1 << 37, 2], np.int64)], last="out")


def shaped_by_values() -> onnx.ModelProto:
    """A shape that is read off the curve: small on one, enormous on the next."""
    nodes = [
        node("ReduceMax", "radius", "most", keepdims=0), node("Mul", "most scale", "size"),
        node("Cast", "size", "count", to=INT), node("Unsqueeze", "count zero", "shape"),
        node("ConstantOfShape", "shape", "grown"), node("ReduceSum", "grown", "total", keepdims=0),
        node("Add", "linear total", "out"),
    ]  # fmt: skip
    return graph(nodes, [numbers("scale", 10.0), numbers("zero", [0], np.int64)], last="out")


def with_a_tensor(dims: tuple[int, ...], raw: bytes) -> Callable[[], onnx.ModelProto]:
    tensor = onnx.TensorProto(name="odd", data_type=FLOAT, dims=dims, raw_data=raw)
    return lambda: graph([node("Add", "linear odd", "out")], [tensor], last="out")


def slow() -> onnx.ModelProto:
    """Ten thousand products of 1000 x 1000, nothing of which is known before it runs."""
    nodes = [node("ReduceSum", "radius", "begin", keepdims=0), node("Expand", "one shape", "a")]
    nodes += [node("Mul", "a begin", "a0")] + [node("MatMul", f"a{k} a", f"a{k + 1}") for k in range(10_000)]
    nodes += [node("ReduceSum", "a10000", "total", keepdims=0), node("Add", "linear total", "out")]
    return graph(nodes, [numbers("shape", [1000, 1000], np.int64), numbers("one", [[1.0]])], last="out")


def shown(name: str, kind: int, shape: Any) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def with_two_inputs() -> onnx.ModelProto:
    both = [shown("radius", FLOAT, ["batch", FRAMES]), shown("more", FLOAT, ["batch", 2])]
    return graph([node("Add", "linear more", "out")], last="out", inputs=both)


def of_four_outputs_that_claims_two() -> onnx.ModelProto:
    return graph([node("Concat", "linear linear", "out", axis=1)], last="out")


def of_text_answers() -> onnx.ModelProto:
    ends = [shown("theta", TEXT, ["batch", 2])]
    return graph([node("Cast", "linear", "out", to=TEXT)], last="out", outputs=ends)


def of_nan_for_some_curves() -> onnx.ModelProto:
    nodes = [
        node("ReduceMin", "radius", "least", keepdims=0), node("Sub", "least most", "gap"),
        node("Log", "gap", "bad"), node("Add", "linear bad", "out"),
    ]  # fmt: skip
    return graph(nodes, [numbers("most", 0.95)], last="out")


models("graph.shape", shaped_by_values=shaped_by_values)
models("model.memory", expanded_to_a_terabyte=expanded_to_a_terabyte)
models("model.time", slow=slow)
models(
    "graph.order",
    with_two_inputs=with_two_inputs,
    with_a_ring=lambda: graph([node("Add", "linear b", "a"), node("Identity", "a", "b")], last="b"),
)
models(
    "model.fails",
    of_opset_999=lambda: graph(opset=999),
    with_sizes_that_overflow=with_a_tensor((1 << 32, 1 << 32), b""),
    with_a_tensor_cut_short=with_a_tensor((2,), bytes(4)),
    of_other_frames=lambda: graph(inputs=[shown("radius", FLOAT, ["batch", FRAMES + 1])]),
    of_four_outputs_that_claims_two=of_four_outputs_that_claims_two,
    of_text_answers=of_text_answers,
    of_nan_for_some_curves=of_nan_for_some_curves,
)


def of_output(**new: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda about: about | {"outputs": [about["outputs"][0] | new, about["outputs"][1]]}


cards("files.json", card_nested_deeply=lambda _: b"[" * 200_000)
cards("files.size", card_of_20_mb=lambda about: json.dumps(about) + " " * 20_000_000)
cards("model.changed", card_of_another_file=changed(onnx={"sha256": 64 * "0", "opset": 18}))
cards(
    "model.card",
    card_of_an_output_twice=of_output(name="log10_viscosity", unit="Pa s"),
    card_of_a_later_schema=changed(schema=2),
    card_of_the_problem_a_list=changed(problem=[]),
    card_of_the_material_unknown=of_problem(material="honey"),
    card_of_many_frames=of_problem(camera={"frame_interval": 1e-6, "frames": 10**9}),
    card_of_a_name_a_path=changed(name="../../../etc/passwd"),
)


def instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    """Something else in the place of the file."""
    return lambda path: (path.unlink(), make(path))


files(
    "model.missing",
    without_a_card=lambda path: path.with_suffix(".json").unlink(),
    a_folder=instead(Path.mkdir),
    a_pipe=instead(os.mkfifo),
    a_link_to_zeros=instead(lambda path: path.symlink_to("/dev/zero")),
)
files("files.size", of_6_gb=lambda path: os.truncate(path, 6 << 30))
BROKEN["with_a_name_of_300_letters"] = "model.missing", lambda folder: folder / ("x" * 300 + ".onnx")
