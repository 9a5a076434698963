"""How long the report takes beside the network's answers of the same curves, and how much memory.

python benchmarks/reporting.py [curves ...]    (default: 10 100 400 1000), each count in a process of its own
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cavirheo import RadiusCurve, infer_many, read_curves
from cavirheo.physics.simulate import load_solver
from cavirheo.reporting import write_report

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
HEADS = (
    "curves", "inference s", "report s", "ratio", "processor s of inference", "of the report", "report.html MB",
    "largest memory MB",
)  # fmt: skip


def shots(n: int) -> list[RadiusCurve]:
    """The shipped measurements over and over, each time under another name."""
    found = [*read_curves(EXAMPLES / "soft_gel.csv"), *read_curves(EXAMPLES / "stiff_gel.mat")]
    named = (replace(c, meta={**c.meta, "name": f"{c.name} {k}"}) for k in count(1) for c in found)
    return list(islice(named, n))


def measure(n: int) -> list[str]:
    """A row of the table."""
    load_solver()
    curves = shots(n)
    infer_many(curves[:2], model="bdt-viscoelastic")  # what is loaded once does not count
    (inference, thought), answers = timed(lambda: infer_many(curves, model="bdt-viscoelastic"))
    pairs = list(zip(curves, answers, strict=True))
    with TemporaryDirectory() as folder:
        write_report(folder, pairs[:1], "warm")
        (report, worked), _ = timed(lambda: write_report(folder, pairs, "benchmark", replace=True))
        size = Path(folder, "report.html").stat().st_size / 1e6
    row = f"{n}", f"{inference:.2f}", f"{report:.2f}", f"{report / inference:.2f}", f"{thought:.2f}", f"{worked:.2f}"
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return [*row, f"{size:.2f}", f"{memory:.0f}"]


def timed(work: Callable[[], Any]) -> tuple[tuple[float, float], Any]:
    """(wall, processor) seconds, and what it gave."""
    began = time.perf_counter(), processor()
    done = work()
    return (time.perf_counter() - began[0], processor() - began[1]), done


def processor() -> float:
    """Seconds of this process and of those that it began and that have ended."""
    return sum(os.times()[:4])


def main(words: list[str]) -> None:
    if words[:1] == ["--one"]:
        print("|", " | ".join(measure(int(words[1]))), "|")
        return
    print("|", " | ".join(HEADS), "|\n|" + "---|" * len(HEADS), flush=True)
    for n in words or ["10", "100", "400", "1000"]:
        subprocess.run([sys.executable, __file__, "--one", n], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
