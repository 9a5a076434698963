"""How far the analytic collapse time is from the simulated one: writes collapse_time.md here (half a minute).

Sobol points over log10 G 2.5 to 5.5, log10 mu -3 to 0, lambda 3 to 11, R_max 60 to 450 um (logarithmic), in water.
The weights of surface tension and gas are averages over Rayleigh's collapse, by quadrature.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import quad
from scipy.stats import qmc

from cavirheo.physics.collapse import analytic_time, simulated_time
from cavirheo.physics.media import WATER

N = 4096


def mean_over_collapse(f) -> float:
    """Mean over the time of Rayleigh's collapse, whose dt is proportional to r^(3/2) (1 - r^3)^(-1/2) dr."""

    def integral(g):
        return quad(lambda s: 2 * s * (1 - s * s) ** 1.5 / np.sqrt(1 - (1 - s * s) ** 3) * g(1 - s * s), 0, 1)[0]

    return integral(f) / integral(lambda r: 1.0)


def weights() -> list[str]:
    """Of a pressure r^-n, by work, 3 int_r^1 p r^2 dr/(1 - r^3), and by the pressure itself."""
    rows = ["| pressure | of what | by its work | by its mean over time |", "|---|---|---|---|"]
    for n, what in ((1, "surface tension; elasticity, in 1/lambda"), (3, "isothermal gas"), (4.2, "adiabatic gas")):

        def work(r: float, n: float = n) -> float:
            return (3 * np.log(1 / r) if n == 3 else 3 * (1 - r ** (3 - n)) / (3 - n)) / (1 - r**3)

        plain = f"{mean_over_collapse(lambda r, n=n: r**-n):.4f}" if n < 2.5 else "infinite"
        rows.append(f"| r^-{n} | {what} | {mean_over_collapse(work):.4f} | {plain} |")
    return rows


def main() -> None:
    u = qmc.Sobol(4, seed=1).random(N)
    G, mu = 10 ** (2.5 + 3 * u[:, 0]), 10 ** (-3 + 3 * u[:, 1])
    stretch, radius = 3 + 8 * u[:, 2], 60e-6 * 7.5 ** u[:, 3]
    simulated = simulated_time(radius, stretch, G, mu)
    analytic = analytic_time(radius, stretch, G, mu)
    Re = WATER.pressure * radius / (mu * WATER.velocity_scale)
    collapses = np.isfinite(simulated)
    off = np.full(N, np.nan)
    off[collapses] = 100 * (analytic[collapses] / simulated[collapses] - 1)

    lines = ["# The analytic collapse time beside the simulated one", ""]
    lines += [f"{N} bubbles, `benchmarks/collapse_time.py`; t_1 analytic over simulated, per cent.", ""]
    lines += ["| | bubbles | no collapse simulated | median | median size | 95th percentile | largest |"]
    lines += ["|---|---|---|---|---|---|---|"]

    def row(name: str, chosen: np.ndarray) -> None:
        x = off[chosen & np.isfinite(off)]
        none = int(np.sum(chosen & ~collapses))
        figures = (
            f"{np.median(x):+.2f} | {np.median(abs(x)):.2f} | {np.percentile(abs(x), 95):.2f} | {abs(x).max():.2f}"
        )
        lines.append(f"| {name} | {chosen.sum()} | {none} | {figures} |")

    for low, high in ((30, np.inf), (15, 30), (10, 15), (7, 10), (5, 7), (3, 5), (0, 3)):
        row(f"Re {low} to {high:g}", (Re >= low) & (Re < high))
    good = Re >= 10
    for low in range(3, 11, 2):
        row(f"Re > 10, lambda {low} to {low + 2}", good & (stretch >= low) & (stretch < low + 2))
    for low in np.arange(2.5, 5.5, 0.5):
        inside = (np.log10(G) >= low) & (np.log10(G) < low + 0.5)
        row(f"Re > 10, lambda > 5, log10 G {low:g} to {low + 0.5:g}", good & (stretch > 5) & inside)
    for low, high in ((60, 100), (100, 200), (200, 450)):
        row(
            f"Re > 10, lambda > 5, R_max {low} to {high} um",
            good & (stretch > 5) & (radius * 1e6 >= low) & (radius * 1e6 < high),
        )
    lines += ["", "## Weights of small pressures", "", *weights()]
    Path(__file__).with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
