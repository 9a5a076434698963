"""Fit two collapses under white noise with a free clock, then one collapse and three."""

from pathlib import Path

import cavirheo

curve = cavirheo.read_curves(Path(__file__).parent / "stiff_gel.mat")[0]
for window in (2, 1, 3):
    answer = cavirheo.fit(curve, "nhkv", window=window, free=("t0",))
    print(f"{window} collapses:")
    for name, unit in (("G", "Pa"), ("mu", "Pa s"), ("lambda", "")):
        low, high = answer.interval(name)
        print(f"  {name}: {answer.median(name):.4g} {unit}, 90 % interval {low:.4g} to {high:.4g}")
