"""Fit two collapses by least squares with a free clock: interval, correlations, and the answers of other windows."""

from pathlib import Path

import cavirheo

curve = cavirheo.read_curves(Path(__file__).parent / "stiff_gel.mat")[0]
answer = cavirheo.fit(curve, "nhkv", window=2, free=("t0",))

for name, unit in (("shear_modulus", "Pa"), ("viscosity", "Pa s"), ("stretch", "")):
    low, high = answer.interval(name)
    print(f"{name}: {answer.median(name):.4g} {unit}, 90 % interval {low:.4g} to {high:.4g}")

print("correlations:")
for pair, value in answer.diagnostics.correlations.items():
    print(f"  {pair}: {value:+.2f}")

print("other windows:")
for collapses, other in answer.windows.items():
    print(f"  {collapses}: G {other.best['shear_modulus']:.0f} Pa, mu {other.best['viscosity']:.4f} Pa s")
