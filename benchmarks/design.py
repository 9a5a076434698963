"""`cavirheo design` against experiments: intervals that were predicted, and those that `infer` then gives.

    python benchmarks/design.py [folder] [experiments]    goes on where it was stopped; writes benchmarks/design.md

Materials, stretches and noise of the simulated experiments are drawn apart from those of the prediction.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from itertools import product
from pathlib import Path

import numpy as np

from cavirheo import InputError, infer_many
from cavirheo.inference.design import NORMAL_90, Setting, expectations
from cavirheo.inference.law import Family
from cavirheo.prior import Prior

HERE = Path(__file__).resolve().parent
KNOWN = {"log10_shear_modulus": np.log10([3e3, 1.2e4]), "log10_viscosity": np.log10([0.03, 0.1]), "stretch": [5.0, 8.0]}
RADII, RATES, FRAMES = (100e-6, 150e-6, 250e-6, 400e-6), (250e3, 500e3, 1e6), 128
DEFAULT = (150e-6, 250e3)
WANTED = np.log10(1.1)  # decades
DRAWS, OTHER_SEED = 12, 1000  # of the prediction; of the experiments' noise
NAMES = ("shear_modulus", "viscosity")


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2) log10 of the law's parameters and (count,) stretches of what is known."""
    x = Prior.uniform(KNOWN).sample(count, seed)
    return x[:, :2], x[:, 2]


def predicted(setting: Setting) -> np.ndarray:
    """(draws, 2) half-widths in decades; NaN where the recording cannot be read."""
    law, stretch = drawn(DRAWS, 0)
    (found,) = expectations([setting], Family("nhkv"), law, stretch)
    return np.array([np.full(2, np.nan) if one is None else one.half_width for one in found])


def reached(setting: Setting, count: int) -> tuple[np.ndarray, list[str]]:
    """(count, 2) half-widths of the default `infer`, NaN where it gives no interval; and its verdicts."""
    law, stretch = drawn(DRAWS, 0)
    law, stretch = law[:count], stretch[:count]  # materials of the prediction, other noise
    widths, verdicts, curves = np.full((count, 2), np.nan), ["failed"] * count, {}
    for k in range(count):
        with suppress(InputError):  # no R_max can be read off
            curves[k] = setting.film(Family("nhkv"), law[k], float(stretch[k]), seed=OTHER_SEED + k)[0]
    for k, answer in zip(curves, infer_many(list(curves.values())), strict=True):
        verdicts[k] = answer.checks.verdict
        for i, name in enumerate(NAMES):
            if ends := answer.interval(name) if answer.theta.size else None:
                widths[k, i] = 0.5 * np.log10(ends[1] / ends[0])
    return widths, verdicts


def middle(widths: np.ndarray) -> np.ndarray:
    """(2,) geometric mean over the draws that have an interval."""
    known = widths[np.all(np.isfinite(widths), axis=1)]
    return np.exp(np.mean(np.log(known), axis=0)) if len(known) else np.full(2, np.nan)


def shots(widths: np.ndarray) -> float:
    """How many of these bring both to WANTED, if information adds: no interval is none."""
    information = np.mean(np.nan_to_num((NORMAL_90 / widths) ** 2), axis=0)
    return float(np.max((NORMAL_90 / WANTED) ** 2 / np.maximum(information, 1e-9)))


def percent(decades: float) -> str:
    return f"{100 * (10**decades - 1):.3g}"


def report(found: dict[str, dict]) -> str:
    text = f"""# Predicted intervals and reached ones
`python benchmarks/design.py`: nhkv, G 3 to 12 kPa, µ 0.03 to 0.1 Pa s, stretch 5 to 8 (free), 128 frames, noise 1 % of
R_max, clock and scale off as those of a camera.
Predicted: {DRAWS} simulated recordings at the maximum of their posterior (`inference/design.py`). Reached: the default
`infer` on other recordings of the same materials. Half of the 90 % interval over the median, in %: geometric mean over
those with an interval. Shots: that bring G and µ both to ± 10 %, if the information of shots adds.

| R_max, µm | kfps | G told | reached | ratio | µ told | reached | ratio | shots told | reached | n | ok |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""
    ratios, needed = [], {}
    for key, one in found.items():
        radius, rate = map(float, key.split())
        told, got = np.array(one["predicted"], float), np.array(one["reached"], float)
        a, b = middle(told), middle(got)
        ratios.append(a / b)
        needed[radius, rate] = shots(told), shots(got)
        cells = [f"{percent(a[i])} | {percent(b[i])} | {a[i] / b[i]:.2f}" for i in range(2)]
        told_shots, got_shots = needed[radius, rate]
        tail = f"{told_shots:.1f} | {got_shots:.1f} | {len(got)} | {one['verdicts'].count('ok')}"
        text += f"| {1e6 * radius:.0f} | {1e-3 * rate:.0f} | {cells[0]} | {cells[1]} | {tail} |\n"
    off = np.array(ratios)
    within = np.mean(np.abs(np.log(off)) < np.log(1.2), axis=0)
    text += f"\nPredicted over reached: median {np.median(off[:, 0]):.2f} (G) and {np.median(off[:, 1]):.2f} (µ); "
    text += f"within 20 % (0.83 to 1.2) at {within[0]:.0%} (G) and {within[1]:.0%} (µ) of {len(off)} settings.\n"
    chosen = min(needed, key=lambda setting: needed[setting][0])
    if DEFAULT in needed:
        share = needed[chosen][1] / needed[DEFAULT][1]
        where = f"{1e6 * chosen[0]:.0f} µm at {1e-3 * chosen[1]:.0f} kfps"
        text += f"Following it: the setting with the fewest predicted shots is {where}; it reached ± 10 % with "
        text += f"{needed[chosen][1]:.1f} shots where the default setting (150 µm at 250 kfps) needs "
        text += f"{needed[DEFAULT][1]:.1f}: {share:.0%}.\n"
    return text


def main(folder: str = "build/design", count: str = "5") -> None:
    place = Path(folder) / "design.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    found = json.loads(place.read_text()) if place.exists() else {}
    for radius, rate in product(RADII, RATES):
        key = f"{radius} {rate}"
        if key not in found:
            setting = Setting(radius, rate, frames=FRAMES)
            before = predicted(setting)
            after, verdicts = reached(setting, int(count))
            found[key] = {"predicted": before.tolist(), "reached": after.tolist(), "verdicts": verdicts}
            place.write_text(json.dumps(found))
            print(key, middle(before) / middle(after), os.times().user, flush=True)
            (HERE / "design.md").write_text(report(found), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
