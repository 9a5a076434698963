# %% [markdown]
# # A law of your own
# You will write a law that cavirheo does not know, simulate a bubble in it, and fit it to a shot.
#
# ## Write the law
# A law of an elastic solid derives from `Elastic` and has one function: `first`, the derivative of the strain energy
# by its first invariant, in Pa.
# This one softens at large strain.

# %%
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

import cavirheo
from cavirheo.physics.laws import Elastic, NeoHookean, Newtonian
from cavirheo.physics.materials import Viscoelastic


@dataclass(frozen=True)
class Logarithmic(Elastic):
    """W = (G c/2) ln(1 + (I_1 - 3)/c), shear modulus G in Pa: softens beyond I_1 - 3 = c."""

    shear_modulus: float
    softening: float

    def first(self, I1):
        return self.shear_modulus / 2 / (1 + (I1 - 3) / self.softening)


# %% [markdown]
# The solver makes a table of the stress from this function by itself.
#
# ## Simulate a bubble in it
# A material is the sum of an elastic and a viscous part.

# %%
time = np.arange(120) * 1e-6  # s after R_max
water = Newtonian(0.05)  # Pa s
softening = Viscoelastic(Logarithmic(60e3, 3.0), water)
figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
for name, gel in (("neo-Hookean", Viscoelastic(NeoHookean(60e3), water)), ("softening", softening)):
    bubble = cavirheo.simulate(gel, max_radius=250e-6, stretch=6.0, time=time)
    axes.plot(time * 1e6, bubble.radius * 1e6, label=name)
axes.set(xlabel="time after R_max (µs)", ylabel="R (µm)")
axes.legend(frameon=False)
figure

# %% [markdown]
# Both gels have the same modulus at small strain.
# The softening one collapses later, because it pulls less at the strain of R_max.
#
# ## Fit it
# A fit needs the name of the law, and for each new parameter its symbol, its unit, and two ranges of its logarithm:
# the one that is searched, and the one where searches start.

# %%
from cavirheo.parameters import PARAMETERS, Parameter
from cavirheo.physics.materials import LAWS

LAWS["logarithmic"] = Logarithmic
PARAMETERS["softening"] = Parameter("c", "1", search_range=(-1.0, 4.0), start_range=(0.5, 2.5))

# %% [markdown]
# Here is a shot whose truth is known: the simulation above with 1 µm of noise.

# %%
noise = 1e-6 * np.random.default_rng(1).standard_normal(time.size)  # m
shot = cavirheo.RadiusCurve(time, bubble.radius + noise, stated_time_of_max=0.0)
answers = {law: cavirheo.fit(shot, law) for law in ("neo-hookean + newtonian", "logarithmic + newtonian")}
for law, answer in answers.items():
    print(f"{law}: RMSE {answer.checks.rmse_over_rmax:.2%} of R_max, log evidence {answer.evidence.log:.0f}")
answers["logarithmic + newtonian"]

# %% [markdown]
# The right law leaves the noise alone, and its evidence is higher.
# The true values are 60 kPa, 0.05 Pa s and c = 3.
# The wrong law also fits within 1 % of R_max, but with a modulus of 40 kPa: a small residual does not prove a law.
#
# ## Further
# - [Add a law](../../docs/how-to/add-a-law.md): viscous laws, a strain energy without its derivative, and how a law
#   gets a name on the command line.
# - [Which law](../../docs/how-to/which-law.md): whether your shots prefer one of several laws.
# - An evidence compares the laws that you give. It does not say that the best of them is right.
