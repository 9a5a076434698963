"""Mutated files through the functions that read files, in processes of their own: `python tests/nightly/fuzz.py`.

File k of seed s is the same on every machine. What is not a clean refusal is kept in the output folder with a report
beside it: a traceback, a crash, a hang, too much memory, a warning, numbers that no curve may hold, a refusal that
hides a mistake of ours ("masked") or that does not name the file.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import numpy as np
from apart import Ended, each_apart
from mutate import mutated, originals
from rooms import FINE, PYTHON, program
from valid import card_of

from cavirheo.inference.model import Network

SECONDS = 20.0  # of processor time a file may take
MEMORY = 1 << 30  # bytes a file may add
Finding = tuple[str, str, str]  # room, outcome, text
ORIGINALS: dict[str, bytes] = {}


def network(name: str) -> None:
    """A model, or its card (.json)."""
    path = Path(name)
    model = path.with_suffix(".onnx")
    if path.suffix == ".json":
        model.write_bytes(ORIGINALS["network.onnx"])
    else:
        path.with_suffix(".json").write_text(json.dumps(card_of(path.read_bytes())))
    Network(model)(np.ones((2, 100)))


PYTHON["Python network"] = network
TABLES = ("read_curves", "times", "sweeps", "pressure", "references")
ROOMS = {
    "csv": TABLES, "txt": TABLES, "xlsx": TABLES, "ods": TABLES[:3], "xls": TABLES[:3], "mat": TABLES[:3],
    "h5": TABLES[:2], "toml": ("recipe",), "json": ("load",), "onnx": ("network",),
    "shard-00000.h5": ("load_folder",), "card.json": ("network",),
}  # fmt: skip
BOOKS = ("xlsx", "ods", "xls")  # which cost a process each: they come less often, and see two rooms


def rooms(name: str, number: int) -> tuple[str, ...]:
    """The functions that take this kind of file."""
    found = ROOMS.get(name) or ROOMS[name.rpartition(".")[2]]
    return (found[0], found[1 + number // 7 % (len(found) - 1)]) if name.endswith(BOOKS) else found


def named(number: int) -> str:
    """The valid file that this number is made from."""
    names = [name for name in ORIGINALS for _ in range(1 if name.endswith(BOOKS) else 3)]
    return names[number % len(names)]


def judged(room: str, path: Path) -> Finding:
    """What a function says of a file, and what is wrong with the cost of an answer or of a refusal."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        began, before = processor(), memory()
        outcome, text = program(f"Python {room}", str(path))
    if outcome not in FINE:
        return room, outcome, text
    if (took := processor() - began) > SECONDS:
        return room, "slow", f"{took:.1f} s of processor time"
    if (more := memory() - before) > MEMORY:
        return room, "memory", f"{more / 1e6:.0f} MB more"
    mine = [f"{one.filename}:{one.lineno} {one.message}" for one in caught if "cavirheo" in one.filename]
    return (room, "warning", mine[0]) if mine else (room, outcome, text)


def processor() -> float:
    """Seconds of processor time of this process and its children."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def place(text: str) -> str:
    """The last of our own lines that a traceback came through, or how the text ends."""
    ours = re.findall(r'cavirheo/(\S+)", line (\d+)', text)
    return ":".join(ours[-1]) if ours else text.strip()[-60:]


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
        return [judged(room, path) for room in rooms(named(number), number)]

    log = given.out / f"done-{given.seed}.txt"  # a stopped run goes on where it was
    given.out.mkdir(parents=True, exist_ok=True)
    done = {*log.read_text().split()} if log.exists() else set()
    numbers = [number for number in range(given.first, given.first + given.n) if str(number) not in done]
    chosen = [number for number in numbers if named(number).endswith(tuple(given.kinds.split(",")))]
    for number, answer in each_apart(judge, chosen, 6 * SECONDS, given.workers):
        found = [("any", answer.outcome, answer.why)] if isinstance(answer, Ended) else answer
        counts.update(f"{room}: {outcome}" for room, outcome, _ in found)
        report = ""
        for room, outcome, why in found:
            key = f"{outcome} | {room} | {place(why)}"
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
