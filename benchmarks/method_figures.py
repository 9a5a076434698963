"""Pictures of the method pages, of simulated bubbles alone, which are answered with the field's bubble, as they are.

    python benchmarks/method_figures.py [contents] [laws] [draws] [window] [verdicts] [material]    # all: 30 s

Writes docs/method/NAME.png. The numbers in the captions of docs/method are those that it prints.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, infer, infer_many, population, simulate
from cavirheo.physics.bubble import FIELD, Bubble, Damage
from cavirheo.physics.materials import parse
from cavirheo.posterior import Posterior
from cavirheo.reporting.material import population_record
from cavirheo.writing import style

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from validation.claims.calibration import film

FOLDER = Path(__file__).parents[1] / "docs" / "method"
DPI = 120
GREEN, PURPLE = "#009e73", "#cc79a7"
G, MU = "shear_modulus", "viscosity"
G_AXIS, MU_AXIS = "shear modulus G (kPa)", "viscosity µ (Pa s)"
SEED = {
    "draws": 3,
    "window": 6,
    "verdicts": 2,
    "material": 5,
}  # in nine of ten shots an interval holds the truth, as in these
TRUTH = np.log10([8e3, 0.05])  # Pa, Pa s
SPREAD, OUTLIER = np.array([0.08, 0.05]), np.log10([4e4, 0.04])  # decades
INSIDE = 0.9  # probability within a contour


def panels(places: int, height: float, labels: list[tuple[str, str]]) -> tuple[Any, list[Any]]:
    """Axes side by side, each with its letter."""
    figure, width = style.new_figure(height), 1.0 / places
    boxes = [(width * k + 0.26 * width, 0.46 / height, 0.7 * width, 1.0 - 0.78 / height) for k in range(places)]
    drawn = [style.new_axes(figure, box, *label) for box, label in zip(boxes, labels, strict=True)]
    for axes, letter in zip(drawn, "abc", strict=False):
        axes.set_title(letter, loc="left", fontsize=9, fontweight="bold")
    return figure, drawn


def key(axes: Any, **how: Any) -> None:
    axes.legend(**({"frameon": False, "fontsize": 8, "handlelength": 1.4, "borderpad": 0.0} | how))


def contents() -> Any:
    """One bubble with both models of its contents: radius, pressure, vapour at its wall."""
    names = ("radius (µm)", "pressure (MPa)", "vapour at the wall (mass %)")
    figure, axes = panels(3, 2.9, [("time after R_max (µs)", name) for name in names])
    time, gel = np.linspace(0.0, 80e-6, 8001), NeoHookeanKelvinVoigt(5e3, 0.03)
    for alpha, colour in ((None, style.INK), (0.07, style.VERMILLION), (0.03, style.BLUE)):
        label = "equilibrium" if alpha is None else f"kinetic, α = {alpha}"
        bubble = FIELD if alpha is None else Bubble("kinetic", alpha)
        run = simulate(gel, max_radius=250e-6, stretch=7.0, time=time, fields=True, bubble=bubble)
        shown = 1e6 * run.radius, 1e-6 * run.pressure, 100.0 * run.contents.vapour[:, -1]
        for place, values in zip(axes, shown, strict=True):
            place.plot(1e6 * time, values, color=colour, lw=1.2, label=label)
        first = int(np.argmin(run.radius[time < 40e-6]))
        rebound = np.max(run.radius[first:]) / run.radius[0]
        print(f"{label}: first collapse after {1e6 * time[first]:.1f} us, rebound to {rebound:.2f} of R_max")
    axes[1].set_yscale("log")
    key(axes[0], loc="upper right")
    return figure


ELASTIC = {
    "neo-hookean(1)": ("neo-Hookean", style.BLACK, "-"),
    "linear(1)": ("linear", style.PALE, "--"),
    "quadratic(1, 0.1)": ("quadratic, a = 0.1", style.BLUE, "-"),
    "fung(1, 0.1)": ("Fung, a = 0.1", style.VERMILLION, "-"),
    "gent(1, 30)": ("Gent, J$_m$ = 30", GREEN, "-"),
}
VISCOUS = {
    "newtonian(0.05)": ("Newtonian", style.BLACK, "-"),
    "power-law(15.8, 0.5)": ("power law, n = 0.5", style.BLUE, "-"),
    "carreau-yasuda(0.5, 0.01, 1e-4, 0.4)": ("Carreau-Yasuda, n = 0.4", style.VERMILLION, "-"),
    "cross(0.5, 0.01, 1e-4)": ("Cross", GREEN, "-"),
    "herschel-bulkley(500, 0.2, 0.9)": ("Herschel-Bulkley, n = 0.9", PURPLE, "-"),
}


def laws() -> Any:
    """What a law is to the solver: one function of R/R_0, one of U/R."""
    labels = [("R/R$_0$", "elastic stress integral S$_{el}$ / G"), ("shear rate at the wall (1/s)", "viscosity (Pa s)")]
    figure, (left, right) = panels(2, 3.0, labels)
    ratio, rate = np.geomspace(0.4, 8.0, 400), np.geomspace(1e2, 1e7, 200)
    for text, (name, colour, line) in ELASTIC.items():
        stress = parse(text).stress(ratio)
        left.plot(ratio, stress, line, color=colour, lw=1.3, label=name)
        if np.isnan(stress[-1]):  # its lock-up
            last = np.flatnonzero(np.isfinite(stress))[-1]
            left.plot(ratio[last], stress[last], "o", color=colour, ms=3.5)
    for text, (name, colour, line) in VISCOUS.items():
        right.plot(rate, parse(text).apparent(rate), line, color=colour, lw=1.3, label=name)
    left.axhline(0.0, color=style.PALE, lw=0.6, zorder=0)
    left.set(xscale="log", ylim=(-12.0, 12.0))
    ticks(left.xaxis, (0.5, 1, 2, 4, 8))
    right.set(xscale="log", yscale="log", ylim=(3e-3, 60.0))
    key(left), key(right)
    return figure


def ticks(axis: Any, values: tuple[float, ...]) -> None:
    """These alone have numbers, which logarithmic axes write as powers of ten."""
    axis.set_ticks(values, [f"{value:g}" for value in values])
    axis.set_minor_formatter("")


def pair(answer: Posterior) -> np.ndarray:
    """(2, draws) G in kPa and mu in Pa s."""
    return np.array([1e-3 * answer.draws(G), answer.draws(MU)])


def outline(axes: Any, answer: Posterior, **how: Any) -> None:
    """The contour that holds 90 % of an answer's draws: of Gaussians about them, by their weights."""
    from scipy.stats import gaussian_kde

    logs = np.log(pair(answer))
    density = gaussian_kde(logs, lambda kde: 1.4 * kde.scotts_factor(), answer.weights)  # smoother than its default
    at = density(logs)
    order = np.argsort(-at)
    level = at[order][np.searchsorted(np.cumsum(answer.weights[order]), INSIDE)]
    x, y = np.meshgrid(*(np.linspace(*np.log(ends), 300) for ends in (axes.get_xlim(), axes.get_ylim())))
    axes.contour(np.exp(x), np.exp(y), density(np.array([x.ravel(), y.ravel()])).reshape(x.shape), [level], **how)


