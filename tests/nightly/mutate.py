"""A valid file and a number -> the same damaged file on every machine, damaged where its format has structure.

Text is changed by tokens, lines and columns; MATLAB elements in their types, lengths and numbers, and packed again;
workbooks in the XML of their members; HDF5 in its datasets, attributes and links; ONNX in its graph; JSON and TOML in
their values. Every kind is also changed in its bytes.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

NUMBERS = re.split(
    r"\s+",
    """nan inf -inf 1e308 -1e308 1e400 5e-324 0 -0 -1 1e9 1e-9 1e17 9999999999999999999999
2147483648 0x10 1_000 ١٢ ½ 1e 1,5 1.5.2 1e5e5 +-1 TRUE 1d3 ∞ 12:30:05 2024-01-01 45%""",
)
WORDS = re.split(
    r"\s+",
    """' "" --- # % , ; =1+1 <script>alert(1)</script> [bold]x[/bold] [/] {{7*7}} $x^2_{
../../etc/passwd é😀 time_us radius_um time_s rmax_m px NaN(1) N/A null set shot""",
)
WORDS += ["", " ", "\t", "\0", "\ufeff", "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\u202etxt", "a" * 300, "R [mm]"]
WORDS += ["t (s)", "G' (Pa)", "strain (%)"]
BYTES = [b"\0", b"\xff", b"\x80", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\r", b"\n", b"PK\x03\x04"]
SIZES = (0, 1, 3, 8, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(name: str, content: bytes, seed: int, number: int) -> bytes:
    """`content` of a valid file `name`, changed one to four times."""
    chance = random.Random(f"{seed}/{number}/{name}")
    ways = WAYS.get(name.rpartition(".")[2], [text])
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        way = chance.choice([*ways * 4, flat])
        with suppress(Exception):  # what is damaged already may have no structure left to be changed
            content = way(content, chance)
    return content


def flat(content: bytes, chance: random.Random) -> bytes:
    """Bytes, whatever they mean."""
    at = chance.randrange(len(content) + 1)
    end = min(len(content), at + chance.choice((1, 1, 2, 4, 8, 64, 512)))
    piece = content[at:end]
    changed = [
        bytes(b ^ 1 << chance.randrange(8) for b in piece),
        chance.choice(BYTES),
        piece * chance.choice((0, 2, 50)),
        chance.randbytes(len(piece)),
        struct.pack("<I", chance.choice(SIZES)),
    ]
    if chance.random() < 0.1:
        return content[:at]
    return content[:at] + chance.choice(changed) + content[end:]


def word(chance: random.Random) -> str:
    return chance.choice(chance.choice((NUMBERS, WORDS)))


def text(content: bytes, chance: random.Random) -> bytes:
    """Tokens, lines, columns, separators and encodings."""
    said = content.decode("utf-8", "surrogateescape")
    lines = said.split("\n")
    k = chance.randrange(len(lines)) if chance.random() < 0.7 else 0
    cells = re.split("([,;\t ])", lines[k])
    at = chance.randrange(len(cells))
    match chance.randrange(9):
        case 0 | 1 | 2:
            lines[k] = "".join([*cells[:at], word(chance), *cells[at + chance.randrange(2) :]])
        case 3:
            lines[k:k] = [word(chance)] * chance.choice((1, 3, 200))
        case 4:
            lines[k : k + chance.choice((1, 5, 1000))] = lines[chance.randrange(len(lines)) :]
        case 5:
            lines = [line.replace(chance.choice(",;\t "), chance.choice(",;\t ")) for line in lines]
        case 6:
            lines[k] = lines[k] * chance.choice((2, 40, 4000))
        case 7:
            encoding = chance.choice(("utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "utf-32", "latin-1", "cp037"))
            return said.encode(encoding, "replace")
        case 8:
            end = chance.choice(("\r", "\r\n", "\n\n", "\x0b", "\u2028", "\n\t"))
            return end.join(lines).encode(errors="surrogateescape")
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def matlab(content: bytes, chance: random.Random) -> bytes:
    """One element: its type, length, flags, shape, name or numbers, at any depth; packed again as it was."""
    if b"\x89HDF" in content[:1024]:
        return content[:512] + hdf5(content[512:], chance)
    return content[:128] + b"".join(elements(content[128:], chance))


def elements(data: bytes, chance: random.Random) -> list[bytes]:
    """The elements one after the other, one of them changed."""
    parts, at = [], 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from("<II", data, at)
        small = kind >> 16 != 0
        after = at + 8 if small else at + 8 + length + (0 if kind == 15 else -length % 8)
        parts.append(data[at:after])
        at = after
    k = chance.randrange(len(parts))
    kind, length = struct.unpack_from("<II", parts[k])
    body = parts[k][8 : 8 + length]
    if kind in (14, 15) and chance.random() < 0.8:
        inside = b"".join(elements(zlib.decompress(body) if kind == 15 else body, chance))
        inside = zlib.compress(inside) if kind == 15 else inside
        parts[k] = struct.pack("<II", kind, len(inside)) + inside
        return parts
    changed = [
        struct.pack("<II", chance.randrange(20), length) + parts[k][8:],
        struct.pack("<II", kind, chance.choice(SIZES)) + parts[k][8:],
        parts[k][:8] + struct.pack("<2I", chance.choice(SIZES), chance.choice(SIZES)) + parts[k][16:],
        parts[k][:8] + struct.pack("<d", chance.choice((np.nan, np.inf, -1, 1e308, 5e-324))) + parts[k][16:],
        parts[k][:8] + chance.randbytes(len(parts[k]) - 8),
        parts[k] * chance.choice((0, 2, 300)),
    ]
    parts[k] = chance.choice(changed)
    return parts


ODD: list[Any] = [
    np.nan, np.inf, -1.0, 1e308, 2**62, True, 1j, np.zeros(3), np.zeros((2, 0)), h5py.Empty("f8"), np.array([b"x"]),
    np.zeros(2, [("a", "f8"), ("b", "i4")]), np.zeros(1, "V8"), "", "seven", "\x1b[31m", "é" * 300, b"\xff\xfe",
]  # fmt: skip
KINDS = [h5py.ref_dtype, h5py.string_dtype(), h5py.vlen_dtype("f8"), h5py.opaque_dtype("M8[s]"), "f8", "S9"]


def hdf5(content: bytes, chance: random.Random) -> bytes:
    """A dataset, attribute or link of the file, made anew as something else."""
    memory = io.BytesIO(content)
    with h5py.File(memory, "r+") as file:
        names: list[str] = ["/"]
        file.visit(names.append)
        name = chance.choice(names)
        if chance.random() < 0.25:
            told = file[name].attrs
            told[chance.choice([*told, "stretch", "MATLAB_empty", "frame_rate_hz"])] = chance.choice(ODD)
        else:
            remake(file, name, chance)
    return memory.getvalue()


def remake(file: h5py.File, name: str, chance: random.Random) -> None:
    """Another dataset or link at the place of one, or within a group."""
    numbers: Any = np.arange(100.0)
    if not isinstance(file[name], h5py.Dataset):
        name = f"{name}/{chance.choice(('time', 'radius_um', 'theta', 'status', 'Rnew', 't'))}"
    elif file[name].dtype.kind in "fiu":
        numbers = np.asarray(file[name][()]).ravel()
    with suppress(KeyError):
        del file[name]
    if chance.random() < 0.3:  # declared, and not written
        shape = chance.choice(((), (0,), (3,), (1, 3), (100,), (10**12,)))
        chunked = {"chunks": (10,), "maxshape": (None,)} if len(shape) == 1 else {}
        file.create_dataset(name, shape, chance.choice(KINDS), **chunked)
        return
    spoilt = np.nan_to_num(numbers.astype(float)) * chance.choice((0.0, 1.0, 1e6))
    spoilt[chance.randrange(len(spoilt)) :: chance.choice((1, 7))] = chance.choice((np.nan, np.inf, -1, 0, 1e308))
    links = [h5py.SoftLink(target) for target in ("/nowhere", "/", name, "/time", "/gel")]
    links += [h5py.ExternalLink("other.h5", "/x"), file["/"]]
    shapes = [numbers[:2], numbers[::-1], np.stack([numbers] * 2), numbers[:, None]]
    kinds = [spoilt.astype(kind) for kind in (">f4", "f8", "f2", complex, "S6", bool)]
    file[name] = chance.choice(chance.choice((links, shapes, kinds, ODD)))


def archive(content: bytes, chance: random.Random) -> bytes:
    """A member of a workbook: its XML, its name, or whether it is there."""
    with zipfile.ZipFile(io.BytesIO(content)) as old:
        members = [(name, old.read(name)) for name in old.namelist()]
    k = chance.randrange(len(members)) if chance.random() < 0.4 else len(members) - 1
    name, data = members[k]
    another = (word(chance)[:40].replace("\0", "0") or "x", data)
    changed = (name, markup(data.decode(errors="replace"), chance).encode(errors="replace"))
    members[k : k + 1] = chance.choice(([], [another], [(name, data), (name, flat(data, chance))], *[[changed]] * 5))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", chance.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))) as new:
        for name, data in members:
            new.writestr(name, data)
    return packed.getvalue()


CELLS = [
    '<c r="XFD1048576"><v>1</v></c>', '<c r="A1048577"><v>1</v></c>', '<c t="s"><v>9</v></c>', '<c r="1A"/>',
    '<c t="e"><v>#REF!</v></c>', '<c t="d"><v>2024-01-01T00:00:00</v></c>', '<c t="str"><v/></c>', "&e;", "&#0;",
    "<c><f>1/0</f></c>", "<c><v>1e400</v></c>", '<c r="A-1"><v>1</v></c>', '<row r="1048577">', "</sheetData>",
    '<mergeCell ref="A1:XFD1048576"/>', '<table:table-row table:number-rows-repeated="99999">',
    '<table:table-cell table:number-columns-repeated="-1"/>', '<sheet name="x" sheetId="9" r:id="rId9"/>',
]  # fmt: skip


def markup(said: str, chance: random.Random) -> str:
    """Tags, attributes and texts of XML."""
    start, end = chance.choice([match.span() for match in re.finditer(r"<[^>]*>", said)])
    odd = word(chance).replace("\0", "")
    within = chance.choice([match.span(1) for match in re.finditer(r'="([^"]*)"', said)] or [(start, end)])
    ways = [
        said[:start] + said[start:end] * chance.choice((0, 2)) + said[end:],
        said[:end] + chance.choice(CELLS) + said[end:],
        said[:end] + odd + said[end:],
        said[: within[0]] + odd.replace('"', "") + said[within[1] :],
        said[: chance.randrange(len(said))],
    ]
    return chance.choice(ways)


def values(content: bytes, chance: random.Random) -> bytes:
    """A value somewhere in a JSON document."""
    tree = json.loads(content)
    at: Any = tree
    while True:
        key = chance.choice(list(at) if isinstance(at, dict) else range(len(at)))
        below = at[key]
        if not (isinstance(below, (dict, list)) and below) or chance.random() < 0.15:
            break
        at = below
    odd = [
        None, True, 0, -1, 1e308, 5e-324, 10**30, float("nan"), "", "x" * 300, "\x1b[31m", "<b>x", [], {}, [below],
        {"a": below}, str(below), [below] * 300, word(chance), "[/]", "\ud800",
    ]  # fmt: skip
    match chance.randrange(8):
        case 0:
            del at[key]
        case 1 if isinstance(at, dict):
            at[word(chance)] = at.pop(key)
        case _:
            at[key] = chance.choice(odd)
    return json.dumps(tree).encode()


def settings(content: bytes, chance: random.Random) -> bytes:
    """A value, key or section of TOML."""
    lines = content.decode("utf-8", "replace").split("\n")
    k = chance.choice([k for k, line in enumerate(lines) if line])
    key, _, given = lines[k].partition("=")
    odd = re.split(
        r"\s+",
        """-1 0 1e308 nan inf 10000000000000 true "" "x" [] {} [1,2,3] [3.0,3.0] [6.0,3.0] [nan,1.0]
    [-400.0,400.0] ["a","b"] 1979-05-27 {density="x"} {density=-1} "\\u001b[31m" "../../x" "zener" "newtonian\"""",
    )
    another = chance.choice((lines[k], "[problem]", "[[prior]]", "x = 1", "[a.b]", word(chance)))
    changed = f"{key} = {chance.choice(odd)}" if given else f"[{word(chance)}]"
    lines[k : k + 1] = chance.choice(([], [f"{word(chance)} ={given}"], [another, lines[k]], *[[changed]] * 5))
    return "\n".join(lines).encode(errors="replace")


