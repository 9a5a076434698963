"""What a cluster costs and where it ends: measured here with workers beside as many threads, then simulated for more.

python benchmarks/scale.py [-n CURVES] [--repeats N] [--workers 2]

Throughput is compared as curves per second of processor time as well as of
the clock, in turn, for other work may share the machine. The simulated driver has the measured costs of this one.
"""

from __future__ import annotations

import argparse
import heapq
import resource
import subprocess
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster

from cavirheo.parallel import Executor, Threads
from cavirheo.physics.simulate import load_solver
from cavirheo.training.dataset import SHARD, Columns, fill_files, generate, layout_of
from cavirheo.training.recipe import read_recipe
from cavirheo.workflow.cluster import BATCH_SECONDS, BATCHES_PER_THREAD, Workers, identity

RECIPE = Path(__file__).parents[1] / "recipes" / "laptop.toml"


def processor() -> float:
    """s of processor time of this process."""
    return time.process_time()


def spent(client: Client) -> float:
    """s of processor time of the workers."""
    return sum(client.run(processor).values())


def nothing(seconds: float) -> bytes:
    """A unit of work that takes so long without the processor; as large an answer as that of 50 curves."""
    time.sleep(seconds)
    return bytes(50 * 2000)


def rate(executor: Executor, n: int, client: Client | None) -> tuple[float, float, float]:
    """Curves per s of the clock, s of processor a curve of who worked, and those of the driver beside."""
    problem = read_recipe(RECIPE).problem
    with tempfile.TemporaryDirectory() as folder:
        mine, theirs, clock = processor(), spent(client) if client else 0.0, time.perf_counter()
        generate(problem, n, folder, seed=3, executor=executor, progress=False)
        clock = time.perf_counter() - clock
        mine, theirs = processor() - mine, (spent(client) if client else 0.0) - theirs
    return n / clock, (theirs if client else mine) / n, mine / n if client else 0.0


def overhead(workers: Workers, seconds: float, count: int) -> float:
    """Part of the workers' time that is lost between units of so many s."""
    hands = len(workers.client.scheduler_info()["workers"])
    with closing(workers.map_unordered(nothing, [seconds] * 3)) as flow:
        list(flow)
    began = time.perf_counter()
    with closing(workers.map_unordered(nothing, [seconds] * count)) as flow:
        list(flow)
    return (time.perf_counter() - began) * hands / (count * seconds) - 1.0


def driver_cost(workers: Workers, count: int) -> float:
    """s of processor of this process (driver and scheduler) for a batch, whatever it brings."""
    began = processor()
    with closing(workers.map_unordered(slept, [0.1] * count)) as flow:
        list(flow)
    return (processor() - began) / count


def slept(seconds: float) -> None:
    """A batch by itself, if it is not the end."""
    time.sleep(seconds)


@dataclass(frozen=True)
class Simulated:
    """Of a cluster: part of the cores' time that is work, and of the driver's that is spent."""

    busy: float
    driver: float


