"""Mutated files through the rooms that take files, in processes of their own: `python tests/nightly/fuzz.py`.

File k of seed s is the same on every machine. What is not a clean refusal is kept in the output folder as
`KIND-s-k.ENDING` with a report beside it: a traceback, a crash, a hang, too much memory, a warning, numbers that no
curve may hold, a refusal that hides a mistake of ours ("masked") or that does not name the file. A stopped run goes on
where it was.
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

SECONDS = 20.0  # of processor time a file may take
MEMORY = 1 << 30  # bytes a file may add
Finding = tuple[str, str, str, str]  # room, outcome, where, text
FINE = ("read", "refused")
OURS = (AttributeError, TypeError, IndexError, KeyError, NameError, AssertionError, ZeroDivisionError, MemoryError)
OURS += (RecursionError, OverflowError, FloatingPointError, NotImplementedError)


class FuzzFindingError(Exception):
    """What is wrong although nothing raised."""


def curves(path: Path) -> None:
    from cavirheo import read_curves
    from cavirheo.io import write_csv
    from cavirheo.physics.media import WATER

    for curve in read_curves(path)[:20]:
        known = curve.radius[np.isfinite(curve.radius)]
        fine = np.isfinite(curve.time).all() and (np.diff(curve.time) > 0).all() and (known > 0).all()
        if not fine or not all(isinstance(note, str) and "\n" not in note for note in curve.notes):
            raise FuzzFindingError(f"a curve that no curve may be: {curve!r}, {curve.notes}")
        repr(curve)
        refusing(
            lambda c=curve: (c.max_radius, c.collapse_times(), c.noise, c.strain_rate(), c.normalised(WATER)),
            lambda c=curve: c.resampled(1e-6, 100, allow_short=True),
            lambda c=curve: write_csv(path.with_suffix(".out"), c),
        )


def refusing(*calls: Callable[[], object]) -> None:
    from cavirheo.errors import InputError

    for call in calls:
        with suppress(InputError):
            call()


def collapse_times(path: Path) -> None:
    from cavirheo.companions.collapse_times import read_groups
    from cavirheo.physics.media import WATER

    groups, problems, *_ = read_groups([path], WATER)
    for group in groups:
        group.model_dump_json()
    said(path, problems)


def said(path: Path, problems: list[str]) -> None:
    for problem in problems:
        if str(path) not in problem:
            raise FuzzFindingError(f"a refusal without the file's name: {problem}")


def sweeps(path: Path) -> None:
    from cavirheo.companions import rheometer as read
    from cavirheo.companions import rheometer_document as document

    made = document.rheometry(read.read_sweeps(path), "x", command="x", date="", notes=[])
    made.model_dump_json()


def pressure(path: Path) -> None:
    from cavirheo.io.option_tables import read_trace
    from cavirheo.physics.driving import Trace

    trace = read_trace(path)
    refusing(lambda: Trace(*trace[:2]))


def references(path: Path) -> None:
    from cavirheo.companions.published_values import read_references

    read_references(path)


def recipe(path: Path) -> None:
    from cavirheo.training.recipe import read_recipe

    read = read_recipe(path)
    read.settings()
    _ = read.problem.id, read.problem.prior.sample(2, 0)


def document(path: Path) -> None:
    import cavirheo

    cavirheo.load(path)


def shards(path: Path) -> None:
    from cavirheo.training.dataset import load

    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    shutil.copy(path, folder / "shard-00000.h5")
    data = load(folder)
    _ = data.sha256, data.failures, data.split(0)


def network(path: Path) -> None:
    from cavirheo.inference.model import Network

    card = path.with_suffix(".json")
    if path.suffix == ".json":  # the card is what is damaged
        model = path.with_suffix(".onnx")
        model.write_bytes(ORIGINALS["network.onnx"])
    else:
        model = path
        card.write_text(json.dumps(card_of(path.read_bytes())))
    Network(model)(np.ones((2, 100)))


TABLES = (curves, collapse_times, sweeps, pressure, references)
ROOMS: dict[str, tuple[Callable[[Path], None], ...]] = {
    "csv": TABLES, "txt": TABLES, "xlsx": TABLES, "ods": TABLES[:3], "xls": TABLES[:3],
    "mat": (curves, collapse_times, sweeps), "h5": (curves, collapse_times), "toml": (recipe,), "json": (document,),
    "onnx": (network,),
}  # fmt: skip
ORIGINALS: dict[str, bytes] = {}


def rooms(name: str, number: int) -> tuple[Callable[[Path], None], ...]:
    """The rooms that take this kind of file; of workbooks, which cost a process each time, two of them."""
    found = {"shard-00000.h5": (shards,), "card.json": (network,)}.get(name, ROOMS[name.rpartition(".")[2]])
    return (curves, found[1 + number // 7 % (len(found) - 1)]) if name.endswith(("xlsx", "ods", "xls")) else found


def named(number: int) -> str:
    """Workbooks cost a process each, so they come less often than the others."""
    kinds = [name for name in ORIGINALS for _ in range(1 if name.endswith(("xlsx", "ods", "xls")) else 3)]
    return kinds[number % len(kinds)]


def judged(room: Callable[[Path], None], path: Path) -> tuple[str, str, str]:
    """(outcome, where, text): "read", "refused", or what is wrong."""
    from cavirheo.errors import InputError, SolverError

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        began, before = processor(), memory()
        try:
            room(path)
            outcome, where, why = "read", "", ""
        except (InputError, SolverError) as error:
            outcome, where, why = "refused", "", str(error)
            cause = error.__cause__ or error.__context__
            while isinstance(cause, InputError):
                cause = cause.__cause__ or cause.__context__
            if getattr(error, "code", "") == "reading.damaged" and isinstance(cause, OURS) and made_here(cause):
                outcome, where, why = "masked", place(cause), "".join(traceback.format_exception(cause))
            elif str(path) not in why and str(path.with_suffix("")) not in why:
                outcome, where = "nameless", room.__name__ + " " + getattr(error, "code", "")
            elif len(why.strip().splitlines()) != 1 or any(ord(c) < 32 for c in why):
                outcome, where = "not one clean line", room.__name__ + " " + getattr(error, "code", "")
        except FuzzFindingError as error:
            outcome, where, why = "wrong", room.__name__ + " " + str(error)[:40], str(error)
        except Exception as error:
            outcome, where, why = "traceback", place(error), traceback.format_exc()
    if outcome in ("read", "refused"):
        if (took := processor() - began) > SECONDS:
            return "slow", room.__name__, f"{took:.1f} s of processor time"
        if (more := memory() - before) > MEMORY:
            return "memory", room.__name__, f"{more / 1e6:.0f} MB more"
        mine = [w for w in caught if "cavirheo" in w.filename]
        if mine:
            return "warning", f"{Path(mine[0].filename).name}:{mine[0].lineno}", str(mine[0].message)
    return outcome, where, why


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
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "/cavirheo/" in f.filename]
    last = frames[-1] if frames else None
    return (
        f"{type(error).__name__} {Path(last.filename).name}:{last.name}:{last.lineno}" if last else type(error).__name__
    )


class Fuzzing:
    """One run: which files are done, what was found."""

    def __init__(self, seed: int, out: Path) -> None:
        self.seed, self.out = seed, out
        self.files = out / f"seed-{seed}"
        self.files.mkdir(parents=True, exist_ok=True)
        self.state = out / f"state-{seed}.json"
        self.done: set[int] = set(json.loads(self.state.read_text())) if self.state.exists() else set()
        self.counts: Counter[str] = Counter()
        self.places: Counter[str] = Counter()

    def file(self, number: int) -> Path:
        """Where the file with this number is while it is in work, and where it stays if something was found."""
        return self.files / str(number) / f"file.{named(number).rpartition('.')[2]}"

    def judge(self, number: int) -> list[Finding]:
        """One mutated file in all rooms that take its kind."""
        path = self.file(number)
        shutil.rmtree(path.parent, ignore_errors=True)  # left by a run that was stopped
        path.parent.mkdir()
        path.write_bytes(mutated(named(number), ORIGINALS[named(number)], self.seed, number))
        return [(room.__name__, *judged(room, path)) for room in rooms(named(number), number)]

    def take(self, number: int, found: list[Finding]) -> None:
        """What the rooms said of one file; of each finding three files are kept."""
        self.done.add(number)
        path, kept = self.file(number), False
        for room, outcome, where, why in found:
            self.counts[f"{room}: {outcome}"] += 1
            if outcome in FINE:
                continue
            key = f"{outcome} | {room} | {where}"
            self.places[key] += 1
            if self.places[key] <= 3:
                kept = True
                with path.with_name("found.txt").open("a") as report:
                    report.write(f"{named(number)}, seed {self.seed}, number {number}\n{key}\n{why}\n")
                print(f"{key}  ({named(number)}, {path})", flush=True)
        if not kept:
            shutil.rmtree(path.parent, ignore_errors=True)

    def run(self, todo: list[int], workers: int | None) -> None:
        for count, (number, found) in enumerate(each_apart(self.judge, todo, 6 * SECONDS, workers), 1):
            self.take(number, [("any", found.outcome, "", found.why)] if isinstance(found, Ended) else found)
            if count % 500 == 0 or count == len(todo):
                self.state.write_text(json.dumps(sorted(self.done)))
        print(*(f"{n:6d}  {key}" for key, n in sorted(self.counts.items())), sep="\n")
        print(*(f"{n:6d}  {key}" for key, n in self.places.most_common()), sep="\n")


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("-n", type=int, default=20_000)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--workers", type=int, default=os.cpu_count())
    asked.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    asked.add_argument("--kinds", default="", help="endings with commas; of others nothing is made")
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        ORIGINALS.update(originals(Path(folder)))
    fuzzing, kinds = Fuzzing(given.seed, given.out), tuple(given.kinds.split(","))
    numbers = range(given.first, given.first + given.n)
    fuzzing.run([k for k in numbers if k not in fuzzing.done and named(k).endswith(kinds)], given.workers)
    sys.exit(bool(fuzzing.places))


if __name__ == "__main__":
    main()
