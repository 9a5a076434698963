"""Where the time of one default curve goes.

    python benchmarks/solver_profile.py

The compiled parts are called in a compiled loop on a state in mid-collapse (their time does not depend on the state),
and multiplied by how often the integration calls them; "sums, error, output" is what is left of the integration.
Processor time of the thread, not wall time, so that other work on the machine disturbs it little.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from cavirheo.physics import simulate as forward
from cavirheo.physics import solver
from cavirheo.physics.accuracy import RODAS5P, wall_clustered
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER
from cavirheo.physics.scales import dimensionless

GEL, R_MAX, STRETCH = NeoHookeanKelvinVoigt(1e4, 0.05), 200e-6, 6.0
TIME = np.linspace(0, 100e-6, 101)


def arguments() -> dict[str, Any]:
    """Every argument that the compiled parts take, by name; what they return is added by `measure`."""
    M = forward.DEFAULT[0]
    grid = wall_clustered(M)
    numbers = dimensionless(GEL, WATER, R_MAX, STRETCH)
    R, U, P = 0.3, -1.5, 0.03
    p = P / R**3
    N = p / (1 + 2 * (1 - grid.centre**2))
    vapour = numbers.pv / p * (1.5 - 0.5 * grid.centre)
    y = np.concatenate([N, N * (1 - vapour), [R, U, P]])
    return dict(
        y=y, numbers=numbers, grid=grid, M=M, shift=1000.0, r=np.empty_like(y), out=np.empty_like(y),
        theta=np.empty(M), gas=np.empty(M), F=np.empty(M + 1), H=np.empty(M + 1),
        cell=np.zeros((5, M)), flux=np.zeros((7, M + 1)), blocks=np.zeros((9, M)), border=np.zeros((6, M)),
        recall=np.zeros((0, 4)), schur=np.zeros((5, 5)), pivot=np.zeros(5, np.int64), b=np.zeros(5), t=0.0,
    )  # fmt: skip


def least(call: Callable[[], object], repeats: int = 40) -> float:
    """Least processor time of this thread in one of `repeats` calls, s."""
    call()
    best = np.inf
    for _ in range(repeats):
        began = time.thread_time()
        call()
        best = min(best, time.thread_time() - began)
    return best


def per_call(function: Any, names: dict[str, Any], count: int = 400) -> float:
    """Seconds per call from compiled code. `r` is refilled before each call, since one part overwrites it."""
    chosen = tuple(names[name] for name in inspect.signature(function.py_func).parameters)

    @njit
    def empty(n, source, target, values):  # type: ignore[no-untyped-def]
        for i in range(n):
            for j in range(source.size):
                target[j] = source[j]
            target[0] += i

    @njit
    def loop(n, source, target, values):  # type: ignore[no-untyped-def]
        for i in range(n):
            for j in range(source.size):
                target[j] = source[j]
            target[0] += i
            function(*values)

    both = [least(lambda f=f: f(count, names["y"], names["r"], chosen)) for f in (empty, loop)]
    return (both[1] - both[0]) / count


def measure() -> list[tuple[str, int, float]]:
    """(part, calls per curve, seconds per call), the last for the whole curve."""
    names = arguments()
    slope = solver.derivatives(*(names[name] for name in inspect.signature(solver.derivatives.py_func).parameters))
    names["p_dot"], names["z"] = slope
    for part in (solver.eliminate, solver.factorise):
        names["couplings"] = part(*(names[name] for name in inspect.signature(part.py_func).parameters))

    inner: list[float] = []
    original = solver.integrate

    def watched(*values: object) -> int:
        began = time.thread_time()
        code = original(*values)
        inner.append(time.thread_time() - began)
        return code

    def curve() -> forward.Simulation:
        return forward.simulate(GEL, max_radius=R_MAX, stretch=STRETCH, time=TIME)

    stats = curve().stats
    total = least(curve)
    forward.solver.integrate = watched
    try:
        least(curve)
    finally:
        forward.solver.integrate = original
    tables = least(lambda: dimensionless(GEL, WATER, R_MAX, STRETCH))
    steps, tries, stages = stats["steps"], stats["steps"] + stats["rejected"], len(RODAS5P.A)
    parts = [
        ("derivatives (right-hand side)", 1 + tries * (stages - 1) + steps, per_call(solver.derivatives, names)),
        ("eliminate (Jacobian of the shells and its LU factors)", tries, per_call(solver.eliminate, names)),
        ("factorise (the border)", tries, per_call(solver.factorise, names)),
        ("back_substitute (linear solves)", tries * stages, per_call(solver.back_substitute, names)),
    ]
    compiled = sum(calls * seconds for _, calls, seconds in parts)
    parts.append(("stage sums, error norm, output", tries, (min(inner) - compiled) / tries))
    parts.append(("Python: constants and tables of the laws", 1, tables))
    parts.append(("Python: the rest of `simulate`", 1, total - min(inner) - tables))
    print(f"{steps} steps, {stats['rejected']} rejected, {stages} stages each, {forward.DEFAULT[0]} shells\n")
    return [*parts, ("one curve", 1, total)]


def main() -> None:
    parts = measure()
    whole = parts[-1][2]
    print("| part | calls | us each | ms | % |\n|---|---|---|---|---|")
    for name, calls, seconds in parts:
        share = calls * seconds
        print(f"| {name} | {calls} | {1e6 * seconds:.2f} | {1e3 * share:.2f} | {100 * share / whole:.0f} |")


if __name__ == "__main__":
    main()