OPERATORS = ["Loop", "If", "Scan", "ConstantOfShape", "Expand", "Resize", "Tile", "Exp", "Log", "Range", "x"]


def graph(content: bytes, chance: random.Random) -> bytes:
    """A node, weight, shape or name of a network."""
    import onnx
    from onnx import TensorProto

    model = onnx.ModelProto.FromString(content)
    node = chance.choice(model.graph.node)
    weight = model.graph.initializer[0] if model.graph.initializer else TensorProto()
    end = chance.choice((model.graph.input, model.graph.output))[0].type.tensor_type
    odd = chance.choice((np.nan, np.inf, 1e38, 0))
    changes = [
        (node, "op_type", OPERATORS),
        (model.opset_import[0], "version", (0, 1, 9, 17, 99)),
        (weight, "data_type", range(24)),
        (weight, "raw_data", (np.full(100, odd, np.float32).tobytes(),)),
        (weight, "data_location", (TensorProto.EXTERNAL,)),
        (end, "elem_type", (1, 7, 8, 11, 16)),
    ]
    match chance.randrange(9):
        case 0:
            node.input[0] = chance.choice((node.output[0], "w", "radius", "nothing", ""))
        case 1:
            node.output[0] = chance.choice(("theta", "radius", "b", ""))
        case 2:
            weight.dims[:] = chance.choice(([100], [1, 100], [-1], [2**40, 2**40], [], [100, 1, 1]))
            del end.shape.dim[chance.randrange(3) :]
        case _:
            owner, field, others = chance.choice(changes)
            setattr(owner, field, chance.choice(others))
    if weight.data_location == TensorProto.EXTERNAL:
        weight.external_data.add(key="location", value=chance.choice(("/etc/passwd", "other", "../x")))
    return model.SerializeToString()


WAYS: dict[str, list[Callable[[bytes, random.Random], bytes]]] = {
    "mat": [matlab], "h5": [hdf5], "xlsx": [archive], "ods": [archive], "xls": [flat], "json": [values, values, text],
    "toml": [settings, settings, text], "onnx": [graph],
}  # fmt: skip


def originals(folder: Path) -> dict[str, bytes]:
    """The valid files that mutations start from, by name."""
    from valid import BINARIES, TEXTS, card_of, content, documents

    found = {name: content(name, folder) for name in (*TEXTS, *BINARIES)}
    found |= {name: said.encode() for name, said in documents().items()}
    return found | {"card.json": json.dumps(card_of(found["network.onnx"])).encode()}
