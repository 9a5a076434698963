"""From start to answer: one simulated shot, and 20 in one call on all cores and on one; what a new user waits for.

Seconds are those of the clock, which the load of the machine makes longer; ratios are of one run. The part `newcomer`
installs the package in an empty environment, as README says, and runs where it is named alone: it takes minutes and
asks a package index.
"""

from __future__ import annotations

import os
import subprocess
import time
import venv
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo import infer_many
from validation.numbers import Number, Run, statistic
from validation.recordings import STREAM, recording

ROOT = Path(__file__).resolve().parents[2]
TOGETHER = 20
PARTS = ("newcomer",)


def seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def newcomer() -> Iterator[Number]:
    """Seconds to the first answer in a new environment, where all is compiled, and MB of what is installed."""
    with TemporaryDirectory() as folder:
        new = Path(folder, "new")
        venv.create(new, with_pip=True)
        pip = [new / "bin" / "pip", "install", "--quiet", "-c", ROOT / "constraints.txt"]
        infer = [new / "bin" / "cavirheo", "infer", ROOT / "examples" / "stiff_gel.mat", "-o", Path(folder, "first")]
        surroundings = os.environ | {"NUMBA_CACHE_DIR": str(Path(folder, "compiled"))}
        surroundings.pop("PYTHONPATH", None)
        for name, words in (("install", [*pip, ROOT]), ("first", infer), ("extras", [*pip, f"{ROOT}[plot,video]"])):
            run = partial(subprocess.run, words, env=surroundings, capture_output=True, check=name != "first")
            yield statistic(f"newcomer.{name}.seconds", [seconds(run)], "s")
            size = sum(path.lstat().st_size for path in new.rglob("*") if path.is_file()) / 1e6
            yield statistic(f"newcomer.{name}.size", [size], "MB")


def measure(run: Run) -> Iterator[Number]:
    if run.part == "newcomer":
        yield from newcomer()
        return
    made = [one for i in range(3 * TOGETHER) if (one := recording(i)) is not None][:TOGETHER]
    infer_many(made[:1])  # what is loaded once does not count
    for law, material in (("one_law", "nhkv"), ("one", None)):
        alone = [seconds(lambda one=one, m=material: infer_many([one], material=m, trust_input=True)) for one in made]
        yield statistic(f"{law}.seconds", alone, "s", seed=STREAM)
        yield statistic(f"{law}.seconds.95", alone, "s", partial(np.quantile, q=0.95), STREAM)
    together, on_one = (
        [seconds(lambda n=n: infer_many(made, trust_input=True, workers=n)) for _ in range(run.count(1, 5))]
        for n in (None, 1)
    )
    yield statistic("twenty.seconds", together, "s", seed=STREAM)
    yield statistic("twenty.ratio", np.array(together) / np.array(on_one), "1", seed=STREAM)