STAR: Any = {"color": style.VERMILLION, "ms": 11, "mec": "white", "mew": 0.5, "zorder": 4}


def star(axes: Any, logs: np.ndarray, label: str) -> None:
    """The truth, log10 of SI."""
    axes.plot(10.0 ** (logs[0] - 3.0), 10.0 ** logs[1], "*", label=label, **STAR)


def scattered(axes: Any, answer: Posterior, places: Any, label: str) -> None:
    """Draws, whose areas are their weights."""
    size = 60.0 * answer.weights / answer.weights.max()
    axes.scatter(*places, s=size, color=style.BLUE, lw=0, alpha=0.5, label=label)


def draws() -> Any:
    """A simulated shot: the draws, their weights by simulation, and the interval."""
    _, curve = film(
        NeoHookeanKelvinVoigt(*10.0**TRUTH), 240e-6, 6.5, 0.01, np.random.default_rng(SEED["draws"]), "shot"
    )
    answer = infer(curve, material="nhkv", bubble="field")
    ends = [f"{what} {answer.median(what):.3g} {np.round(answer.interval(what), 4)}" for what in (G, MU)]
    worth = answer.diagnostics.effective_sample_size
    print(f"{', '.join(ends)}; {len(answer.theta)} draws, worth {worth:.0f}")
    figure, (left, right) = panels(2, 3.4, [(G_AXIS, MU_AXIS)] * 2)
    left.plot(*pair(answer), ".", color=style.PALE, ms=4, mew=0, label="draws of the emulator")
    scattered(right, answer, pair(answer), "simulated, area: weight")
    right.plot([], [], color=style.BLUE, lw=1.4, label="90 % of their weight")
    for axes in (left, right):
        axes.set(xlim=(3.0, 13.0), ylim=(0.02, 0.08))
        star(axes, TRUTH, "truth")
        key(axes, loc="upper left")
    outline(right, answer, colors=style.BLUE, linewidths=1.4)
    return figure


