"""How long the report takes beside the inference of the same curves, and how much memory: benchmarks/reporting.md.

python benchmarks/reporting.py [curves ...]    (default: 10 100 1000), each count in a process of its own
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory

from cavirheo import RadiusCurve, infer_many, read_curves
from cavirheo.physics.simulate import load_solver
from cavirheo.reporting import write_report

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
HEADS = ("curves", "inference s", "report s", "ratio", "report without PNG s", "report.html MB", "largest memory MB")


def shots(n: int) -> list[RadiusCurve]:
    """The shipped measurements over and over, each time under another name."""
    found = [*read_curves(EXAMPLES / "soft_gel.csv"), *read_curves(EXAMPLES / "stiff_gel.mat")]
    named = (replace(c, meta={**c.meta, "name": f"{c.name} {k}"}) for k in count(1) for c in found)
    return list(islice(named, n))


def measure(n: int) -> list[str]:
    """A row of the table."""
    load_solver()
    curves = shots(n)
    infer_many(curves[:2])  # what is loaded once does not count
    began = time.perf_counter()
    answers = infer_many(curves)
    inference = time.perf_counter() - began
    pairs = list(zip(curves, answers, strict=True))
    with TemporaryDirectory() as folder:
        write_report(folder, pairs[:1], "warm")
        began = time.perf_counter()
        write_report(folder, pairs, "benchmark")
        report = time.perf_counter() - began
        began = time.perf_counter()
        write_report(folder, pairs, "benchmark", ())
        page = time.perf_counter() - began
        size = Path(folder, "report.html").stat().st_size / 1e6
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row = f"{n}", f"{inference:.2f}", f"{report:.2f}", f"{report / inference:.2f}", f"{page:.2f}", f"{size:.1f}"
    return [*row, f"{memory:.0f}"]


def main(words: list[str]) -> None:
    if words[:1] == ["--one"]:
        print("|", " | ".join(measure(int(words[1]))), "|")
        return
    print("|", " | ".join(HEADS), "|\n|" + "---|" * len(HEADS), flush=True)
    for n in words or ["10", "100", "1000"]:
        subprocess.run([sys.executable, __file__, "--one", n], check=True)


if __name__ == "__main__":
    main(sys.argv[1:])
