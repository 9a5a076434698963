"""How far the analytic collapse time is from the simulated one: half a minute.

Sobol points over log10 G 2.5 to 5.5, log10 mu -3 to 0, lambda 3 to 11, R_max 60 to 450 um (logarithmic), in water.
The weights of surface tension and gas are averages over Rayleigh's collapse, by quadrature.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import quad
from scipy.stats import qmc

from cavirheo.physics.bubble import Bubble
from cavirheo.physics.collapse import RAYLEIGH, analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium

N = 4096
R = 2e-4  # m, of the limits
EMPTY = replace(WATER, surface_tension=0.0, vapour_reference_pressure=1e-6, name="empty")
BARE = {"bubble": Bubble(motion="rayleigh-plesset", exponent=1.4)}
SILENT = Bubble(motion="rayleigh-plesset")  # no sound


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


def limits() -> list[str]:
    """One small effect at a time, by what it adds to (t_RC/t_1)^2: simulated and published."""

    def f(stretch: float, G: float = 0.0, mu: float = 0.0, medium: Medium = EMPTY, **options: object) -> float:
        time = simulated_time(R, stretch, G, mu, medium, **options)[0]
        return float((rayleigh_time(R, medium) / time) ** 2)

    p, U = WATER.pressure, WATER.velocity_scale
    C = WATER.sound_speed / U
    wet, taut = replace(WATER, surface_tension=0.0), replace(EMPTY, surface_tension=WATER.surface_tension)
    rows = ["| effect | simulated | published |", "|---|---|---|"]
    rows.append(f"| none (lambda 40): (t_RC/t_1)^2 | {f(40, **BARE):.7f} | 1 |")
    by_tension = (f(30, medium=taut, **BARE) - f(30, **BARE)) * p * R / (2 * WATER.surface_tension)
    rows.append(f"| surface tension, times We | {by_tension:.3f} | {np.pi / RAYLEIGH / np.sqrt(6):.3f} |")
    by_sound = (f(30, **BARE) - f(30, bubble=Bubble(exponent=1.4))) * C
    published = 2 * C / (1 + np.hypot(1, 2 * C * RAYLEIGH))
    rows.append(f"| speed of sound (lambda 30), times -C | {by_sound:.2f} | {published:.2f} |")
    by_vapour = (f(20, **BARE) - f(20, medium=wet, **BARE)) * p / wet.vapour_pressure
    rows.append(f"| vapour that condenses at once, over -p_v | {by_vapour:.3f} | 1.494 |")
    for stretch in (4, 6, 9):
        by_gas = (1 - f(stretch, bubble=SILENT)) * stretch**3
        both = (1 - f(stretch, medium=wet, bubble=SILENT)) / (stretch**-3 + wet.vapour_pressure / p)
        rows.append(f"| gas with heat (lambda {stretch}), times -lambda^3 | {by_gas:.2f} | 1.49 |")
        rows.append(f"| gas and vapour with transport (lambda {stretch}), over minus both | {both:.2f} | 1.49 |")
    for stretch in (3, 5, 10, 20):
        by_solid = (f(stretch, 1e4, **BARE) - f(stretch, **BARE)) * p / 1e4
        published = float(inverse_square(R, stretch, 1e4, 0) - inverse_square(R, stretch, 0, 0)) * p / 1e4
        rows.append(f"| elasticity Be (lambda {stretch}) | {by_solid:.3f} | {published:.3f} |")
    for Re in (100, 30, 10, 5):
        mu = p * R / (U * Re)
        seen = f(20, mu=mu, **BARE)
        published = float(inverse_square(R, 20, 0, mu) - inverse_square(R, 20, 0, 0))
        simulated = f"{seen - f(20, **BARE):.4f}" if seen else "no collapse"
        rows.append(f"| viscosity (Re {Re}) | {simulated} | {published:.4f} |")
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
    lines += [f"{N} bubbles of `benchmarks/collapse_time.py`."]
    lines += ["The columns give t_1 of the analytic model over t_1 of the simulation, minus 1, in per cent.", ""]
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
    lines += ["", "## One effect at a time (R_max 200 um)", "", *limits()]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
