"""How long a new user waits for the first answer: what README says, step by step, in an environment made for it."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Step(NamedTuple):
    """s on the clock and of the processors; MB on the disk of what is then installed, 0 of other steps. What is
    downloaded counts on the clock alone; on a busy machine the processors' time is the one to compare."""

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


def steps(folder: Path) -> Iterator[Step]:
    """Each step as it is done, in this empty folder with a new environment."""
    venv.create(folder / "new", with_pip=True)
    program = str(folder / "new" / "bin" / "cavirheo")
    pip = [str(folder / "new" / "bin" / "pip"), "install", "--quiet", "--disable-pip-version-check"]
    pip += ["-c", str(ROOT / "constraints.txt")]
    video = ["infer", str(ROOT / "examples" / "bubble.mp4"), "--fps", "500000", "--um-per-px", "4", "-o", "by-video"]
    for name, words in {
        "install": [*pip, str(ROOT)],
        "first": [program, "infer", str(ROOT / "examples" / "stiff_gel.mat"), "-o", "first"],
        "extras": [*pip, f"{ROOT}[plot,video]"],
        "recording": [program, *video],
    }.items():
        spent = timed(words, folder)
        installed = sum(path.lstat().st_size for path in (folder / "new").rglob("*") if path.is_file()) / 1e6
        yield Step(name, *spent, installed if words[0] == pip[0] else 0.0)
