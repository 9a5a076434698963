# %% [markdown]
# # The viscosity of a liquid
# A liquid has a viscosity and no shear modulus.
# You will make shots of a liquid, infer its viscosity, and see what the law of a gel says of them.
#
# ## Three shots
# No measured liquid comes with cavirheo, so these shots are simulated.
# The liquid has 60 mPa s, vapour condenses at a finite rate, as in real bubbles, the camera takes a million frames per
# second, and each radius is off by 1 µm at random.

# %%
import csv
from subprocess import run

import matplotlib.pyplot as plt
import numpy as np

import cavirheo

liquid = cavirheo.Newtonian(0.06)  # Pa s
kinetic = cavirheo.Bubble("kinetic", accommodation=0.07)  # vapour condenses at a finite rate
time = np.arange(100) * 1e-6  # s after R_max
noise = np.random.default_rng(1)
with open("liquid.csv", "w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["shot", "time_us", "radius_um"])
    for shot, size in enumerate((180e-6, 240e-6, 310e-6), 1):
        bubble = cavirheo.simulate(liquid, max_radius=size, stretch=6.0, time=time, bubble=kinetic)
        radius = bubble.radius + 1e-6 * noise.standard_normal(time.size)
        rows.writerows((shot, f"{t * 1e6:.1f}", f"{R * 1e6:.2f}") for t, R in zip(time, radius, strict=True))

# %% [markdown]
# ## Infer with the right law
# `--material newtonian` says that it is a liquid.

# %%
run("cavirheo infer liquid.csv --material newtonian -o liquid", shell=True, check=True)

# %% [markdown]
# Each row has the median of µ and its 90 % interval.
# The interval of each shot holds 0.06 Pa s, or should in nine of ten cases.
# The line below the rows is µ of the material, with the errors of scale and frame rate that all shots share.
#
# ## And with the wrong law?
# The law of a gel, `nhkv`, contains the liquid as a limit, with G = 0; here is the first shot with it.

# %%
run("cavirheo infer liquid.csv --shots 1 --material nhkv -o as-gel", shell=True, check=True)

# %% [markdown]
# The viscosity is the same within its interval.
# The interval of G reaches the lower end of the range that was searched, so it is a bound and not a value, and the
# verdict says so.
# Without `--material` G may be exactly 0, and the answer says how probable a liquid is.

# %% [markdown]
# ## Look at the answer
# A result can be loaded again; its numbers are in SI units.

# %%
result = cavirheo.load("liquid")
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for record in result.curves:
    mu = record.viscosity_Pa_s
    below, above = [mu.median - mu.q05], [mu.q95 - mu.median]
    axes.errorbar(record.max_radius_m * 1e6, mu.median, [below, above], fmt="o", color="black")
axes.axhline(0.06, color="grey", ls="--")
axes.set(xlabel="R_max (µm)", ylabel="µ (Pa s), 90 % interval", ylim=(0.05, 0.07))
figure

# %% [markdown]
# The dashed line is the true value.
#
# ## Your own liquid
# Replace `liquid.csv` by your file ([formats](../../docs/how-to/your-shots.md)), and give the density with `--density`.
# If the viscosity changes with the shear rate, ask [`which-law`](../../docs/how-to/which-law.md).
