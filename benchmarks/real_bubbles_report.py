"""Tables and pictures of docs/real-bubbles.md, and further tables, from what benchmarks/real_bubbles.py kept.

    python benchmarks/real_bubbles_report.py results.json [-o docs/real-bubbles]

Prints each table for which the file has what it needs, and writes the pictures into the folder. No recording is drawn:
summaries of residuals, fitted parameters and evidence only.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from real_bubbles import BUBBLES, PUBLISHED, RHEOMETER, SETS, SPEED, WATER_MODELS, cross_section, resistance
from scipy.stats import t as student

from cavirheo.writing import style

COLUMNS = {
    "peg": "PEG 8000 in water | shots | rheometer | IMR | bubble | µ, Pa s | µ over the rheometer's | scatter, decades | d ln µ/d ln R_max | RMSE, % | RMSE < 2 %",  # noqa: E501
    "sets": "set | shots | RMSE, field | RMSE, real | real smaller | `ok`, field | `ok`, real | log evidence of real over field | real preferred",  # noqa: E501
    "ahead": "set | shots | field | real | real nearer | real, values of the other shots | nearer",
    "chosen": "set left out | chosen by the other sets | their mean gain of log evidence | gain in the set left out",
    "fits": "set | bubble | shots | RMSE, % | RMSE of cycles 1, 2, 3 | G, kPa | µ, Pa s | accommodation | ζ | log evidence over field",  # noqa: E501
    "growth": "set | shots | even | γ | ζ | A, mm² | d ln ζ/d ln R_max",
    "seen": "set | shots | ζ of the fit | ζ of growth and collapse | correlation",
    "water": "free besides µ, λ, clock, R_max | interval of µ holds 0.001 | its upper end, Pa s | RMSE, %",
}
COLOURS = {
    "PEG 40 w/v %": style.BLUE, "PEG 10 w/v %": "#56b4e9", "stiff PA": style.VERMILLION, "alginate": "#e69f00",
    "agarose 0.5 %": "#009e73", "agarose 2.5 %": "#cc79a7", "PEGDA 0.05": style.INK, "PEGDA 0.10": style.PALE,
}  # fmt: skip
Found = dict[str, dict[str, dict[int, dict[str, Any]]]]  # set, bubble, shot


def found_of(kept: Mapping[str, Any], kind: str, needs: str) -> Found:
    """Records of a kind that have what is needed, sets in the order of SETS."""
    found: Found = {name: defaultdict(dict) for name in SETS}
    for key, record in kept.items():
        if key.startswith(f"{kind}/") and record.get(needs) is not None and record.get("best"):
            group, bubble, shot = key.removeprefix(f"{kind}/").rsplit("/", 2)
            found[group][bubble][int(shot)] = record
    return {group: bubbles for group, bubbles in found.items() if bubbles}


def common(bubbles: Mapping[str, dict[int, Any]], names: Iterable[str]) -> list[int]:
    """The shots that each of the bubbles answered: only they are compared."""
    return sorted(set.intersection(*(set(bubbles.get(name, {})) for name in names)))


def of(records: Iterable[Mapping[str, Any]], name: str) -> np.ndarray:
    """A number of each record, or one of its parameters; NaN where it has none."""
    values = [record.get(name, record["best"].get(name)) for record in records]
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def pair(bubbles: Mapping[str, dict[int, Any]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """A number of the shots that both answered: field, real."""
    shots = common(bubbles, ("field", "real"))
    field, real = (of([bubbles[bubble][i] for i in shots], name) for bubble in ("field", "real"))
    return field, real


def spread(values: np.ndarray, digits: int = 2) -> str:
    """Median (quartiles)."""
    known = values[np.isfinite(values)]
    if not len(known):
        return ""
    low, middle, high = (f"{v:.{digits}g}" for v in np.quantile(known, [0.25, 0.5, 0.75]))
    return f"{middle} ({low} to {high})"


def slope(radius: np.ndarray, values: np.ndarray) -> str:
    """d ln value/d ln R_max with its 90 % interval, by least squares."""
    (x, y), n = np.log([radius, values]), len(radius)
    if n < 4:
        return ""
    coefficients, covariance = np.polyfit(x, y, 1, cov=True)
    return f"{coefficients[0]:.2f} ± {student.ppf(0.95, n - 2) * np.sqrt(covariance[0, 0]):.2f}"


def table(columns: str, rows: Iterable[Iterable[Any]]) -> str:
    names = columns.split("|")
    lines = ["|".join(["", *(f" {name.strip()} " for name in names), ""]), "|" + "---|" * len(names)]
    return "\n".join([*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)])


# --- tables


def peg_rows(kept: Mapping[str, Any], found: Found) -> Iterable[list[Any]]:
    for group in (name for name in PUBLISHED if name in found):
        both = common(found[group], ("field", "real"))
        steady = [i for i in both if not kept[f"late/{group}/{i}"]]
        parts = [("", both), *([(", no late rise", steady)] if len(steady) < len(both) else [])]
        for (word, shots), bubble in ((part, bubble) for part in parts for bubble in ("field", "real")):
            records = [found[group][bubble][i] for i in shots]
            R, mu, rmse = (of(records, name) for name in ("rmax_um", "viscosity", "rmse"))
            mean, std = PUBLISHED[group]
            yield [
                group + word, len(shots), f"{RHEOMETER[group]:g}", f"{mean:g} ± {std:g}", bubble, spread(mu),
                f"{np.median(mu) / RHEOMETER[group]:.2g}", f"{np.std(np.log10(mu), ddof=1):.2f}", slope(R, mu),
                f"{np.median(rmse):.2g}", f"{np.count_nonzero(rmse < 2)} of {len(rmse)}",
            ]  # fmt: skip


def set_rows(found: Found) -> Iterable[list[Any]]:
    for group, bubbles in found.items():
        shots = common(bubbles, ("field", "real"))
        (old, new), (low, high) = pair(bubbles, "rmse"), pair(bubbles, "evidence")
        ok = [sum(bubbles[bubble][i]["verdict"] == "ok" for i in shots) for bubble in ("field", "real")]
        yield [
            group, len(shots), spread(old), spread(new), int(np.sum(new < old)), *ok,
            spread(high - low), int(np.sum(high > low)),
        ]  # fmt: skip


def ahead_rows(ahead: Found) -> Iterable[list[Any]]:
    totals = np.zeros(3, dtype=int)
    for group, bubbles in ahead.items():
        shots = common(bubbles, ("field", "real", "others"))
        field, real, others = (of([bubbles[b][i] for i in shots], "ahead") for b in ("field", "real", "others"))
        counts = [len(shots), int(np.sum(real < field)), int(np.sum(others < field))]
        totals += counts
        yield [group, counts[0], spread(field), spread(real), counts[1], spread(others), counts[2]]
    yield ["all", totals[0], "", "", totals[1], "", totals[2]]


def gains(found: Found) -> dict[str, float]:
    """Mean log evidence of the real bubble over the field's in a shot of each set; no shot counts beyond +-10, so that
    a few shots that one bubble cannot follow do not choose for all."""
    pairs = {group: pair(bubbles, "evidence") for group, bubbles in found.items()}
    return {group: float(np.mean(np.clip(real - field, -10, 10))) for group, (field, real) in pairs.items()}


def chosen_rows(found: Found) -> Iterable[list[Any]]:
    """The bubble that the other sets choose, in the set that is left out."""
    known = gains(found)
    for group, own in known.items():
        rest = float(np.mean([gain for name, gain in known.items() if name != group]))
        yield [group, "real" if rest > 0 else "field", f"{rest:+.1f}", f"{own:+.1f}"]


def fit_rows(found: Found) -> Iterable[list[Any]]:
    for group, bubbles in found.items():
        names = [bubble for bubble in BUBBLES if bubble in bubbles]
        shots = common(bubbles, names)
        field = of([bubbles["field"][i] for i in shots], "evidence")
        for bubble in names:
            records = [bubbles[bubble][i] for i in shots]
            later = [[c[k] for c in (r["cycles"] for r in records) if len(c) > k] for k in range(3)]
            yield [
                group, bubble, len(shots), spread(of(records, "rmse")),
                ", ".join(f"{np.median(values):.1f}" for values in later if values),
                spread(of(records, "shear_modulus") / 1e3), spread(of(records, "viscosity")),
                *(spread(of(records, name)) for name in ("accommodation", "confinement_damping")),
                f"{np.nanmedian(of(records, 'evidence') - field):+.0f}",
            ]  # fmt: skip


def growth_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    for name in (*SETS, "water"):
        R, even, gamma = np.array([shot for shot in kept[f"growth/{name}"] if np.isfinite(shot[2])]).reshape(-1, 3).T
        if len(R) < 4:
            continue
        viscosity = RHEOMETER.get(name, 0.0)
        zeta = np.array([resistance(1e-6 * r, g, viscosity) for r, g in zip(R, gamma, strict=True)])
        area = f"{1e6 * cross_section(kept[f'growth/{name}'], viscosity):.0f}"
        yield [name, len(R), spread(even, 3), spread(gamma), spread(zeta), area, slope(R, np.maximum(zeta, 1e-3))]


def seen_rows(kept: Mapping[str, Any], found: Found) -> Iterable[list[Any]]:
    """zeta that a fit finds after R_max, beside that of growth and collapse of the same shot."""
    for group, bubbles in found.items():
        answers, shots = bubbles.get("real", {}), kept[f"growth/{group}"]
        theirs = {i: resistance(1e-6 * shots[i][0], shots[i][2], RHEOMETER.get(group, 0.0)) for i in answers}
        both = [i for i, value in theirs.items() if np.isfinite(value)]
        if len(both) > 3:
            ours, other = of([answers[i] for i in both], "confinement_damping"), np.array([theirs[i] for i in both])
            yield [group, len(both), spread(ours), spread(other), f"{np.corrcoef(ours, other)[0, 1]:.2f}"]


def water_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    for model in WATER_MODELS:
        answers = [r for n, r in kept.items() if n.startswith(f"water/{model}/") and "best" in r]
        if answers:
            low, high = np.array([r["intervals"]["viscosity"] or (np.nan, np.nan) for r in answers]).T  # no draws
            held = np.count_nonzero((low <= RHEOMETER["water"]) & (high >= RHEOMETER["water"]))
            yield [model, f"{held} of {len(answers)}", spread(high), spread(of(answers, "rmse"))]


# --- pictures


def axes_of(places: int, height: float, labels: list[tuple[str, str]]) -> tuple[Any, list[Any]]:
    figure, width = style.new_figure(height), 1 / places
    drawn = [(0.085 + width * k, 0.46 / height, width - 0.1, 1 - 0.76 / height) for k in range(places)]
    return figure, [style.new_axes(figure, place, *label) for place, label in zip(drawn, labels, strict=True)]


def draw_peg(found: Found) -> Any:
    """Viscosity of each shot over its R_max, between rheometer and the field's mean."""
    figure, panels = axes_of(len(PUBLISHED), 3.2, [("R_max (µm)", "viscosity (Pa s)")] * len(PUBLISHED))
    for (group, (mean, std)), axes in zip(PUBLISHED.items(), panels, strict=True):
        axes.axhspan(mean - std, mean + std, color=style.PALE, alpha=0.2, lw=0, label="IMR, published")
        for bubble, colour, mark in (("field", style.PALE, "o"), ("real", style.VERMILLION, "s")):
            records = list(found.get(group, {}).get(bubble, {}).values())
            fine = of(records, "rmse") < 2
            R, mu = of(records, "rmax_um"), of(records, "viscosity")
            how: dict[str, Any] = {"ls": "", "color": colour, "marker": mark, "ms": 4.5}
            axes.plot(R[fine], mu[fine], label=f"{bubble} bubble" if fine.any() else "", **how)
            axes.plot(R[~fine], mu[~fine], mfc="white", label="" if fine.any() else f"{bubble} bubble", **how)
        axes.axhline(RHEOMETER[group], color=style.INK, lw=1, label="rheometer")
        axes.set_yscale("log")
        axes.yaxis.set_minor_formatter("")
        if RHEOMETER[group] > 0.05:
            axes.set_yticks([0.05, 0.1, 0.2, 0.4], ["0.05", "0.1", "0.2", "0.4"])
        axes.set_title(group, fontsize=8.5)
    panels[0].legend(fontsize=7, frameon=False)
    return figure


