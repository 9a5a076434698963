# %% [markdown]
# # A notebook: from a file to a table, a material and pictures
# You will infer five shots in Python, and get a table of them, the material that they share, and pictures.
#
# ## Read and infer
# The shots come with cavirheo; a path to your own file goes in their place.
# They are synthetic: 6 kPa and 0.03 Pa s.

# %%
from importlib.resources import files

import cavirheo

curves = cavirheo.read_curves(files("cavirheo") / "app" / "examples" / "soft_gel.csv")
gel = cavirheo.Medium(density=1000.0)  # kg/m3; everything else is water's
answers = cavirheo.infer_many(curves, medium=gel)

# %% [markdown]
# ## The table
# It is a pandas DataFrame with the columns of `result.csv`, in SI.
# The ends of the 90 % intervals are beside the medians: `shear_modulus_Pa_q05`, `shear_modulus_Pa_q95`.
# Use a row if its verdict is `ok`, or if you know why it is not ([verdicts](../../docs/method/verdicts.md)).

# %%
table = cavirheo.table(answers)
table.set_index("name")[["shear_modulus_Pa", "viscosity_Pa_s", "verdict"]].round(4)

# %% [markdown]
# ## The material
# All shots together tell more than one.
# The first line is the one for a paper.

# %%
material = cavirheo.population(answers)
low, high = material.interval("G")
print(material.line)
print(f"G {low:.0f} to {high:.0f} Pa")

# %% [markdown]
# Each shot with its 90 % interval, in Pa:

# %%
cavirheo.table(answers)[["name", "shear_modulus_Pa_q05", "shear_modulus_Pa_q95"]]

# %% [markdown]
# ## Look at a shot
# Nine of ten measured points should be in the band, and the residual should be without a pattern.

# %%
answers[0].plot()

# %% [markdown]
# How the parameters depend on each other: a larger G goes with a smaller stretch λ = R_max/R_0.

# %%
answers[0].corner()

# %% [markdown]
# ## Further
# The draws go to pandas and ArviZ: [read the answer](../../docs/how-to/read-the-answer.md#in-a-notebook).
# For a report there is `cavirheo infer`, as in the tutorial on a gel.
