"""Valid files, damaged (file k of seed s is the same on every machine), and the functions that read each kind."""

import contextlib
import random
import re
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import numpy as np
from conftest import WATER

import cavirheo
from cavirheo import InputError
from cavirheo.companions import collapse_times, published_values
from cavirheo.companions.rheometer import read_sweeps
from cavirheo.inference.bdt import Network
from cavirheo.training.recipe import read_recipe


def read_curves(path: Path) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        assert np.isfinite(curve.time).all()
        assert (np.diff(curve.time) > 0).all()
        assert not (curve.radius <= 0).any()
        with contextlib.suppress(InputError):
            _ = curve.max_radius, curve.collapse_times(), curve.noise, curve.strain_rate(), curve.normalised(WATER)


def times(path: Path) -> None:
    collapse_times.read_table(path)


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

_WORDS = """nan inf -inf 1e308 1e400 5e-324 0 -1 1e17 9999999999999999999999 0x10 1_000 ١٢ ½ 1e 1,5 1.5.2 ∞ 12:30:05
45% ' "" --- # % , ; =1+1 <script>alert(1)</script> [/] {{7*7}} $x^2_{ ../../etc/passwd 😀 time_us rmax_m px NaN(1) null
shot [] {} [[[ &#0; </sheetData>"""
WORDS = [*_WORDS.split(), "", " ", "\t", "\0", "\ufeff", "\x1b[31mred\x1b[0m", "\u202etxt", "a" * 300, "R [mm]"]
TEXT = ("csv", "txt", "toml", "json")


def mutated(name: str, content: bytes, seed: int, number: int) -> bytes:
    """`content` of a valid file `name`, changed one to four times: its bytes, or the words and lines of a text."""
    chance = random.Random(f"{seed}/{number}/{name}")
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        of_text = name.rpartition(".")[2] in TEXT and chance.random() < 0.75
        content = (words if of_text else flat)(content, chance)
    return content


def flat(content: bytes, chance: random.Random) -> bytes:
    """A piece is turned, replaced, repeated or left out, or the file ends there."""
    at = chance.randrange(len(content) + 1)
    end = min(len(content), at + chance.choice((1, 1, 2, 4, 8, 64, 512)))
    piece = content[at:end]
    turned = bytes(b ^ 1 << chance.randrange(8) for b in piece)
    fixed = (b"\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", np.float64(np.nan).tobytes(), np.float64(1e308).tobytes())
    changed = chance.choice((turned, turned, chance.choice(fixed), chance.randbytes(len(piece)), piece * 50, b""))
    return content[:at] + changed + (b"" if chance.random() < 0.1 else content[end:])


def words(content: bytes, chance: random.Random) -> bytes:
    """A cell becomes another word, a line is doubled a hundred times, or separators and encoding change."""
    text = content.decode("utf-8", "surrogateescape")
    lines = text.split("\n")
    k = chance.randrange(len(lines)) if chance.random() < 0.7 else 0
    cells = re.split("([,;\t =<>:])", lines[k])
    match chance.randrange(6):
        case 0 | 1 | 2:
            cells[chance.randrange(len(cells))] = chance.choice(WORDS)
            lines[k] = "".join(cells)
        case 3:
            lines[k : k + chance.randrange(3)] = [lines[chance.randrange(len(lines))]] * chance.choice((1, 3, 100))
        case 4:
            lines = [line.replace(chance.choice(",;\t "), chance.choice(",;\t ")) for line in lines]
        case 5:
            return text.encode(chance.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "latin-1")), "replace")
    return "\n".join(lines).encode("utf-8", "surrogateescape")