def simulate(cores: int, seconds: float, cost: float, batches: int, spread: float = 0.2) -> Simulated:
    """`BATCHES_PER_THREAD` batches for each core, about `seconds` long; the driver takes `cost` for each in turn."""
    rng = np.random.default_rng(0)
    length = seconds * np.exp(spread * rng.standard_normal(batches))
    events: list[tuple[float, int]] = []  # (when a batch ends, its core)
    free, queue, sent, clock = [0.0] * cores, [0] * cores, 0, 0.0

    def send(core: int) -> None:
        nonlocal sent, clock
        if sent < batches:
            clock += cost / 2
            queue[core] += 1
            free[core] = max(free[core], clock) + length[sent]
            heapq.heappush(events, (free[core], core))
            sent += 1

    for _ in range(BATCHES_PER_THREAD):
        for core in range(cores):
            send(core)
    half = None
    while events:
        end, core = heapq.heappop(events)
        clock = max(clock, end) + cost / 2
        queue[core] -= 1
        if sent < batches:
            send(core)
        elif half is None:
            half = clock, sent  # from here on the end of the set, which depends on its size, is drawn out
    assert half is not None
    work = float(length[: half[1]].sum())
    return Simulated(min(work / (cores * half[0]), 1.0), min(half[1] * cost / half[0], 1.0))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("-n", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--workers", type=int, default=1, help="worker processes, beside as many threads")
    given = parser.parse_args()
    load_solver()
    cpu = [
        line
        for line in subprocess.run(["lscpu"], capture_output=True, text=True).stdout.splitlines()
        if "Model name" in line
    ]
    print(*cpu)
    how = {"n_workers": given.workers, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**how) as cluster, Client(cluster) as client:
        workers = Workers(client, identity())
        list(workers.map_unordered(nothing, [0.0]))
        found = {"thread": [], "dask": []}
        for _ in range(given.repeats):
            found["thread"].append(rate(Threads(given.workers), given.n, None))
            found["dask"].append(rate(workers, given.n, client))
        clock, cpu_s, beside = (
            {way: np.median([one[k] for one in rows]) for way, rows in found.items()} for k in range(3)
        )
        print(f"curves per s of the clock: thread {clock['thread']:.1f}, dask {clock['dask']:.1f}")
        print(f"processor ms a curve: thread {1e3 * cpu_s['thread']:.2f}, dask worker {1e3 * cpu_s['dask']:.2f}, "
              f"driver {1e3 * beside['dask']:.2f}")  # fmt: skip
        print(f"dask over thread, by the clock: {clock['dask'] / clock['thread']:.2f}; "
              f"by processor time of the worker: {cpu_s['thread'] / cpu_s['dask']:.2f}")  # fmt: skip
        per_hour = 3600 / cpu_s["dask"]
        print(f"{per_hour:.0f} curves a core-hour, {1e6 / per_hour:.1f} core-hours a million")
        for seconds in (0.1, 0.5, 1.0, 2.0):
            lost = overhead(workers, seconds, given.workers * max(int(10 / seconds), 8))
            print(f"units of {seconds:g} s: {100 * lost:.1f} % lost")
        cost = driver_cost(workers, 100)
        print(f"driver: {1e3 * cost:.2f} ms of processor a batch")
        curve = million(workers)
    print(f"driver: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB at most")
    print("cores | batch s | cores at work | driver at work")
    for cores in (100, 250, 500, 1000, 10_000):
        for seconds in (0.5, 2.0, 20.0, BATCH_SECONDS):
            made = simulate(cores, seconds, cost + curve * per_hour / 3600 * seconds, 20 * cores)
            print(f"{cores} | {seconds:g} | {made.busy:.0%} | {made.driver:.0%}")


def filled(block: range) -> Columns:
    """What `generate` gets for these curves, without their simulation."""
    n = len(block)
    return {"theta": np.ones((n, 3)), "radius": np.ones((n, 100), np.float32), "status": ["ok"] * n}


def million(workers: Workers) -> float:
    """The driver's way of 100,000 curves of a planned million, whose simulations are left out: s of its processor for
    a curve."""
    with tempfile.TemporaryDirectory() as folder:
        blocks = {Path(folder, f"{k:05d}.h5"): range(k * SHARD, (k + 1) * SHARD) for k in range(200)}
        layout = layout_of(read_recipe(RECIPE).problem)
        times, began = [time.perf_counter()], processor()

        def write(path: Path, block: range, parts: list[Columns]) -> None:
            layout.write({}, path, block, parts)
            times.append(time.perf_counter())

        fill_files(blocks, filled, write, workers, lambda _: None)
        cost = (processor() - began) / 100_000
    first, last = np.diff(times)[20:100].mean(), np.diff(times)[100:180].mean()
    print(f"100,000 curves through the driver in {times[-1] - times[0]:.1f} s, {1e6 * cost:.1f} us of processor each; "
          f"a file of {SHARD}: {1e3 * first:.0f} ms in the first half, {1e3 * last:.0f} ms in the second")  # fmt: skip
    return cost


if __name__ == "__main__":
    main()
