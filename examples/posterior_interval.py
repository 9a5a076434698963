"""A posterior whose draws are weighed by full simulations: intervals, effective sample size, and a plot of G."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cavirheo

curve = cavirheo.read_curves(Path(__file__).parent / "soft_gel.csv")[0]
answer = cavirheo.infer(curve, material="nhkv", seed=1)
for name, unit in (("shear_modulus", "Pa"), ("viscosity", "Pa s")):
    low, high = answer.interval(name)
    print(f"{name}: {answer.median(name):.4g} {unit}, 90 % interval {low:.4g} to {high:.4g}")

weight = np.exp(answer.log_weight - answer.log_weight.max())
weight /= weight.sum()
print(f"{len(weight)} draws are worth {1 / np.sum(weight**2):.0f} independent ones")

figure, axes = plt.subplots()
axes.hist(answer.draws("shear_modulus") / 1e3, bins=40, weights=weight)
axes.set(xlabel="G (kPa)", ylabel="probability")
figure.savefig("posterior.png")
