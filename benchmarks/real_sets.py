"""Conventional fits of real sets beside published values: over one collapse and over three.

    python benchmarks/real_sets.py FOLDER [--references examples/published_values.csv] [--sets WORD] [-o OUT]

FOLDER and the CSV file are those of `cavirheo compare` (docs/how-to/compare.md).
Its columns files, medium, density, stretch and rmax_um hold here, too.
A set without a published G is fitted as Newtonian, the others as NHKV.
Each set is fitted over 1 and 3 collapses; clock and R_max are free as by default.
The bubble is the field's, as in the published values.
"Shots" is mean and standard deviation of the fits of single shots, with RMSE (% of R_max, median) and verdicts.
"One" is one material for all shots, from the draws of each: median and 90 % interval.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cavirheo import population
from cavirheo.companions.comparison import shots_of
from cavirheo.companions.published_values import ReferenceSet, read_references
from cavirheo.inference import fit_many
from cavirheo.posterior import Posterior
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, spread_of

COLUMNS = ("set", "published", "window", "G, shots (kPa)", "G, one", "µ, shots (Pa s)", "µ, one",
           "RMSE, %", "verdicts of shots", "at bounds")  # fmt: skip
FIELDS = {"shear_modulus": (1e-3, "kPa"), "viscosity": (1.0, "Pa s")}


def published(about: ReferenceSet) -> str:
    """'IMR 6.44 ± 1.64 kPa, 0.02 ± 0.009 Pa s'."""
    words = []
    for method, values in about.values.items():
        shown = []
        for name, value in values.items():
            factor, unit = FIELDS[name]
            std = "" if value.std is None else f" ± {value.std * factor:.3g}"
            shown.append(f"{value.mean * factor:.4g}{std} {unit}")
        words.append(f"{method} {', '.join(shown)}")
    return "; ".join(words)


def row(answers: list[Posterior]) -> list[str]:
    """The cells from G on, of the answers of one set."""
    done = [a for a in answers if a.checks.verdict != "failed"]
    material = population(answers, only_trusted=False)
    cells = []
    for name, (factor, _) in FIELDS.items():
        cells.append(digits.spread(spread_of([a.best.get(name) for a in done]), factor))
        known = name in material.names and len(material.common)  # a liquid has no G
        low, middle, high = material.if_common(name) if known else (None, None, None)
        cells.append(digits.quantity(Quantity(median=middle, q05=low, q95=high), factor) if known else "")
    verdicts = Counter(a.checks.verdict for a in answers)
    bounds = Counter(name for a in done for name in a.diagnostics.at_bound)
    rmse = np.median([a.checks.rmse_over_rmax for a in done]) if done else np.nan
    return [
        *cells, f"{100 * rmse:.2g}", ", ".join(f"{digits.VERDICT_WORDS[v]} {n}" for v, n in verdicts.items() if n),
        ", ".join(f"{name} {n}" for name, n in bounds.items()),
    ]  # fmt: skip


def rows(about: ReferenceSet, folder: Path, references: Path) -> Iterator[list[str]]:
    read = shots_of(about, folder, references)
    if read.problems or not read.curves:
        notes = "; ".join(read.problems + read.remarks)
        yield [about.name, published(about), notes or "no curves", *[""] * (len(COLUMNS) - 3)]
        return
    curves = [replace(curve, meta={**curve.meta, "group": about.name, "group_source": ""}) for curve in read.curves]
    law = "nhkv" if about.solid else "newtonian"
    for window in (1, 3):
        answers = fit_many(
            curves, law, medium=about.medium, stretch=about.settings.get("stretch"), window=window,
            bubble="field",
        )  # fmt: skip
        head = [f"{about.name} ({law}, {len(curves)} shots, {about.medium.density:g} kg/m³)", published(about)]
        yield [*head, str(window), *row(answers)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--references", type=Path, default=Path("examples/published_values.csv"))
    parser.add_argument("--sets", default="", help="only sets whose name contains this")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/real_sets.md"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    lines = ["# Conventional fits of real sets", "", *(f"{line}" for line in (__doc__ or "").splitlines()[4:] if line)]
    lines += ["", "| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    for about in read_references(given.references):
        if given.sets in about.name and about.recorded:
            for cells in rows(about, given.folder, given.references):
                lines.append("| " + " | ".join(cells) + " |")
                print(lines[-1], flush=True)
                given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
