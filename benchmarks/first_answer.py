"""How long a new user waits for the first answer: what README says, step by step, in an environment made for it.

    python benchmarks/first_answer.py [--mat SHOT.mat]

Each step's time on the clock and of the processors (of this step alone, and of what it starts). On a busy machine the
second is the one to compare; what is downloaded counts on the clock alone.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
VIDEO = "infer {examples}/bubble.mp4 --fps 500000 --um-per-px 4 -o by-video"


class Step(NamedTuple):
    """s on the clock and of the processors; MB on the disk of what is then installed, 0 of other steps."""

    name: str
    clock: float
    processors: float
    installed: float


def timed(words: list[str], folder: Path) -> tuple[float, float]:
    """s on the clock and of the processors; what is compiled is kept in the folder, so nothing of an earlier run."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    surroundings = os.environ | {"NUMBA_CACHE_DIR": str(folder / "compiled")}
    surroundings.pop("PYTHONPATH", None)
    done = subprocess.run(words, cwd=folder, env=surroundings, capture_output=True, text=True)
    after, clock = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began
    if done.returncode > 1:
        sys.exit(f"{words}: {done.stdout}{done.stderr}")
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def size(folder: Path) -> float:
    """MB on the disk."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def steps(folder: Path, shot: Path = ROOT / "examples" / "stiff_gel.mat") -> Iterator[Step]:
    """Each step as it is done, in this empty folder."""
    program = str(folder / "new" / "bin" / "cavirheo")
    pip = [str(folder / "new" / "bin" / "pip"), "install", "--quiet", "--disable-pip-version-check"]
    pip += ["-c", str(ROOT / "constraints.txt")]
    recording = VIDEO.format(examples=ROOT / "examples").split()
    for name, words in {
        "python3 -m venv": [sys.executable, "-m", "venv", "new"],
        "pip install .": [*pip, str(ROOT)],
        "infer, first time": [program, "infer", str(shot), "-o", "first"],
        "infer, second time": [program, "infer", str(shot), "-o", "second"],
        'pip install ".[plot,video]"': [*pip, f"{ROOT}[plot,video]"],
        "infer of a recording, first time": [program, *recording],
        "infer of a recording, second time": [program, *recording[:-1], "again"],
    }.items():
        spent = timed(words, folder)
        yield Step(name, *spent, size(folder / "new") if words[0] == pip[0] else 0.0)


def main() -> None:
    take = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    take.add_argument("--mat", type=Path, default=ROOT / "examples" / "stiff_gel.mat")
    shot = take.parse_args().mat.absolute()
    with tempfile.TemporaryDirectory() as folder:
        print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
        print("| step | clock, s | processors, s | MB |")
        print("|---|---|---|---|")
        for step in steps(Path(folder), shot):
            installed = f"{step.installed:.0f}" if step.installed else ""
            print(f"| {step.name} | {step.clock:.0f} | {step.processors:.0f} | {installed} |", flush=True)
        print("\n" + (Path(folder) / "by-video" / "result.csv").read_text("utf-8").splitlines()[1][:200])


if __name__ == "__main__":
    main()
