"""Mutated files through the functions that read files, in processes of their own: `python tests/nightly/fuzz.py`.

File k of seed s is the same on every machine. What is not a clean refusal is kept in the output folder with a report
beside it: a traceback, a crash, a hang, too much memory, a warning, numbers that no curve may hold, a refusal that
hides a mistake of ours ("masked") or that does not name the file.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import numpy as np
from apart import Ended, each_apart
from mutate import mutated, originals
from valid import card_of

import cavirheo
from cavirheo.companions import collapse_times, published_values
from cavirheo.companions.rheometer import document, read
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.model import Network
from cavirheo.io import write_csv
from cavirheo.io.trace import read_trace
from cavirheo.physics.driving import Trace
from cavirheo.physics.media import WATER
from cavirheo.training import dataset
from cavirheo.training.recipe import read_recipe

SECONDS = 20.0  # of processor time a file may take
MEMORY = 1 << 30  # bytes a file may add
Room = Callable[[Path], object]
Finding = tuple[str, str, str, str]  # room, outcome, where, text
FINE = ("read", "refused")
OURS = (AttributeError, TypeError, IndexError, KeyError, NameError, AssertionError, ZeroDivisionError, MemoryError)
OURS += (RecursionError, OverflowError, FloatingPointError, NotImplementedError)
ORIGINALS: dict[str, bytes] = {}


class FuzzFindingError(Exception):
    """What is wrong although nothing raised."""


def curves(path: Path) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        known = curve.radius[np.isfinite(curve.radius)]
        fine = np.isfinite(curve.time).all() and (np.diff(curve.time) > 0).all() and (known > 0).all()
        if not fine or not all(isinstance(note, str) and "\n" not in note for note in curve.notes):
            raise FuzzFindingError(f"a curve that no curve may be: {curve!r}, {curve.notes}")
        for use in (
            lambda c=curve: (c.max_radius, c.collapse_times(), c.noise, c.strain_rate(), c.normalised(WATER)),
            lambda c=curve: c.resampled(1e-6, 100, allow_short=True),
            lambda c=curve: write_csv(path.with_suffix(".out"), c),
        ):
            with suppress(InputError):
                use()


def times(path: Path) -> None:
    groups, problems, *_ = collapse_times.read_groups([path], WATER)
    for group in groups:
        group.model_dump_json()
    for problem in problems:
        if str(path) not in problem:
            raise FuzzFindingError(f"a refusal without the file's name: {problem}")


def sweeps(path: Path) -> None:
    document.rheometry(read.read_sweeps(path), "x", command="x", date="", notes=[]).model_dump_json()


def pressure(path: Path) -> None:
    trace = read_trace(path)
    with suppress(InputError):
        Trace(*trace[:2])


def recipe(path: Path) -> None:
    found = read_recipe(path)
    found.settings()
    _ = found.problem.id, found.problem.prior.sample(2, 0)


def shards(path: Path) -> None:
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    shutil.copy(path, folder / "shard-00000.h5")
    data = dataset.load(folder)
    _ = data.sha256, data.failures, data.split(0)


def network(path: Path) -> None:
    """A model, or its card (.json)."""
    model = path.with_suffix(".onnx")
    if path.suffix == ".json":
        model.write_bytes(ORIGINALS["network.onnx"])
    else:
        path.with_suffix(".json").write_text(json.dumps(card_of(path.read_bytes())))
    Network(model)(np.ones((2, 100)))


TABLES = (curves, times, sweeps, pressure, published_values.read_references)
ROOMS: dict[str, tuple[Room, ...]] = {
    "csv": TABLES, "txt": TABLES, "xlsx": TABLES, "ods": TABLES[:3], "xls": TABLES[:3], "mat": TABLES[:3],
    "h5": TABLES[:2], "toml": (recipe,), "json": (cavirheo.load,), "onnx": (network,),
}  # fmt: skip
BOOKS = ("xlsx", "ods", "xls")  # which cost a process each: they come less often, and see two rooms


def rooms(name: str, number: int) -> tuple[Room, ...]:
    """The functions that take this kind of file."""
    found = {"shard-00000.h5": (shards,), "card.json": (network,)}.get(name, ROOMS[name.rpartition(".")[2]])
    return (curves, found[1 + number // 7 % (len(found) - 1)]) if name.endswith(BOOKS) else found


def named(number: int) -> str:
    """The valid file that this number is made from."""
    names = [name for name in ORIGINALS for _ in range(1 if name.endswith(BOOKS) else 3)]
    return names[number % len(names)]


def judged(room: Room, path: Path) -> tuple[str, str, str]:
    """(outcome, where, text): "read", "refused", or what is wrong."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        began, before = processor(), memory()
        outcome, where, why = outcome_of(room, path)
    if outcome not in FINE:
        return outcome, where, why
    if (took := processor() - began) > SECONDS:
        return "slow", room.__name__, f"{took:.1f} s of processor time"
    if (more := memory() - before) > MEMORY:
        return "memory", room.__name__, f"{more / 1e6:.0f} MB more"
    if mine := [one for one in caught if "cavirheo" in one.filename]:
        return "warning", f"{Path(mine[0].filename).name}:{mine[0].lineno}", str(mine[0].message)
    return outcome, where, why