def window() -> Any:
    """A simulated shot, read up to one collapse and up to three: viscosity and stretch."""
    _, curve = film(
        NeoHookeanKelvinVoigt(*10.0**TRUTH), 240e-6, 6.5, 0.01, np.random.default_rng(SEED["window"]), "shot"
    )
    figure, panes = panels(2, 3.1, [("stretch λ", MU_AXIS)] * 2)
    for axes, window in zip(panes, (1, 3), strict=True):
        answer = infer(curve, material="nhkv", bubble="field", window=window)
        ends = [f"{what} {np.round(answer.interval(what), 4)}" for what in (MU, "stretch")]
        print(f"window {window}: {', '.join(ends)}; {answer.checks.verdict}")
        scattered(axes, answer, (answer.draws("stretch"), answer.draws(MU)), "weighted draws")
        axes.plot(6.5, 10.0 ** TRUTH[1], "*", label="truth", **STAR)
        axes.set(yscale="log", xlim=(5.0, 9.0), ylim=(7e-5, 0.3))
        key(axes, loc="lower left")
    return figure


def material() -> Any:
    """Simulated shots of a gel whose places differ, and one of another gel: the shots; their material, its scatter."""
    rng = np.random.default_rng(SEED["material"])
    truths = [*(TRUTH + SPREAD * rng.standard_normal((9, 2))), OUTLIER]
    curves = []
    for k, logs in enumerate(truths, 1):
        law, size, stretch = NeoHookeanKelvinVoigt(*10.0**logs), rng.uniform(180e-6, 320e-6), rng.uniform(5.5, 7.5)
        curves.append(film(law, size, stretch, 0.005, rng, f"shot {k}")[1])
    answers = infer_many(curves, material="nhkv", bubble="field")
    found = population(answers, names=[curve.name for curve in curves])
    print(found)
    figure, (left, right) = panels(2, 3.6, [(G_AXIS, MU_AXIS)] * 2)
    for axes in (left, right):
        axes.set(xscale="log", yscale="log", xlim=(3.5, 60.0), ylim=(0.029, 0.095))
        ticks(axes.xaxis, (5, 10, 20, 50)), ticks(axes.yaxis, (0.03, 0.04, 0.05, 0.06, 0.08))
    for logs, answer, tone in zip(truths, answers, style.tone_colours(np.linspace(0.0, 1.0, len(truths))), strict=True):
        outline(left, answer, colors=[tone], linewidths=1.0)
        left.plot(10.0 ** (logs[0] - 3.0), 10.0 ** logs[1], "x", color=tone, ms=5)
    left.plot([], [], color=style.INK, lw=1.0, label="90 % of a shot's draws")
    left.plot([], [], "x", color=style.INK, ms=5, label="its truth")

    turn, reach = np.linspace(0.0, 2.0 * np.pi, 121), np.sqrt(-2.0 * np.log(1.0 - INSIDE))
    modulus, mu = 10.0 ** (TRUTH[:, None] + reach * SPREAD[:, None] * [np.cos(turn), np.sin(turn)])
    right.plot(1e-3 * modulus, mu, "--", color=style.VERMILLION, lw=1.2)
    star(right, TRUTH, "truth: the gel, and 90 % of its places")
    mu, modulus = population_record(found).contour(INSIDE).T
    right.plot(1e-3 * modulus, mu, "--", color=style.BLUE, lw=1.2)
    x, y = 1e-3 * found.median(G), found.median(MU)
    xerr = np.abs(1e-3 * np.array(found.interval(G)) - x)[:, None]
    yerr = np.abs(np.array(found.interval(MU)) - y)[:, None]
    bars: Any = {"xerr": xerr, "yerr": yerr, "lw": 1.3, "capsize": 2}
    right.errorbar(x, y, fmt="D", color=style.BLUE, ms=4, label="inferred: the same, from a", **bars)
    for name, probability in found.outliers.items():
        one = answers[int(name.split()[1]) - 1]
        label = f"outlier ({probability:.0%})"
        right.plot(1e-3 * one.median(G), one.median(MU), "o", color=style.PALE, ms=4, label=label)
    key(left, loc="upper right"), key(right, loc="upper right")
    return figure


