"""A posterior whose draws are weighed by full simulations: intervals, effective sample size, and pictures."""

from pathlib import Path

import numpy as np

import cavirheo

curve = cavirheo.read_curves(Path(__file__).parent / "soft_gel.csv")[0]
answer = cavirheo.infer(curve, material="nhkv", seed=1)
for name, unit in (("G", "Pa"), ("mu", "Pa s")):
    low, high = answer.interval(name)
    print(f"{name}: {answer.median(name):.4g} {unit}, 90 % interval {low:.4g} to {high:.4g}")
print(f"{len(answer.weights)} draws are worth {1 / np.sum(answer.weights**2):.0f} independent ones")
answer.plot().savefig("shot.png")
answer.corner().savefig("draws.png")
