"""Runs named claims and writes each number as JSON: value, unit, n, standard error, seed, commit, processor, seconds.

    python -m validation [CLAIM ...] [--full] [-o build/validate.json]

Without names every claim runs, in some minutes; --full takes as many cases as a published number needs. A claim that is
not run keeps its numbers in the file.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo import Medium, NeoHookeanKelvinVoigt, simulate
from cavirheo.physics.accuracy import DEFAULT, Accuracy
from validation.challenge import answers, make, run_cavirheo, score, truth

ROOT = Path(__file__).resolve().parents[1]
SEED = 1
FINE = Accuracy(1024, 1e-8)
END = 4.0  # t_c of the curves that are compared


@dataclass(frozen=True)
class Number:
    """One headline number. standard_error: of the value over the n cases."""

    name: str
    value: float
    unit: str
    n: int
    standard_error: float
    seed: int = SEED


def median(name: str, values: np.ndarray, unit: str) -> Number:
    """The median, with the standard error of 1,000 resamples."""
    again = np.random.default_rng(SEED).choice(values, (1000, len(values)))
    error = float(np.std(np.median(again, axis=1)))
    return Number(name, float(np.median(values)), unit, len(values), error)


def share(name: str, held: int, n: int) -> Number:
    """Of intervals that hold the truth; the standard error is that of a program whose intervals are right."""
    return Number(name, held / n, "1", n, float(np.sqrt(score.LEVEL * (1 - score.LEVEL) / n)))


def gels(n: int) -> Iterator[tuple[truth.Truth, NeoHookeanKelvinVoigt, Medium]]:
    """Gels of the challenge's ranges with the field's bubble."""
    for number in range(n):
        one = truth.draw(np.random.default_rng([SEED, number, 2]), "field", "nhkv")
        yield one, NeoHookeanKelvinVoigt(one.G, one.mu), Medium(density=one.density)


def solver(full: bool) -> Iterator[Number]:
    """Of the default accuracy: largest difference of R/R_max to 1024 shells, processor time, and RMS difference to the
    second solver (validation/field_standard.py)."""
    at, errors, spent, apart = np.linspace(0.0, END, 400), [], [], []
    cases = list(gels(60 if full else 12))
    for number, (one, law, medium) in enumerate(cases):
        how = {"max_radius": one.R_max, "stretch": one.stretch, "time": at * one.t_c, "medium": medium}
        simulate(law, **how, accuracy=DEFAULT)
        began = time.process_time()
        default = simulate(law, **how, accuracy=DEFAULT).radius / one.R_max
        spent.append(1e3 * (time.process_time() - began))
        errors.append(float(np.max(np.abs(default - simulate(law, **how, accuracy=FINE).radius / one.R_max))))
        if number < len(cases) // 3:
            apart.append(float(np.sqrt(np.mean((truth.solve(one, END + 0.1)(at) - default) ** 2))))
    yield median("solver: largest error of R/R_max", np.array(errors), "R_max")
    yield median("solver: processor time of a curve", np.array(spent), "ms")
    yield median("solver: RMS difference to the second solver", np.array(apart), "R_max")


def challenge(full: bool) -> Iterator[Number]:
    """Coverage and width of `cavirheo infer` on the recordings of validation/challenge."""
    with TemporaryDirectory() as folder:
        make.make(Path(folder), SEED, 60 if full else 12)
        rows = [
            {"name": one.name, **run_cavirheo.answer(one, ["infer"])}
            for one in answers.read(Path(folder) / "recordings")
        ]
        truths = score.read(Path(folder) / "truth.csv")
    for quantity in score.QUANTITIES:
        for half in truth.HALVES:
            mine = [row for row in truths if row["half"] == half]
            named = [row for row in rows if row["name"] in {one["name"] for one in mine}]
            judged = [one for one in score.judge(mine, named, quantity) if one.bounded]
            if judged:
                words = f"challenge: 90 % intervals of {quantity}, {half} bubble"
                yield share(f"{words}, share that hold", sum(one.held for one in judged), len(judged))
                yield median(f"{words}, width", np.array([one.width for one in judged]), "decades")


CLAIMS: dict[str, Callable[[bool], Iterator[Number]]] = {"solver": solver, "challenge": challenge}


def commit() -> str:
    """Of the repository, with a + where files have changed since."""
    words = ["git", "-C", str(ROOT), "describe", "--always", "--dirty=+", "--exclude=*"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def processor() -> str:
    table = Path("/proc/cpuinfo")
    lines = table.read_text("utf-8").splitlines() if table.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("claims", nargs="*", metavar="CLAIM", help=", ".join(CLAIMS))
    parser.add_argument("--full", action="store_true")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "build" / "validate.json")
    given = parser.parse_args()
    unknown = set(given.claims) - set(CLAIMS)
    if unknown:
        parser.error(f"unknown claims {', '.join(sorted(unknown))}; known: {', '.join(CLAIMS)}")
    found = json.loads(given.out.read_text("utf-8")) if given.out.exists() else {}
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for name in given.claims or CLAIMS:
        began = time.perf_counter()
        numbers = list(CLAIMS[name](given.full))
        where = {"commit": commit(), "processor": processor(), "full": given.full}
        where["seconds"] = round(time.perf_counter() - began, 1)
        found[name] = {**where, "numbers": [asdict(number) for number in numbers]}
        given.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        for number in numbers:
            print(f"{number.name}: {number.value:.3g} ± {number.standard_error:.2g} {number.unit} (n = {number.n})")


if __name__ == "__main__":
    main()
