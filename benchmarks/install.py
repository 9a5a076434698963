"""How long the package takes to start, and how large its installation is.

python benchmarks/install.py [runs]    (default: 30), with the Python of the environment that is to be measured
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from importlib.metadata import Distribution, distribution

from packaging.requirements import Requirement

PROGRAM = [sys.executable, "-m", "cavirheo"]
STARTS = {  # what is timed as a whole process
    "start of Python alone": [sys.executable, "-c", "pass"],
    "`cavirheo --version`": [*PROGRAM, "--version"],
    "`cavirheo --help`": [*PROGRAM, "--help"],
    "`cavirheo infer --help`": [*PROGRAM, "infer", "--help"],
    "`cavirheo --version --verbose`": [*PROGRAM, "--version", "--verbose"],
}
IMPORT = """
import time
began, used = time.perf_counter(), time.process_time()
import cavirheo
print(time.perf_counter() - began, time.process_time() - used)
"""


def imported() -> tuple[float, float]:
    """Milliseconds (wall, processor) of `import cavirheo` in a new process, without the start of Python."""
    said = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True).stdout.split()
    return 1e3 * float(said[0]), 1e3 * float(said[1])


def started(command: list[str]) -> tuple[float, float]:
    """Milliseconds (wall, processor) of a whole process."""
    began, used = time.perf_counter(), processor()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return 1e3 * (time.perf_counter() - began), 1e3 * (processor() - used)


def processor() -> float:
    """Seconds of all processes that were begun and have ended."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def best(times: Iterable[tuple[float, float]]) -> list[str]:
    """The least wall and the least processor time."""
    return [f"{min(column):.0f}" for column in zip(*times, strict=True)]


def needed(name: str = "cavirheo") -> dict[str, Distribution]:
    """The distribution and all that it needs without an extra, each once."""
    found: dict[str, Distribution] = {}

    def add(name: str) -> None:
        if name.lower() in found:
            return
        one = found[name.lower()] = distribution(name)
        for wanted in map(Requirement, one.requires or ()):
            if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
                add(wanted.name)

    add(name)
    return found


def sizes(one: Distribution) -> tuple[float, float, float]:
    """MB of all its files, of those that Python compiled (.pyc), and of its own tests."""
    files = [path for path in one.files or () if path.locate().exists()]
    mb = {path: path.locate().stat().st_size / 1e6 for path in files}
    compiled = sum(size for path, size in mb.items() if path.suffix == ".pyc")
    return sum(mb.values()), compiled, sum(size for path, size in mb.items() if "tests" in path.parts)


def table(head: list[str], rows: list[list[str]]) -> Iterator[str]:
    yield from (f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def main(words: list[str]) -> None:
    runs = int(words[0]) if words else 30
    rows = [["`import cavirheo`, without the start of Python", *best(imported() for _ in range(runs))]]
    rows += [[name, *best(started(words) for _ in range(runs))] for name, words in STARTS.items()]
    print(*table([f"what (best of {runs})", "ms", "ms of a processor"], rows), sep="\n")
    found = {name: sizes(one) for name, one in needed().items()}
    ordered = sorted(found.items(), key=lambda item: -item[1][0])
    large = [(name, mb) for name, mb in ordered if mb[0] >= 5]
    small = [mb for name, mb in ordered if mb[0] < 5]
    listed = [*large, (f"{len(small)} others", _sum(small)), ("together", _sum([*found.values()]))]
    print()
    rows = [[name, *(f"{size:.0f}" for size in mb)] for name, mb in listed]
    print(*table(["library", "MB", "of these .pyc", "of these its tests"], rows), sep="\n")


def _sum(sizes: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    return sum(s[0] for s in sizes), sum(s[1] for s in sizes), sum(s[2] for s in sizes)


if __name__ == "__main__":
    main(sys.argv[1:])
