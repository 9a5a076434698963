"""Mutated files through the functions that read files, in processes of their own: `python tests/nightly/fuzz.py`.

File k of seed s is the same on every machine. What is not a clean refusal is kept in the output folder with a report
beside it: a traceback, a crash, a hang, a warning, numbers that no curve may hold, a refusal that hides a mistake of
ours or that does not name the file.
"""

import argparse
import contextlib
import io
import json
import random
import re
import shutil
import struct
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
import h5py
import numpy as np
from apart import Ended, each_apart
from valid import BINARIES, TEXTS, content, documents

import cavirheo
from cavirheo import InputError, SolverError
from cavirheo.companions import collapse_times, published_values
from cavirheo.companions.rheometer import read_sweeps
from cavirheo.inference.bdt import Network
from cavirheo.io import write_csv
from cavirheo.io.curves import read_trace
from cavirheo.physics.media import WATER
from cavirheo.training.recipe import read_recipe

SECONDS = 120.0  # that a file may take, on a machine that others use too
OURS = (AttributeError, TypeError, IndexError, KeyError, NameError, AssertionError, ZeroDivisionError, MemoryError)
OURS += (RecursionError, OverflowError, FloatingPointError, NotImplementedError)


def read_curves(path: Path) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        assert np.isfinite(curve.time).all()
        assert (np.diff(curve.time) > 0).all()
        assert not (curve.radius <= 0).any()
        for use in (
            lambda c=curve: (c.max_radius, c.collapse_times(), c.noise, c.strain_rate(), c.normalised(WATER)),
            lambda c=curve: c.resampled(1e-6, 100, allow_short=True),
            lambda c=curve: write_csv(path.with_name("written.out"), c),
        ):
            with contextlib.suppress(InputError):
                use()


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


TABLES = (read_curves, times, read_sweeps, read_trace, published_values.read_references)
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
            lines[k] = lines[k] * chance.choice((2, 40, 4000))
        case 7:
            return said.encode(chance.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "latin-1")), "replace")
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def archive(content: bytes, chance: random.Random) -> bytes:
    """A member of a workbook: its bytes, its words, its name, or whether it is there."""
    with zipfile.ZipFile(io.BytesIO(content)) as old:
        members = [(name, old.read(name)) for name in old.namelist()]
    k = chance.randrange(len(members))
    name, data = members[k]
    changed = [(name, chance.choice((flat, text))(data, chance))]
    members[k : k + 1] = chance.choice(([], [(word(chance)[:40].replace("\0", "0") or "x", data)], *[changed] * 5))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as new:
        for name, data in members:
            new.writestr(name, data)
    return packed.getvalue()


ODD: list[Any] = [np.nan, np.inf, -1.0, 1e308, 2**62, True, 1j, "seven", "\x1b[31m", "é" * 300, b"\xff\xfe"]
ODD += [np.zeros(3), np.zeros((2, 0)), np.array([b"x"]), np.zeros(2, [("a", "f8"), ("b", "i4")]), np.zeros(1, "V8")]
ODD += [h5py.Empty("f8"), h5py.SoftLink("/nowhere"), h5py.SoftLink("/"), h5py.ExternalLink("other.h5", "/x")]


def hdf5(content: bytes, chance: random.Random) -> bytes:
    """A dataset, an attribute or a link of the file is something else."""
    memory = io.BytesIO(content)
    with h5py.File(memory, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = chance.choice(names)
        if chance.random() < 0.25:
            file[name].attrs[chance.choice(("stretch", "MATLAB_empty", "frame_rate_hz"))] = chance.choice(ODD)
            return memory.getvalue()
        kept = np.asarray(file[name][()]) if isinstance(file[name], h5py.Dataset) else np.arange(100.0)
        del file[name]
        if chance.random() < 0.3:  # declared, and not written
            kind = chance.choice((h5py.ref_dtype, h5py.string_dtype(), h5py.vlen_dtype("f8"), "f8", "S9"))
            file.create_dataset(name, chance.choice(((), (0,), (3,), (1, 3), (100,), (10**12,))), kind)
        elif kept.dtype.kind in "fiu" and chance.random() < 0.5:
            file[name] = chance.choice((kept[:2], kept[::-1], np.stack([kept] * 2), kept.astype(complex)))
        else:
            file[name] = chance.choice(ODD)
    return memory.getvalue()


def values(content: bytes, chance: random.Random) -> bytes:
    """A value somewhere in a JSON document."""
    at: Any = [json.loads(content)]
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


WAYS = {"mat": flat, "xls": flat, "npz": flat, "h5": hdf5, "xlsx": archive, "ods": archive, "json": values}


# --- what is said of it


def judged(read: Callable[[Path], object], path: Path) -> tuple[str, str]:
    """What came of a file, and what was said: what is neither "answered" nor "refused" is wrong."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read(path)
        except (InputError, SolverError) as error:
            line, cause = str(error), error.__cause__ or error.__context__
            while isinstance(cause, InputError):
                cause = cause.__cause__ or cause.__context__
            if error.code == "reading.damaged" and isinstance(cause, OURS):
                where = traceback.extract_tb(cause.__traceback__)[-1].filename
                if "/cavirheo/" in where:  # and not a library's, by which it says that a file is damaged
                    return "masked", "".join(traceback.format_exception(cause))
            clean = not re.search(r"[\x00-\x1f\x7f-\x9f]", line) and str(path.parent) in line
            return ("refused" if clean else "unnamed"), line
        except Exception:
            return "traceback", traceback.format_exc()
    ours = [f"{one.filename}:{one.lineno} {one.message}" for one in caught if "cavirheo" in one.filename]
    return ("warning", ours[0]) if ours else ("answered", "")


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("-n", type=int, default=20_000)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--first", type=int, default=0, help="number of the first file")
    asked.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        originals = {name: content(name, Path(folder)) for name in (*TEXTS, *BINARIES) if "-packed" not in name}
    originals |= {name: text.encode() for name, text in documents().items()}
    names, folder = list(originals), given.out / f"seed-{given.seed}"

    def judge(number: int) -> list[tuple[str, str]]:
        name = names[number % len(names)]
        path = folder / str(number) / f"file{Path(name).suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(mutated(name, originals[name], given.seed, number))
        return [judged(read, path) for read in READERS.get(name) or READERS[path.suffix[1:]]]

    counts = Counter[str]()
    for number, answer in each_apart(judge, range(given.first, given.first + given.n), SECONDS):
        found = [answer] if isinstance(answer, Ended) else answer
        kind = Path(names[number % len(names)]).suffix[1:]
        counts.update(f"{kind}: {outcome}" for outcome, _ in found)
        wrong = [f"{outcome}\n{why}\n" for outcome, why in found if outcome not in ("answered", "refused")]
        if wrong:
            (folder / str(number) / "found.txt").write_text("\n".join(wrong))
            print(f"{folder / str(number)}: {wrong[0]}", flush=True)
        else:
            shutil.rmtree(folder / str(number))
    print(*(f"{n:6d}  {key}" for key, n in sorted(counts.items())), sep="\n")
    return int(any(not key.endswith(("answered", "refused")) for key in counts))


if __name__ == "__main__":
    sys.exit(main())
