"""Valid files, damaged (file k of seed s is the same on every machine), and the functions that read each kind."""

import contextlib
import json
import random
import re
import struct
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import numpy as np

import cavirheo
from cavirheo import InputError
from cavirheo.companions import collapse_times, published_values
from cavirheo.companions.rheometer import read_sweeps
from cavirheo.inference.bdt import Network
from cavirheo.physics.media import WATER
from cavirheo.training.recipe import read_recipe


def read_curves(path: Path) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        assert np.isfinite(curve.time).all()
        assert (np.diff(curve.time) > 0).all()
        assert not (curve.radius <= 0).any()
        with contextlib.suppress(InputError):
            _ = curve.max_radius, curve.collapse_times(), curve.noise, curve.strain_rate(), curve.normalised(WATER)


def times(path: Path) -> None:
    _, problems, *_ = collapse_times.read_groups([path], WATER)
    if problems:
        raise InputError(problems[0])


def load_folder(path: Path) -> None:
    """The file as the only shard of a training set."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        Path(folder, "shard-00000.h5").symlink_to(path.resolve())
        cavirheo.load(folder).split(0)


def network(path: Path) -> None:
    from broken_models import FRAMES, put

    Network(put(path.parent, path.read_bytes()))(np.ones((2, FRAMES)))


TABLES = (read_curves, times, read_sweeps, published_values.read_references)
READERS = dict.fromkeys(("csv", "txt", "xlsx"), TABLES) | dict.fromkeys(("ods", "xls", "mat", "h5"), TABLES[:3])
READERS |= {"toml": (lambda path: read_recipe(path).settings(),), "json": (cavirheo.load,), "npz": (network,)}
READERS |= {"shard-00000.h5": (load_folder,)}


# --- a valid file and a number -> the same damaged file on every machine

_NUMBERS = """nan inf -inf 1e308 1e400 5e-324 0 -1 1e17 9999999999999999999999 2147483648 0x10 1_000 ١٢ ½ 1e 1,5
1.5.2 +-1 TRUE ∞ 12:30:05 2024-01-01 45% 10000000000000"""
_WORDS = """' "" --- # % , ; =1+1 <script>alert(1)</script> [/] {{7*7}} $x^2_{ ../../etc/passwd é😀 time_us radius_um
rmax_m px NaN(1) N/A null shot [] {} [nan,1.0] [a.b] &#0; </sheetData>"""
NUMBERS, WORDS = _NUMBERS.split(), _WORDS.split()
WORDS += ["", " ", "\t", "\0", "\ufeff", "\x1b[31mred\x1b[0m", "\u202etxt", "a" * 300, "R [mm]", "G' (Pa)"]
LONGEST = 200_000  # characters of a line that is repeated
SIZES = (0, 1, 3, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(name: str, content: bytes, seed: int, number: int) -> bytes:
    """`content` of a valid file `name`, changed one to four times."""
    chance = random.Random(f"{seed}/{number}/{name}")
    way = WAYS.get(name.rpartition(".")[2], text)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        with contextlib.suppress(Exception):  # what is damaged already may have no structure left to be changed
            content = chance.choice((way, way, way, flat))(content, chance)
    return content


def flat(content: bytes, chance: random.Random) -> bytes:
    """Bytes, whatever they mean."""
    at = chance.randrange(len(content) + 1)
    end = min(len(content), at + chance.choice((1, 1, 2, 4, 8, 64, 512)))
    piece = content[at:end]
    changed = [
        bytes(b ^ 1 << chance.randrange(8) for b in piece),
        chance.choice((b"\0", b"\xff", b"\r", b"\xff\xff\xff\x7f")),
        piece * chance.choice((0, 2, 50)),
        chance.randbytes(len(piece)),
        struct.pack("<I", chance.choice(SIZES)),
        struct.pack("<d", chance.choice((np.nan, np.inf, -1, 1e308, 5e-324))),
    ]
    return content[:at] + chance.choice(changed) + (b"" if chance.random() < 0.1 else content[end:])


def word(chance: random.Random) -> str:
    return chance.choice(chance.choice((NUMBERS, WORDS)))


def text(content: bytes, chance: random.Random) -> bytes:
    """Tokens, lines, separators and encodings."""
    said = content.decode("utf-8", "surrogateescape")
    lines = said.split("\n")
    k = chance.randrange(len(lines)) if chance.random() < 0.7 else 0
    cells = re.split("([,;\t =<>])", lines[k])
    at = chance.randrange(len(cells))
    match chance.randrange(8):
        case 0 | 1 | 2:
            lines[k] = "".join([*cells[:at], word(chance), *cells[at + chance.randrange(2) :]])
        case 3:
            lines[k:k] = [word(chance)] * chance.choice((1, 3, 200))
        case 4:
            lines[k : k + chance.choice((1, 5, 1000))] = lines[chance.randrange(len(lines)) :]
        case 5:
            lines = [line.replace(chance.choice(",;\t "), chance.choice(",;\t ")) for line in lines]
        case 6:
            lines[k] = (lines[k] * chance.choice((2, 40, 4000)))[:LONGEST]
        case 7:
            return said.encode(chance.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "latin-1")), "replace")
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def values(content: bytes, chance: random.Random) -> bytes:
    """A value somewhere in a JSON document."""
    at = [json.loads(content)]
    key, tree = 0, at
    while isinstance(at[key], dict | list) and at[key] and chance.random() < 0.9:
        at = at[key]
        key = chance.choice(list(at) if isinstance(at, dict) else range(len(at)))
    below = at[key]
    if chance.random() < 0.1:
        del at[key]
    else:
        odd = [None, True, 0, -1, 1e308, 10**30, float("nan"), "x" * 300, "<b>x", [], {}, [below] * 300, str(below)]
        at[key] = chance.choice([*odd, word(chance), {"a": below}, "\ud800"])
    return json.dumps(tree[0]).encode()


WAYS: dict[str, Callable[[bytes, random.Random], bytes]] = {"json": values}
WAYS |= dict.fromkeys(("mat", "xls", "xlsx", "ods", "h5", "npz"), flat)