def draw_sets(found: Found) -> Any:
    """RMSE of every shot with both bubbles."""
    figure, (axes,) = axes_of(1, 3.2, [("", "RMSE (% of R_max)")])
    for k, (_, bubbles) in enumerate(found.items()):
        for values, colour, aside in zip(
            pair(bubbles, "rmse"), (style.PALE, style.VERMILLION), (-0.17, 0.17), strict=True
        ):
            x = k + aside + np.linspace(-0.1, 0.1, len(values))
            axes.plot(x, values, ".", color=colour, ms=4.5)
            axes.plot([k + aside - 0.14, k + aside + 0.14], [np.median(values)] * 2, color=style.BLACK, lw=1.2)
    axes.axhline(2, color=style.INK, lw=0.7, ls=":")
    axes.set_ylim(0, None)
    axes.set_xticks(range(len(found)), [name.replace(" ", "\n", 1) for name in found], fontsize=7.5)
    axes.set_title("each shot, and the median of a set; grey: the field's bubble, red: the real one", fontsize=8.5)
    return figure


def draw_ahead(ahead: Found) -> Any:
    """Frames after the first rebound, predicted by both bubbles."""
    height = 4.2
    figure = style.new_figure(height)
    labels = "field's bubble: RMS ahead (% of R_max)", "real bubble: RMS ahead (% of R_max)"
    axes = style.new_axes(figure, (0.09, 0.5 / height, 0.5, 1 - 0.6 / height), *labels)
    for group, bubbles in ahead.items():
        axes.plot(*pair(bubbles, "ahead"), "o", color=COLOURS[group], ms=4.5, label=group)
    ends = [0.5, 40]
    axes.plot(ends, ends, color=style.INK, lw=0.8)
    for scale, limit, ticks in (
        (axes.set_xscale, axes.set_xlim, axes.set_xticks),
        (axes.set_yscale, axes.set_ylim, axes.set_yticks),
    ):
        scale("log")
        limit(*ends)
        ticks([0.5, 1, 2, 5, 10, 20, 40], ["0.5", "1", "2", "5", "10", "20", "40"])
    axes.minorticks_off()
    axes.text(0.97, 0.05, "real nearer", transform=axes.transAxes, ha="right", fontsize=8, color=style.INK)
    axes.text(0.03, 0.95, "field nearer", transform=axes.transAxes, va="top", fontsize=8, color=style.INK)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.04, 1.0))
    return figure


