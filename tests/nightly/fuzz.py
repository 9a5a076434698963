"""Mutated files through the functions that read files, in processes of their own: `python tests/nightly/fuzz.py`.

File k of seed s is the same on every machine. What is not a clean refusal is kept in the output folder with a report
beside it: a traceback, a crash, a hang, a warning, numbers that no curve may hold, a refusal that hides a mistake of
ours or that does not name the file.
"""

import argparse
import contextlib
import re
import shutil
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import numpy as np
from apart import Ended, each_apart
from mutate import mutated
from valid import BINARIES, TEXTS, content, documents

import cavirheo
from cavirheo import InputError, SolverError
from cavirheo.companions import collapse_times, published_values
from cavirheo.companions.rheometer import read_sweeps
from cavirheo.inference.model import Network
from cavirheo.io import write_csv
from cavirheo.io.option_tables import read_trace
from cavirheo.physics.media import WATER
from cavirheo.training.recipe import read_recipe

SECONDS = 120.0  # that a file may take, on a machine that others use too
OURS = (AttributeError, TypeError, IndexError, KeyError, NameError, AssertionError, ZeroDivisionError, MemoryError)
OURS += (RecursionError, OverflowError, FloatingPointError, NotImplementedError)


def read_curves(path: Path) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        known = curve.radius[np.isfinite(curve.radius)]
        assert np.isfinite(curve.time).all()
        assert (np.diff(curve.time) > 0).all()
        assert (known > 0).all()
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


TABLES: tuple[Callable[[Path], object], ...] = (
    read_curves,
    times,
    read_sweeps,
    read_trace,
    published_values.read_references,
)
READERS = dict.fromkeys(("csv", "txt", "xlsx"), TABLES) | dict.fromkeys(("ods", "xls", "mat", "h5"), TABLES[:3])
READERS |= {"toml": (lambda path: read_recipe(path).settings(),), "json": (cavirheo.load,), "onnx": (network,)}
READERS |= {"shard-00000.h5": (load_folder,)}


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
        found = [(answer.outcome, answer.why)] if isinstance(answer, Ended) else answer
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
