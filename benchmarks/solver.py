"""Accuracy and speed of the forward solver, beside other ways to solve the same equations, in one run.

    python benchmarks/solver.py [--cases 60] [--peers 6] [--reference ../shared/reference/reference_curves.npz]

Cases are drawn from log10 G in [3, 6], log10 mu in [-3, 0], lambda in [3, 11], R_max in [60, 450] um, 100 us, 1 MHz.
Errors are the largest difference of R/R_max to the package's own solver at 1024 shells and 1e-8 a step (and, if the
file is there, to reference curves made with other code). Times per curve are processor times of the process, held on
one core; those of the batch call and of a fresh process are wall times.

The first `--peers` cases are also solved the field's standard way, 500 uniform nodes, mass fractions, scipy's BDF with
a sparse Jacobian at rtol 1e-6 (validation/field_standard.py), and by PyIMR where it can be imported (Python 3.12 or
newer; benchmarks/pyimr_peer.py).
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from cavirheo.physics.accuracy import DEFAULT, PRECISE, ROUGH, Accuracy
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.laws import PowerLaw, Yeoh
from cavirheo.physics.materials import Material, NeoHookeanKelvinVoigt, Viscoelastic, Zener
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.simulate import simulate, simulate_many

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from validation import field_standard

TIME = np.linspace(0, 100e-6, 101)
GENTLE = np.array([1e4, 0.5, 3.5, 200e-6])
CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
FINEST = Accuracy(1024, 1e-8)
SETTINGS = {
    f"cavirheo, {name} ({of.cells} shells, {of.relative_error:g} a step)": of
    for name, of in (("default", DEFAULT), ("rough", ROUGH), ("precise", PRECISE))
}
LAWS: dict[str, Callable[[float, float], Material]] = {
    "neo-Hookean and Newtonian, closed forms": NeoHookeanKelvinVoigt,
    "the same, tabulated by quadrature": lambda G, mu: Viscoelastic(Yeoh(G / 2), PowerLaw(mu, 1.0)),
    "neo-Hookean spring and upper-convected arm (Zener, tau 0.1 us), relaxed start": lambda G, mu: Zener(G, mu, 1e-7),
}
FIRST_CALL = """
import time
began = time.perf_counter()
from cavirheo import NeoHookeanKelvinVoigt, simulate
middle = time.perf_counter()
simulate(NeoHookeanKelvinVoigt(1e4, 0.05), max_radius=2e-4, stretch=6.0, time=[i * 1e-6 for i in range(101)])
print(middle - began, time.perf_counter() - middle, time.process_time())
"""


def use(cores: set[int]) -> None:
    if cores:
        os.sched_setaffinity(0, cores)


def draw(n: int, seed: int) -> np.ndarray:
    """(n, 4) G Pa, mu Pa s, lambda, R_max m."""
    theta = np.random.default_rng(seed).uniform([3, -3, 3, 60e-6], [6, 0, 11, 450e-6], (n, 4))
    theta[:, :2] = 10 ** theta[:, :2]
    return theta


def ours(
    row: np.ndarray, accuracy: Accuracy = DEFAULT, medium: Medium = WATER, time_points: np.ndarray = TIME
) -> np.ndarray:
    G, mu, stretch, R_max = row
    gel = NeoHookeanKelvinVoigt(G, mu)
    run = simulate(gel, max_radius=R_max, stretch=stretch, time=time_points, medium=medium, accuracy=accuracy)
    return run.radius / R_max


def standard(row: np.ndarray) -> np.ndarray:
    G, mu, stretch, R_max = row
    numbers = dimensionless(NeoHookeanKelvinVoigt(G, mu), WATER, R_max, stretch)
    t_c = WATER.time_scale(R_max)
    nodes = np.linspace(0, 1, 500)
    material = field_standard.neo_hookean(G / WATER.pressure), field_standard.newtonian(mu / (WATER.pressure * t_c))
    return field_standard.solve(numbers, nodes, TIME / t_c, 1e-6, *material)


def timed(call: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """The value and the processor time it took, s: on one core other work disturbs that less than wall time."""
    began = time.process_time()
    value = call()
    return value, time.process_time() - began


def header() -> None:
    print("| way | error median | largest | ms median | ms 95 % | curves/s | curves |\n|---|---|---|---|---|---|---|")


def show(name: str, errors: list[float], seconds: list[float], of: int | None = None) -> None:
    e, t = np.array(errors), 1e3 * np.array(seconds)
    count = f"{len(e)}" if of is None else f"{len(e)} of {of}"
    numbers = f"{np.median(t):.3g} | {np.percentile(t, 95):.3g} | {1e3 / t.mean():.3g}"
    print(f"| {name} | {np.median(e):.1e} | {e.max():.1e} | {numbers} | {count} |", flush=True)


def compare(name: str, solve: Callable[[np.ndarray], np.ndarray], cases: np.ndarray, truth: list[np.ndarray]) -> None:
    runs = [timed(lambda row=row: solve(row)) for row in cases]
    show(name, [np.abs(run - t).max() for (run, _), t in zip(runs, truth, strict=True)], [s for _, s in runs])


def accuracy(cases: np.ndarray, truth: list[np.ndarray]) -> None:
    header()
    for name, setting in SETTINGS.items():
        compare(name, lambda row, setting=setting: ours(row, setting), cases, truth)


def contents(cases: np.ndarray) -> None:
    """What condensation at a finite rate costs: errors against 600 shells at 1e-7 a step, and times in turn, least of
    three, over those of equilibrium."""
    print("\n| contents | accommodation | error median | largest | steps | time |\n|---|---|---|---|---|---|")
    ways = {"equilibrium": FIELD} | {f"kinetic | {a:g}": Bubble("kinetic", a) for a in (0.01, 0.07, 1.0)}
    seconds, steps = np.zeros((len(ways), len(cases))), np.zeros((len(ways), len(cases)))
    errors = np.zeros((len(ways), len(cases)))
    for j, (G, mu, stretch, R_max) in enumerate(cases):
        gel, where = NeoHookeanKelvinVoigt(G, mu), dict(max_radius=R_max, stretch=stretch, time=TIME)
        turns = np.zeros((3, len(ways)))
        for turn, (i, bubble) in ((k, pair) for k in range(3) for pair in enumerate(ways.values())):
            began = time.thread_time()
            run = simulate(gel, bubble=bubble, **where)
            turns[turn, i] = time.thread_time() - began
            if turn == 0:
                fine = simulate(gel, bubble=bubble, accuracy=Accuracy(600, 1e-7), **where)
                errors[i, j] = np.abs(run.radius - fine.radius).max() / R_max
                steps[i, j] = run.stats["steps"] + run.stats["rejected"]
        seconds[:, j] = turns.min(axis=0)
    for i, name in enumerate(ways):
        cells = f"{np.median(errors[i]):.1e} | {errors[i].max():.1e} | {steps[i].mean():.0f}"
        print(f"| {name if i else name + ' |'} | {cells} | {seconds[i].sum() / seconds[0].sum():.2f} |", flush=True)


def laws(cases: np.ndarray) -> None:
    """What a law costs: processor time of the cases together, over that of the closed forms, least of three."""
    print("\n| law | time | largest difference of R/R_max |\n|---|---|---|")
    first: tuple[float, list[np.ndarray]] | None = None
    for name, make in LAWS.items():
        made = [(make(G, mu), stretch, R_max) for G, mu, stretch, R_max in cases]

        def run(made: list = made) -> list[np.ndarray]:
            ways = (dict(max_radius=R_max, stretch=stretch, time=TIME, relaxed=True) for _, stretch, R_max in made)
            return [simulate(m, **way).radius / way["max_radius"] for (m, _, _), way in zip(made, ways, strict=True)]

        run()  # makes the tables, which are kept
        curves, seconds = min((timed(run) for _ in range(3)), key=lambda pair: pair[1])
        first = first or (seconds, curves)
        gap = max(np.abs(a - b).max() for a, b in zip(curves, first[1], strict=True))
        print(f"| {name} | {seconds / first[0]:.2f} | {f'{gap:.1e}' if 'same' in name else ''} |", flush=True)


def peers(cases: np.ndarray, truth: list[np.ndarray]) -> None:
    print(f"\nThe first {len(cases)} of these cases:\n")
    header()
    for name in (n for n in SETTINGS if "rough" not in n):
        compare(name, lambda row, name=name: ours(row, **SETTINGS[name]), cases, truth)
    compare("field's standard: 500 uniform nodes, BDF, rtol 1e-6", standard, cases, truth)
    if importlib.util.find_spec("pyimr") is None:
        print("\nPyIMR cannot be imported here.")
        return
    import pyimr_peer

    first, later, failed = [], [], []
    with tempfile.TemporaryDirectory() as cache:
        os.environ["IMR_FAST_JAX_CACHE"] = cache  # else what an earlier run compiled would count as fast
        for nodes, rtol in ((25, 1e-8), (25, 1e-6), (50, 1e-6)):  # its default; what it advises for radii; finer
            runs = [pyimr_peer.solve(row, WATER, TIME, nodes, rtol) for row in cases]
            good = [(run, t) for run, t in zip(runs, truth, strict=True) if run.ratio is not None]
            failed += [f"{nodes} nodes, rtol {rtol:g}: {run.why}" for run in runs if run.ratio is None]
            first.append(runs[0].compile_seconds)
            later += [run.compile_seconds for run in runs[1:]]
            errors = [float(np.abs(run.ratio - t).max()) for run, t in good]
            show(f"PyIMR, {nodes} Chebyshev nodes, rtol {rtol:g}", errors, [run.seconds for run, _ in good], len(runs))
        fine = pyimr_peer.solve(GENTLE, WATER, TIME, 50, 1e-8).ratio
    same = np.abs(fine - ours(GENTLE, FINEST)).max()
    compiling, again = np.nanmedian(first), np.nanmedian(later)
    print(f"""