def outcome_of(room: Room, path: Path) -> tuple[str, str, str]:
    """What the function says of the file, whatever it costs."""
    try:
        room(path)
    except (InputError, SolverError) as error:
        why, code = str(error), f"{room.__name__} {getattr(error, 'code', '')}"
        cause = error.__cause__ or error.__context__
        while isinstance(cause, InputError):
            cause = cause.__cause__ or cause.__context__
        if code.endswith("reading.damaged") and isinstance(cause, OURS) and made_here(cause):
            return "masked", place(cause), "".join(traceback.format_exception(cause))
        if str(path) not in why and str(path.with_suffix("")) not in why:
            return "nameless", code, why
        if len(why.strip().splitlines()) != 1 or any(ord(c) < 32 for c in why):
            return "not one clean line", code, why
        return "refused", "", why
    except FuzzFindingError as error:
        return "wrong", f"{room.__name__} {str(error)[:40]}", str(error)
    except Exception as error:
        return "traceback", place(error), traceback.format_exc()
    return "read", "", ""


def processor() -> float:
    """Seconds of processor time of this process and its children."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def made_here(error: BaseException) -> bool:
    """Whether our own line raised it, not a library that says so that the file is damaged."""
    return "/cavirheo/" in traceback.extract_tb(error.__traceback__)[-1].filename


def place(error: BaseException) -> str:
    """Type of an error and the last of our own lines that it came through."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if "/cavirheo/" in f.filename]
    return " ".join([type(error).__name__, *(f"{Path(f.filename).name}:{f.name}:{f.lineno}" for f in ours[-1:])])


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("-n", type=int, default=20_000)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--first", type=int, default=0, help="number of the first file")
    asked.add_argument("--workers", type=int, default=os.cpu_count())
    asked.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    asked.add_argument("--kinds", default="", help="endings with commas; of others nothing is made")
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        ORIGINALS.update(originals(Path(folder)))
    counts, places = Counter[str](), Counter[str]()

    def file(number: int) -> Path:
        return given.out / f"seed-{given.seed}" / str(number) / f"file.{named(number).rpartition('.')[2]}"

    def judge(number: int) -> list[Finding]:
        path = file(number)
        shutil.rmtree(path.parent, ignore_errors=True)  # left by a run that was stopped
        path.parent.mkdir(parents=True)
        path.write_bytes(mutated(named(number), ORIGINALS[named(number)], given.seed, number))
        return [(room.__name__, *judged(room, path)) for room in rooms(named(number), number)]

    log = given.out / f"done-{given.seed}.txt"  # a stopped run goes on where it was
    given.out.mkdir(parents=True, exist_ok=True)
    done = {*log.read_text().split()} if log.exists() else set()
    numbers = [number for number in range(given.first, given.first + given.n) if str(number) not in done]
    chosen = [number for number in numbers if named(number).endswith(tuple(given.kinds.split(",")))]
    for number, answer in each_apart(judge, chosen, 6 * SECONDS, given.workers):
        found = [("any", answer.outcome, "", answer.why)] if isinstance(answer, Ended) else answer
        counts.update(f"{room}: {outcome}" for room, outcome, *_ in found)
        report = ""
        for room, outcome, where, why in found:
            key = f"{outcome} | {room} | {where}"
            places[key] += outcome not in FINE
            if outcome not in FINE and places[key] <= 3:  # of each finding three files are kept
                report += f"{named(number)}, seed {given.seed}, number {number}\n{key}\n{why}\n"
                print(f"{key}  ({named(number)}, {file(number)})", flush=True)
        if report:
            file(number).with_name("found.txt").write_text(report)
        else:
            shutil.rmtree(file(number).parent, ignore_errors=True)
        with log.open("a") as kept:
            kept.write(f"{number}\n")
    print(*(f"{n:6d}  {key}" for key, n in sorted(counts.items())), sep="\n")
    print(*(f"{n:6d}  {key}" for key, n in places.most_common() if n), sep="\n")
    return int(any(places.values()))


if __name__ == "__main__":
    sys.exit(main())
