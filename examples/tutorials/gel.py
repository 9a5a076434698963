# %% [markdown]
# # A gel, from a recording to the table of a paper
# You will measure a bubble in a recording, infer G and µ of the gel around it, and make the table, the figure and the
# methods paragraph of a paper from five shots.
#
# ## Get the shots
# They come with cavirheo and are synthetic, so the true values are known.

# %%
import shutil
from importlib.resources import files
from subprocess import run

shots = files("cavirheo") / "app" / "examples"
for name in ("bubble.mp4", "stiff_gel.mat"):
    shutil.copy(shots / name, ".")

# %% [markdown]
# ## Measure the recording
# A video states how fast it is played, not how fast it was recorded.
# So give the frame rate of the camera, the scale, and the exposure of a frame.

# %%
run("cavirheo measure bubble.mp4 --fps 500000 --um-per-px 4 --exposure-us 0.4 -o measured", shell=True, check=True)

# %% [markdown]
# Look at the circles before you use a radius.
# The colour of a circle says what was found: the [flags](../../docs/how-to/measure.md#what-is-written) have a table.

# %%
import matplotlib.pyplot as plt

image = plt.imread("measured/contact.png")
figure, axes = plt.subplots(figsize=(8, 8 * image.shape[0] / image.shape[1]), layout="constrained")
axes.imshow(image)
axes.axis("off")
figure

# %% [markdown]
# ## Infer G and µ
# `infer` takes the file that was written; it would also take the recording itself.

# %%
run("cavirheo infer measured/measured.csv -o one-shot", shell=True, check=True)

# %% [markdown]
# The true values are 10 kPa and 0.06 Pa s.
# The lines `G` and `µ` have the value and its 90 % interval; the line `use` says whether to use them
# ([verdicts](../../docs/method/verdicts.md)), and `check` what could be wrong.
#
# ## Five shots, one material
# One shot is not a material.
# `stiff_gel.mat` holds five shots of another gel, of 30 kPa and 0.08 Pa s.

# %%
run("cavirheo infer stiff_gel.mat -o gel", shell=True, check=True)

# %% [markdown]
# Below the shots stand G and µ of the material with 90 % intervals, whether to use them, and the next command.
#
# ## The table
# `result.csv` has every number.
# This makes the rows of a LaTeX table.

# %%
import cavirheo

result = cavirheo.load("gel")
for shot in result.curves:
    G, mu = shot.shear_modulus_Pa, shot.viscosity_Pa_s
    cells = f"{shot.max_radius_m * 1e6:.0f} & {G.median / 1e3:.1f} [{G.q05 / 1e3:.1f}, {G.q95 / 1e3:.1f}]"
    print(f"{shot.name} & {cells} & {mu.median:.3f} [{mu.q05:.3f}, {mu.q95:.3f}]", r"\\")
for group in result.groups:
    G, mu = group.value("shear_modulus"), group.value("viscosity")
    cells = f"{G.median / 1e3:.1f} [{G.q05 / 1e3:.1f}, {G.q95 / 1e3:.1f}]"
    print(f"material & & {cells} & {mu.median:.3f} [{mu.q05:.3f}, {mu.q95:.3f}]", r"\\")

# %% [markdown]
# ## A figure
# `answer.plot()` is as wide as a column, 84 mm; `.savefig("shot.pdf")` keeps it.
# The report has the picture of every shot, and of all shots together.

# %%
answer = cavirheo.infer(cavirheo.read_curves("stiff_gel.mat")[0])
answer.plot()

# %% [markdown]
# ## The methods paragraph
# It names the model, its constants, the window, the method and the version, and whom to cite.

# %%
run("cavirheo cite gel", shell=True, check=True)

# %% [markdown]
# ## Your own gel
# Put the density of your gel into the command (`--density`): 2 % of it change this G by 1.5 kPa.
# Then read [how far an answer can be trusted](../../docs/how-far.md).
