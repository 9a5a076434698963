"""What the graph in an .onnx file may hold: looked at before anything of it runs.

A network that reads a curve is arithmetic on arrays whose shapes follow from the number of curves alone. So a graph
may have the operators below and nothing else (no loops, no functions, no numbers from other files), and none of them
takes a shape from the values of the curve. Then one run under limits (session.py) shows what every later run takes.

The file is a message of protocol buffers: fields with a number and a value, of which some are messages themselves
(https://github.com/onnx/onnx/blob/main/onnx/onnx.proto). Read are those few that decide.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from cavirheo.errors import InputError, require

MOST_FIELDS = 300_000  # a network has some thousand
_ALLOWED = """
Abs Add And ArgMax ArgMin AveragePool BatchNormalization Cast CastLike Ceil Clip Concat Constant ConstantOfShape Conv
Cos CumSum Div Einsum Elu Equal Erf Exp Expand Flatten Floor Gather GatherElements GatherND Gelu Gemm GlobalAveragePool
Greater GreaterOrEqual GroupNormalization HardSigmoid HardSwish Identity InstanceNormalization LayerNormalization
LeakyRelu Less LessOrEqual Log LogSoftmax MatMul Max MaxPool Mean Min Mish Mod Mul Neg Not Or PRelu Pad Pow Range
Reciprocal ReduceL1 ReduceL2 ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum Relu Reshape Round
ScatterElements ScatterND Selu Shape Sigmoid Sign Sin Size Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum
Tan Tanh Tile TopK Transpose Trilu Unsqueeze Where Xor
"""
_OPERATORS = frozenset(_ALLOWED.split())
# the inputs that say how large the result is
_SIZES = {"ConstantOfShape": (0,), "Range": (0, 1, 2), "Slice": (1, 2, 3, 4), "Pad": (1, 3)}
_SIZES |= dict.fromkeys(("Expand", "Reshape", "Split", "Squeeze", "Tile", "TopK", "Unsqueeze"), (1,))
_SIZES |= {name: (1,) for name in _OPERATORS if name.startswith("Reduce")}

Value = int | memoryview
Fields = Mapping[int, Sequence[Value]]  # all values of a field, by its number


def check_graph(content: bytes, inputs: Sequence[str] = ("radius",)) -> None:
    """Raises InputError ("graph." and a word) unless the file is made of the allowed parts alone and reads `inputs`."""
    try:
        _Graph(content).check(inputs)
    except (LookupError, TypeError, UnicodeDecodeError) as error:  # it ends early; a number is where text belongs
        raise InputError("the file is damaged or not an ONNX model", "graph.damaged") from error


class _Graph:
    def __init__(self, content: bytes) -> None:
        self.left = MOST_FIELDS
        model = self.fields(memoryview(content))
        require(len(model[7]) == 1, f"the file holds {len(model[7])} graphs, not one", "graph.damaged")
        require(not model[20] and not model[25], "the model has functions or a training of its own", "graph.functions")
        self.nodes, self.tensors, sparse = (self.fields(model[7][0])[number] for number in (1, 5, 15))
        require(not sparse, "the model has sparse tensors", "graph.sparse")

    def fields(self, message: Value) -> Fields:
        """The values in a message."""
        if isinstance(message, int):
            raise TypeError("a number, not a message")
        at = 0
        values: defaultdict[int, list[Value]] = defaultdict(list)
        while at < len(message):
            self.left -= 1
            require(self.left > 0, f"the model has more than {MOST_FIELDS} parts", "graph.size")
            key, at = _varint(message, at)
            if key & 7 == 0:
                number, at = _varint(message, at)
                values[key >> 3].append(number)
                continue
            size, at = _varint(message, at) if key & 7 == 2 else ({1: 8, 5: 4}[key & 7], at)
            values[key >> 3].append(message[at : at + size])
            at += size
            if at > len(message):
                raise IndexError("the message ends too early")
        return values

    def check(self, inputs_of_model: Sequence[str]) -> None:
        constants = {self.checked(tensor) for tensor in self.tensors}
        of_curve = {*inputs_of_model}
        defined = {""} | of_curve | constants
        for node in map(self.fields, self.nodes):
            kind, domain = _text(node[4]), _text(node[7])
            inputs, results = [_text([name]) for name in node[1]], [_text([name]) for name in node[2]]
            foreign = f"the operator {f'{domain}.{kind}'.strip('.')[:60]!r} is not among those that are run (Add, "
            fine = kind in _OPERATORS and domain in ("", "ai.onnx")
            require(fine, f"{foreign}MatMul, Softmax, ...; no loops, nothing random)", "graph.operator")
            for attribute in map(self.fields, node[5]):
                inner = any(attribute[number] for number in (6, 10, 11, 22, 23))  # graphs, and lists of tensors
                require(not inner, f"the operator {kind} holds a graph of its own", "graph.operator")
                for tensor in attribute[5]:
                    self.checked(tensor)
            unknown = ", ".join(sorted({*inputs} - defined))[:60]
            require(not unknown, f"the operator {kind} reads {unknown!r}, which nothing has given", "graph.order")
            sized = of_curve & {inputs[place] for place in _SIZES.get(kind, ()) if place < len(inputs)}
            message = f"the operator {kind} takes a shape from the values of the curve: its memory cannot be foreseen"
            require(not sized, message, "graph.shape")
            defined.update(results)
            if kind not in ("Shape", "Size") and of_curve & {*inputs}:
                of_curve.update({*results} - {""})

    def checked(self, tensor: Value) -> str:
        """The name of a tensor. Raises InputError: its numbers are in another file."""
        fields = self.fields(tensor)
        message = f"the numbers of {_text(fields[8])[:60]!r} are in another file: only a model of one file is run"
        require(not fields[13] and not any(fields[14]), message, "graph.elsewhere")
        return _text(fields[8])


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, the lowest first, and where it ends. Raises IndexError."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at + shift // 7]
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at + shift // 7 + 1
    raise IndexError("a number of more than ten bytes")


def _text(values: Sequence[Value]) -> str:
    value = values[-1] if values else b""
    if isinstance(value, int):
        raise TypeError("a number, not text")
    return bytes(value).decode()
