"""Real recordings with and without condensation at a finite rate: residuals, parameters, accommodation.

    python benchmarks/real_bubbles.py FOLDER [--shots 5] [--sets WORD,WORD] [-o real_bubbles.md]

FOLDER holds a folder for each set of SETS, which says the files, the law and the models of the bubble that are fitted.
Fits are those of `cavirheo fit --free t0 --t0-us FRAME` over three collapses; the first so many shots are taken, none
is left out. chi2 is the mean square of (measured - simulated)/sigma with the weights of the fit. Medians over shots.
A model with further parameters must fit better; whether by enough tells the evidence (`cavirheo which-law`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.inference.experiment import Experiment, Options
from cavirheo.inference.fit import fit_many
from cavirheo.inference.law import Family
from cavirheo.posterior import BubbleModel, Posterior
from cavirheo.reading import read_curves

KINETIC: dict[str, Any] = {"contents": "kinetic"}
EQUILIBRIUM: dict[str, Any] = {}
WALLS: dict[str, Any] = {**KINETIC, "wall_inertia": "free"}
DAMAGE: dict[str, Any] = {"damage": "first-rebound"}
HURT: dict[str, Any] = {**KINETIC, **DAMAGE, "accommodation": 0.07}


class Set(NamedTuple):
    """A set of recordings: its files, the law, and what is fitted."""

    files: str
    material: str
    models: tuple[dict[str, Any], ...]


SETS = {
    "stiff PA": Set("pa_stiff/RofT_shifted_20_shots.mat", "nhkv", (EQUILIBRIUM, KINETIC)),
    "alginate": Set("paam_alginate_0p3/*.mat", "nhkv", (EQUILIBRIUM, KINETIC)),
    "agarose 0.5 %": Set("agarose_0p5/*.mat", "nhkv", (EQUILIBRIUM, KINETIC, HURT)),
    "agarose 2.5 %": Set("agarose_2p5/*.mat", "nhkv", (EQUILIBRIUM, DAMAGE, HURT)),
    "PEG 40 w/v %": Set("peg8000_40wv/*.mat", "newtonian", (EQUILIBRIUM, KINETIC, WALLS)),
    "PEG 10 w/v %": Set("peg8000_10wv/*.mat", "newtonian", (EQUILIBRIUM, KINETIC, WALLS)),
}
COLUMNS = ("set", "shots", "model", "RMSE, %", "chi2/frame", "G, kPa", "µ, Pa s", "λ", "accommodation", "β, damage",
           "s a shot")  # fmt: skip


def chi2(curve: RadiusCurve, answer: Posterior, options: dict[str, Any]) -> float:
    """Per frame, with the weights of the simulated motion, as the fit ends."""
    shot = Experiment(curve, Family(answer.material), options=Options(**options, bubble=answer.bubble))
    best = answer.best
    free = {name: (best[name] - middle) / width for name, (middle, width, _) in shot.free.items()}
    x = np.array([free[name] if name in free else np.log10(best[name]) for name in shot.names])
    seen = shot.predict(x)
    if seen is None:
        return np.nan
    shot.weigh(seen.speed)
    return float(np.mean(shot.residual(seen)[shot.counted] ** 2))


def spread(values: list[float], digits: int = 2) -> str:
    """Median (least to largest)."""
    known = np.array([v for v in values if v is not None and np.isfinite(v)])
    if not len(known):
        return ""
    middle, low, high = (f"{v:.{digits}g}" for v in (np.median(known), known.min(), known.max()))
    return f"{middle} ({low}-{high})" if len(known) > 1 else middle


def rows(folder: Path, name: str, about: Set, shots: int) -> Iterator[list[str]]:
    curves = [curve for file in sorted(folder.glob(about.files)) for curve in read_curves(file)][:shots]
    for model in about.models:
        frame = max(float(np.median(np.diff(curve.time))) for curve in curves)
        options = {"free": ("t0",), "t0_bound": frame}
        began = time.process_time()
        answers = fit_many(curves, about.material, trust_input=True, **options, **model)
        seconds = (time.process_time() - began) / len(curves)
        pairs = [(c, a) for c, a in zip(curves, answers, strict=True) if a.checks.verdict != "failed"]
        best = [answer.best for _, answer in pairs]
        further = [
            spread([b[n] for b in best]) for n in ("wall_inertia", "damage_modulus", "damage_radius") if n in best[0]
        ]
        words = BubbleModel(**model).name + (", walls" if "wall_inertia" in model else "")
        yield [
            name, f"{len(pairs)} of {len(curves)}", words,
            spread([100 * (a.checks.rmse_over_rmax or np.nan) for _, a in pairs], 3),
            spread([chi2(curve, answer, options) for curve, answer in pairs], 3),
            spread([b["shear_modulus"] / 1e3 for b in best]) if "shear_modulus" in best[0] else "",
            spread([b["viscosity"] for b in best]), spread([b["stretch"] for b in best]),
            spread([b["accommodation"] for b in best]) if "accommodation" in best[0] else "",
            "; ".join(further), f"{seconds:.1f}",
        ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=5)
    parser.add_argument("--sets", default="", help="words of the sets' names, with commas")
    parser.add_argument("-o", "--out", type=Path)
    given = parser.parse_args()
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    print("\n".join(lines))
    words = [word.strip() for word in given.sets.split(",")]
    for name, about in SETS.items():
        if any(word in name for word in words):
            for row in rows(given.folder, name, about, given.shots):
                lines.append("| " + " | ".join(row) + " |")
                print(lines[-1], flush=True)
    if given.out:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