def draw_growth(kept: Mapping[str, Any]) -> Any:
    labels = [("R_max (µm)", "even part"), ("R_max (µm)", "resistance ζ")]
    figure, (left, right) = axes_of(2, 3.0, labels)
    marks = {"PEG 10 w/v %": (style.BLUE, "o"), "PEG 40 w/v %": (style.VERMILLION, "s"), "alginate": ("#009e73", "^"),
             "water": (style.INK, "x")}  # fmt: skip
    for name, (colour, mark) in marks.items():
        R, even, gamma = np.array(kept[f"growth/{name}"]).T
        zeta = np.array([resistance(1e-6 * r, g, RHEOMETER.get(name, 0.0)) for r, g in zip(R, gamma, strict=True)])
        how: dict[str, Any] = {"color": colour, "marker": mark, "ls": "", "ms": 4, "mew": 1, "label": name}
        left.plot(R, even, **how)
        right.plot(R, zeta, **how)
    R = np.linspace(100, 350, 50)
    area = cross_section(kept["growth/PEG 10 w/v %"], RHEOMETER["PEG 10 w/v %"])
    label = f"tube of {1e6 * area:.0f} mm²"
    right.plot(R, 2 * np.pi * (1e-6 * R) ** 2 / area * SPEED, color=style.INK, lw=1, label=label)
    right.set_ylim(0, 1)
    right.legend(fontsize=7, frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/real-bubbles"))
    given = parser.parse_args()
    kept = json.loads(given.results.read_text("utf-8"))
    found, ahead = found_of(kept, "fit", "evidence"), found_of(kept, "ahead", "ahead")
    rows = {
        "peg": peg_rows(kept, found), "sets": set_rows(found), "ahead": ahead_rows(ahead),
        "chosen": chosen_rows(found), "fits": fit_rows(found), "growth": growth_rows(kept),
        "seen": seen_rows(kept, found), "water": water_rows(kept),
    }  # fmt: skip
    for name, cells in rows.items():
        if lines := list(cells):
            print(f"## {name}\n{table(COLUMNS[name], lines)}\n")
    given.out.mkdir(parents=True, exist_ok=True)
    pictures = {
        "peg": draw_peg(found), "sets": draw_sets(found), "ahead": draw_ahead(ahead), "growth": draw_growth(kept),
    }  # fmt: skip
    for name, figure in pictures.items():
        style.save(given.out / f"{name}.png", figure, dpi=110)


if __name__ == "__main__":
    main()