def verdicts() -> Any:
    """Three shots that are asked as a gel: one that is, one of a gel that breaks, and a liquid."""
    labels = [("time after R_max (µs)", "radius (µm)")] * 2 + [("shear modulus G (Pa)", MU_AXIS)]
    figure, panes = panels(3, 3.0, labels)
    gel, breaks = NeoHookeanKelvinVoigt(*10.0**TRUTH), Bubble(damage=Damage(0.2, 1.5))
    stiff, liquid = NeoHookeanKelvinVoigt(3e4, 0.05), Newtonian(0.06)
    rng = np.random.default_rng(SEED["verdicts"])
    for axes, law, bubble in zip(panes, (gel, stiff, liquid), (FIELD, breaks, FIELD), strict=True):
        _, curve = film(law, 240e-6, 6.0, 0.005, rng, "shot", bubble=bubble)
        answer = infer(curve, material="nhkv", bubble="field")
        checks = answer.checks
        ends = [f"{what} {np.round(answer.interval(what), 4)}" for what in (G, MU)]
        print(f"{checks.verdict}: RMSE {100 * checks.rmse_over_rmax:.2g} %, {', '.join(ends)}")
        axes.set_title(f"   {checks.verdict}", loc="center", fontsize=8.5)
        if law is liquid:
            scattered(axes, answer, (answer.draws(G), answer.draws(MU)), "weighted draws")
            axes.set(xscale="log", xlim=(5.0, 2e3), ylim=(0.05, 0.075))
            end = 10.0 ** answer.prior[f"log10_{G}"][0]
            axes.axvline(end, color=style.INK, lw=0.8, ls="--", label="end of the range")
        else:
            dots: Any = {"ms": 2.5, "mfc": "none", "mec": style.INK, "mew": 0.6}
            axes.plot(1e6 * curve.time, 1e6 * curve.radius, "o", label="measured", **dots)
            simulated = 1e6 * (checks.reconstruction_time - curve.time_of_max), 1e6 * checks.reconstruction_radius
            axes.plot(*simulated, color=style.VERMILLION, lw=1.1, label="simulated")
            axes.set(xlim=(0.0, 1.15e6 * checks.compared_time[-1]), ylim=(0.0, 260.0))
        key(axes, loc="upper right")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made = {
        "contents": contents,
        "laws": laws,
        "draws": draws,
        "window": window,
        "verdicts": verdicts,
        "material": material,
    }
    parser.add_argument("names", nargs="*", choices=[[], *made], help=argparse.SUPPRESS)
    for name in parser.parse_args().names or made:
        style.save(FOLDER / f"{name}.png", made[name](), dpi=DPI)


if __name__ == "__main__":
    main()
