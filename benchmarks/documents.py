"""How long the documents of thousands of answers take to write: result.json, table, report with its pictures.

    python benchmarks/documents.py [recordings] [of a group]

The answers are those of the ten shipped shots again and again, each with draws moved by 0.02 decades, so that no two
are alike. Prints wall time, processor time of this process and of the others, memory at its peak, and sizes.
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo import infer_many, read_curves
from cavirheo.reporting import write_report
from cavirheo.reporting.record import Pairs

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def answers(count: int, together: int) -> Pairs:
    curves = [*read_curves(EXAMPLES / "soft_gel.csv"), *read_curves(EXAMPLES / "stiff_gel.mat")]
    own = infer_many(curves, material="nhkv")
    known = [(c, replace(one, checks=replace(one.checks, verdict="ok"))) for c, one in zip(curves, own, strict=True)]
    rng, pairs = np.random.default_rng(0), []
    for k in range(count):
        curve, answer = known[k % len(known)]
        about = {"name": f"{curve.name} {k}", "group": f"group {k // together}", "source": f"{k // together}.csv"}
        theta = answer.theta + 0.02 * rng.standard_normal(answer.theta.shape[1])
        pairs.append((replace(curve, meta={**curve.meta, **about}), replace(answer, theta=theta)))
    return pairs


def main(count: int = 5000, together: int = 50) -> None:
    pairs = answers(count, together)
    with TemporaryDirectory() as folder:
        began, used = time.perf_counter(), time.process_time()
        write_report(folder, pairs, "benchmark")
        wall, here = time.perf_counter() - began, time.process_time() - used
        sizes = {path.name: path.stat().st_size / 1e6 for path in Path(folder).iterdir() if path.is_file()}
    there = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"{count} recordings in groups of {together}: {wall:.0f} s; processor {here:.0f} s and {there:.0f} s in others"
    )
    print(f"peak {peak:.2f} GB with all answers in memory; " + ", ".join(f"{k} {v:.1f} MB" for k, v in sizes.items()))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
