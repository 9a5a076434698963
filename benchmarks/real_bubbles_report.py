"""Tables and pictures of docs/real-bubbles.md from what benchmarks/real_bubbles.py kept.

    python benchmarks/real_bubbles_report.py results.json docs/real-bubbles.md

Replaces what stands between `<!-- table: NAME -->` and `<!-- end -->` of the page, and the pictures in the folder
beside it that has its name. No recording is drawn: summaries of residuals, fitted parameters and evidence only.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from real_bubbles import RHEOMETER, SPEED, WATER_MODELS, cross_section, resistance
from scipy.stats import t as student

from cavirheo.writing import style

PARAMETERS = {
    "accommodation": "alpha",
    "confinement_inertia": "beta",
    "exponent": "n",
    "damage_modulus": "m",
    "damage_radius": "r",
}
COLUMNS = {
    "growth": "set | shots | even | γ | ζ | A, mm² | d ln ζ/d ln R_max",
    "fits": "set | model | shots | RMSE, % | chi2/frame | RMSE of cycles 1, 2, 3 | G, kPa | µ, Pa s | others | log evidence over equilibrium",  # noqa: E501
    "seen": "set | shots | ζ of the fit | ζ of growth and collapse | ratio | correlation",
    "peg": "set | model | µ, Pa s | over rheometer | scatter, decades | d ln µ/d ln R_max | RMSE < 2 %",
    "ahead": "set | shots | chi2: equilibrium, kinetic | better | log density | better | RMS ahead, % | better",
    "controls": "simulated | answered with | G over truth | µ over truth | interval of µ holds | accommodation | chi2/frame",  # noqa: E501
    "water": "free besides µ, λ, clock, R_max | interval of µ holds 0.001 | its upper end, Pa s | RMSE, %",
}
Found = dict[str, dict[str, dict[int, dict[str, Any]]]]  # set, model, shot


def fits(kept: Mapping[str, Any]) -> Found:
    found: Found = defaultdict(lambda: defaultdict(dict))
    for name, record in kept.items():
        if name.startswith("fit/") and "best" in record:
            group, model, shot = name.removeprefix("fit/").rsplit("/", 2)
            found[group][model][int(shot)] = record
    return found


def common(models: Mapping[str, dict[int, Any]]) -> list[int]:
    """The shots that every model answered: only they are compared."""
    return sorted(set.intersection(*(set(shots) for shots in models.values())))


def of(records: Iterable[Mapping[str, Any]], name: str) -> np.ndarray:
    """A number of each record, or one of its parameters; NaN where it has none."""
    values = [record.get(name, record["best"].get(name)) for record in records]
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def spread(values: np.ndarray, digits: int = 2) -> str:
    """Median (least to largest)."""
    known = values[np.isfinite(values)]
    if not len(known):
        return ""
    middle, low, high = (f"{v:.{digits}g}" for v in (np.median(known), known.min(), known.max()))
    return f"{middle} ({low} to {high})"


def slope(radius: np.ndarray, values: np.ndarray) -> str:
    """d ln value/d ln R_max with its 90 % interval."""
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


def growth_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    for name, shots in sorted((n.removeprefix("growth/"), s) for n, s in kept.items() if n.startswith("growth/")):
        R, even, gamma = np.array([shot for shot in shots if np.isfinite(shot[2])]).reshape(-1, 3).T
        if len(R) < 4:
            continue
        viscosity = RHEOMETER.get(name, 0.0)
        zeta = np.array([resistance(1e-6 * r, g, viscosity) for r, g in zip(R, gamma, strict=True)])
        area = f"{1e6 * cross_section(shots, viscosity):.0f}"
        yield [name, len(R), spread(even, 3), spread(gamma), spread(zeta), area, slope(R, np.maximum(zeta, 1e-3))]


def fit_rows(found: Found) -> Iterable[list[Any]]:
    for group, models in found.items():
        shots = common(models)
        first = of([models["equilibrium"][i] for i in shots], "evidence")
        for model, answers in models.items():
            records = [answers[i] for i in shots]
            gain = of(records, "evidence") - first
            later = [[c[k] for c in (r["cycles"] for r in records) if len(c) > k] for k in range(3)]
            more = [f"{word} {spread(of(records, name))}" for name, word in PARAMETERS.items()]
            yield [
                group, model, len(shots), spread(of(records, "rmse")), spread(of(records, "chi2")),
                ", ".join(f"{np.median(values):.1f}" for values in later if values),
                spread(of(records, "shear_modulus") / 1e3), spread(of(records, "viscosity")),
                "; ".join(word for word in more if word.count(" ") > 0 and word.split(" ", 1)[1]),
                f"{np.median(gain):+.0f}" if np.isfinite(gain).any() else "",
            ]  # fmt: skip


def peg_rows(found: Found) -> Iterable[list[Any]]:
    for group in ("PEG 40 w/v %", "PEG 10 w/v %"):
        models = found.get(group, {})
        for model, answers in models.items():
            records = [answers[i] for i in common(models)]
            R, mu, rmse = (of(records, name) for name in ("rmax_um", "viscosity", "rmse"))
            ratio = np.median(mu) / RHEOMETER[group]
            scatter = np.std(np.log10(mu), ddof=1) if len(mu) > 1 else np.nan
            below = f"{np.count_nonzero(rmse < 2)} of {len(rmse)}"
            yield [group, model, spread(mu), f"{ratio:.2g}", f"{scatter:.2f}", slope(R, mu), below]


def seen_rows(kept: Mapping[str, Any], found: Found) -> Iterable[list[Any]]:
    """zeta that a fit finds after R_max, beside that of growth and collapse of the same shot."""
    for group, models in found.items():
        answers, shots = models.get("power-law, free sound", {}), kept[f"growth/{group}"]
        ours = of(answers.values(), "confinement_damping")
        theirs = np.array([resistance(1e-6 * shots[i][0], shots[i][2], RHEOMETER[group]) for i in answers])
        if len(ours) > 3:
            ratio, alike = spread(ours / theirs), np.corrcoef(ours, theirs)[0, 1]
            yield [group, len(ours), spread(ours), spread(theirs), ratio, f"{alike:.2f}"]


def ahead_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for name, record in kept.items():
        if name.startswith("ahead/") and all("best" in record[model] for model in record):
            groups[name.removeprefix("ahead/").rsplit("/", 1)[0]].append(record)
    for group, records in groups.items():
        cells: list[Any] = [group, len(records)]
        for name, sign in (("chi2", -1), ("density", 1), ("ahead", -1)):
            old, new = (np.array([record[model][name] for record in records]) for model in ("equilibrium", "kinetic"))
            cells += [f"{np.median(old):.3g}, {np.median(new):.3g}", int(np.sum(sign * (new - old) > 0))]
        yield cells


def control_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    for truth in ("kinetic", "equilibrium"):
        for model in ("equilibrium", "infer equilibrium", "kinetic", "infer kinetic"):
            pairs = [(kept[f"control/{truth}/{i}"], kept.get(f"control/{truth}/{i}/{model}"))
                     for i in range(10) if f"control/{truth}/{i}" in kept]  # fmt: skip
            known = [(true, answer) for true, answer in pairs if answer and "best" in answer]
            if known:
                records = [answer for _, answer in known]
                G, mu = (np.array([a["best"][n] / t[n] for t, a in known]) for n in ("shear_modulus", "viscosity"))
                held = sum(
                    bool(a["interval"]) and a["interval"][0] <= t["viscosity"] <= a["interval"][1] for t, a in known
                )
                cells = [spread(G), spread(mu), f"{held} of {len(known)}", spread(of(records, "accommodation"))]
                how = model.replace("infer ", "") + (", by `infer`" if "infer" in model else ", by `fit`")
                yield [truth, how, *cells, spread(of(records, "chi2"))]


def water_rows(kept: Mapping[str, Any]) -> Iterable[list[Any]]:
    for model in WATER_MODELS:
        answers = [r for n, r in kept.items() if n.startswith(f"water/{model}/") and "best" in r]
        if answers:
            low, high = np.array([r["interval"] or (np.nan, np.nan) for r in answers]).T  # no draws: not held
            held = np.count_nonzero((low <= RHEOMETER["water"]) & (high >= RHEOMETER["water"]))
            yield [model, f"{held} of {len(answers)}", spread(high), spread(of(answers, "rmse"))]


# --- pictures


def axes_of(places: int, height: float, labels: list[tuple[str, str]]) -> tuple[Any, list[Any]]:
    figure, width = style.new_figure(height), 1 / places
    drawn = [(0.085 + width * k, 0.46 / height, width - 0.1, 1 - 0.76 / height) for k in range(places)]
    return figure, [style.new_axes(figure, place, *label) for place, label in zip(drawn, labels, strict=True)]


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


def usual(models: Iterable[str]) -> list[str]:
    return [model for model in models if not model.endswith("motion")]


def best_of(models: Mapping[str, dict[int, Any]]) -> str:
    """The model with the largest median evidence, of those that were fitted with the default's weights."""
    shots = common(models)
    return max(usual(models), key=lambda model: np.nanmedian(of([models[model][i] for i in shots], "evidence")))


