"""Seconds per curve of `--verify full`, fit included, on all cores.

    python benchmarks/verify.py [-n 10] [--noise 0.01] [--real DIR] [--every 3]

The shots of benchmarks/fit.py, one after the other, as `cavirheo fit --verify full` answers them by default; --real:
every third (--every) curve found below a folder instead. Beside the wall time stands the processor time over the
cores: where other work keeps the machine busy, the second is what an idle one would need at least.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
from cavirheo.inference.verify import verify
from fit import cases, sets_below

from cavirheo.inference import fit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=10)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--real", type=Path, default=None)
    parser.add_argument("--every", type=int, default=3)
    given = parser.parse_args()
    if given.real:
        curves = [curve for _, found, _ in sets_below(given.real) for curve in found][:: given.every]
    else:
        curves = [case.noisy(given.noise, number) for number, case in enumerate(cases(given.n, 1))]
    bubble = "real" if given.real else "field"  # as the shots are
    verify(curves[0], fit(curves[0], bubble=bubble))  # compiles
    cores, rows, without = os.cpu_count() or 1, [], 0
    for curve in curves:
        began, spent = time.perf_counter(), time.process_time()
        fitted = fit(curve, bubble=bubble)
        middle = time.perf_counter()
        answer = verify(curve, fitted)
        end = time.perf_counter()
        if answer.checks.verdict == "failed":
            continue
        processor = (time.process_time() - spent) / cores
        rows.append((middle - began, end - began, processor, (answer.diagnostics.simulations or 0)))
        without += answer.interval("shear_modulus") is None
    print(f"{len(rows)} of {len(curves)} curves answered, {without} of them without an interval; {cores} cores")
    names = ("fit, s", "fit and verification, s", "the same, processor time over cores, s", "simulations to verify")
    for name, values in zip(names, np.array(rows).T, strict=True):
        low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
        print(f"{name}: median {middle:.2f}, 5 % {low:.2f}, 95 % {high:.2f}")


if __name__ == "__main__":
    main()