PyIMR's times are second calls. Its first call of a setting takes {compiling:.1f} s more, the first with another R_max
{again:.1f} s more (medians). It failed {len(failed)} times (limit: {pyimr_peer.MOST_STEPS} steps). On a gentle case
(1e4 Pa, 0.5 Pa s, lambda 3.5, 200 um) its curve of 50 nodes and rtol 1e-8 agrees with cavirheo's of 1024 shells to
{same:.1e}.
""")
    print("\n".join(failed))


def reference(path: Path) -> None:
    data = np.load(path)
    c = json.loads(str(data["conditions"]))
    medium = Medium(c["rho"], c["c"], c["gamma"])
    print("\nReference curves of other code (the reference is itself good to about `ref`):\n")
    print("| G Pa | mu Pa s | lambda | R_max um | error | ref | ms |\n|---|---|---|---|---|---|---|")
    errors = []
    for row, R, err in zip(data["params"], data["R"], data["err"], strict=True):
        run, seconds = timed(lambda row=row: ours(row, medium, data["t"]))
        errors.append(np.abs(run - R / row[3]).max())
        case = f"{row[0]:.3g} | {row[1]:.3g} | {row[2]:.2f} | {row[3] * 1e6:.0f}"
        print(f"| {case} | {errors[-1]:.1e} | {err:.1e} | {1e3 * seconds:.1f} |")
    print(f"\nlargest {max(errors):.1e}, median {np.median(errors):.1e}")


@njit(nogil=True)
def spin(n):  # type: ignore[no-untyped-def]
    x = 0.0
    for i in range(n):
        x = x * 0.999 + i
    return x


def spin_on(workers: int, loops: int = 60_000_000) -> float:
    """Seconds for 12 loops that share nothing, on so many threads: what the machine can gain."""
    threads = [
        threading.Thread(target=lambda: [spin(loops // 12) for _ in range(12 // workers)]) for _ in range(workers)
    ]
    began = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return time.perf_counter() - began


def cores(cases: np.ndarray, workers: int, repeats: int) -> None:
    """Wall time of the batch call on one and on several cores, alternating, and whether the results are equal."""
    gels = [NeoHookeanKelvinVoigt(G, mu) for G, mu in cases[:, :2]]

    def batch(n: int) -> tuple[np.ndarray, float]:
        began = time.perf_counter()
        runs = simulate_many(gels, max_radius=cases[:, 3], stretch=cases[:, 2], time=TIME, workers=n)
        seconds = time.perf_counter() - began
        return np.array([(run.radius, run.velocity, run.pressure) for run in runs]), seconds

    spin(1)
    batch(workers)
    load = os.getloadavg()[0]
    bare, gains, fastest, equal = [], [], [np.inf, np.inf], True
    for _ in range(repeats):
        bare.append(spin_on(1) / spin_on(workers))
        (one, slow), (many, fast) = batch(1), batch(workers)
        gains.append(slow / fast)
        fastest = [min(fastest[0], slow), min(fastest[1], fast)]
        equal = equal and np.array_equal(one, many, equal_nan=True)
    print(
        f"\n`simulate_many`, {len(cases)} cases, 1 and {workers} workers in turn, {repeats} times (load {load:.2f}):\n"
    )
    print("| what | gain median | best | least time/least time | same bits |\n|---|---|---|---|---|")
    best = fastest[0] / fastest[1]
    print(f"| batch | {np.median(gains):.2f} | {max(gains):.2f} | {best:.2f} | {'yes' if equal else 'NO'} |")
    print(f"| loop that shares nothing | {np.median(bare):.2f} | {max(bare):.2f} | | |")
    print(f"\n{len(cases) / fastest[1]:.0f} curves per second at best.", flush=True)


def first_call() -> None:
    """Import and first curve in fresh processes, with an empty and with a filled cache of compiled code."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}

        def fresh() -> list[float]:
            done = subprocess.run(
                [sys.executable, "-c", FIRST_CALL], env=environment, capture_output=True, text=True, check=True
            )
            return [float(word) for word in done.stdout.split()]

        cold, warm = fresh(), [fresh() for _ in range(5)]
    print("\n| fresh process | import s | first curve s | both s | processor time of all, s |\n|---|---|---|---|---|")
    for name, runs in (("compiling, once per machine", [cold]), ("compiled before (median of 5)", warm)):
        load, curve, both, all_ = np.median([[a, b, a + b, c] for a, b, c in runs], axis=0)
        print(f"| {name} | {load:.2f} | {curve:.2f} | {both:.2f} | {all_:.2f} |")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--peers", type=int, default=6, help="how many cases the slow solvers get; 0: none")
    parser.add_argument("--workers", type=int, default=len(CORES) or os.cpu_count(), help="1: leave that part out")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--reference", type=Path, default=Path("../shared/reference/reference_curves.npz"))
    options = parser.parse_args()
    cases = draw(options.cases, options.seed)
    use(set(sorted(CORES)[-1:]))
    ours(cases[0])  # compile or load
    truth = [ours(row, FINEST) for row in cases]
    accuracy(cases, truth)
    laws(cases[:20])
    contents(cases[:40])
    if options.peers:
        peers(cases[: options.peers], truth[: options.peers])
    if options.reference.is_file():
        reference(options.reference)
    use(CORES)
    if options.workers > 1:
        cores(cases, options.workers, options.repeats)
    first_call()


if __name__ == "__main__":
    main()