def draw_cycles(found: Found) -> Any:
    figure, (axes,) = axes_of(1, 3.2, [("", "RMS residual of a cycle (% of R_max)")])
    labels = []
    for k, (group, models) in enumerate(found.items()):
        best, shots = best_of(models), common(models)
        labels.append(f"{group}\n{best}")
        for model, colour, aside in (("equilibrium", style.PALE, -0.06), (best, style.VERMILLION, 0.06)):
            for cycle in range(3):
                values = [c[cycle] for c in (models[model][i]["cycles"] for i in shots) if len(c) > cycle]
                x = k + (cycle - 1) * 0.27 + aside
                axes.plot([x, x], [min(values), max(values)], color=colour, lw=1.2)
                axes.plot([x], [np.median(values)], "o", color=colour, ms=4.5)
                axes.text(x - aside, 0.02, "123"[cycle], fontsize=6.5, ha="center", color=style.INK)
    axes.set_xticks(range(len(labels)), labels, fontsize=6)
    axes.set_ylim(0, None)
    axes.set_title("grey: the field's model; red: the model that the evidence prefers; cycles 1, 2, 3", fontsize=8)
    return figure


def draw_peg(found: Found) -> Any:
    groups = [group for group in ("PEG 40 w/v %", "PEG 10 w/v %") if group in found]
    figure, panels = axes_of(len(groups), 3.2, [("R_max (µm)", "viscosity (Pa s)")] * len(groups))
    shown = {
        "equilibrium": (style.PALE, "o"), "kinetic, walls": (style.BLUE, "^"),
        "kinetic, walls, sound": ("#009e73", "D"), "power-law, sound": (style.VERMILLION, "s"),
    }  # fmt: skip
    for group, axes in zip(groups, panels, strict=True):
        for model, (colour, mark) in shown.items():
            records = list(found[group].get(model, {}).values())
            points = of(records, "rmax_um"), of(records, "viscosity")
            axes.plot(*points, ls="", color=colour, marker=mark, ms=4, label=model)
        axes.axhline(RHEOMETER[group], color=style.INK, lw=1)
        axes.set_yscale("log")
        if RHEOMETER[group] > 0.05:
            axes.set_yticks([0.05, 0.1, 0.2, 0.4], ["0.05", "0.1", "0.2", "0.4"])
        axes.yaxis.set_minor_formatter("")
        axes.set_title(f"{group}; line: rheometer", fontsize=8)
    panels[0].legend(fontsize=7, frameon=False)
    return figure


def draw_evidence(found: Found) -> Any:
    rows = [(group, model) for group, models in found.items() for model in usual(models) if model != "equilibrium"]
    figure = style.new_figure(0.22 * len(rows) + 0.9)
    height = 0.22 * len(rows) + 0.9
    axes = style.new_axes(
        figure, (0.34, 0.5 / height, 0.63, 1 - 0.6 / height), "log evidence over equilibrium, each shot", ""
    )
    for k, (group, model) in enumerate(rows):
        both = [i for i in found[group][model] if i in found[group]["equilibrium"]]
        gain = of([found[group][model][i] for i in both], "evidence")
        gain -= of([found[group]["equilibrium"][i] for i in both], "evidence")
        axes.plot(gain, np.full(len(gain), -k), "|", color=style.BLUE, ms=8)
        axes.plot([np.nanmedian(gain)], [-k], "o", color=style.VERMILLION, ms=4)
    axes.set_xscale("symlog", linthresh=3)
    axes.axvline(0, color=style.INK, lw=0.8)
    axes.set_yticks([-k for k in range(len(rows))], [f"{group}: {model}" for group, model in rows], fontsize=7.5)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("page", type=Path)
    given = parser.parse_args()
    kept = json.loads(given.results.read_text("utf-8"))
    found = fits(kept)
    rows = {
        "growth": growth_rows(kept), "seen": seen_rows(kept, found), "fits": fit_rows(found), "peg": peg_rows(found),
        "ahead": ahead_rows(kept), "controls": control_rows(kept), "water": water_rows(kept),
    }  # fmt: skip
    page = given.page.read_text("utf-8")
    for name, cells in rows.items():
        before, after = f"<!-- table: {name} -->\n", "<!-- end -->"
        head, _, rest = page.partition(before)
        page = head + before + table(COLUMNS[name], cells) + "\n" + after + rest.partition(after)[2]
    given.page.write_text(page, encoding="utf-8")
    (folder := given.page.with_suffix("")).mkdir(exist_ok=True)
    pictures = {
        "growth": draw_growth(kept), "cycles": draw_cycles(found), "peg": draw_peg(found),
        "evidence": draw_evidence(found),
    }  # fmt: skip
    for name, figure in pictures.items():
        style.drawn(figure, 110).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
