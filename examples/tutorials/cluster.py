# %% [markdown]
# # The same work on a cluster
# You will start a cluster of two workers on your own machine, and let it answer a shot.
# The commands are the same for a thousand workers.
#
# ## Start it
# A dask cluster has one scheduler and many workers.
# All listen on 127.0.0.1 alone, because a scheduler runs whatever it is sent
# ([security](../../docs/how-to/scale.md#security)).
# In a terminal, give each of these commands in a window of its own:
#
#     dask scheduler --host 127.0.0.1
#     dask worker tcp://127.0.0.1:8786 --host 127.0.0.1 --nworkers 2 --nthreads 1
#
# A notebook starts them like this, on a port that is free:

# %%
import os
import shutil
import socket
import subprocess
from importlib.resources import files
from subprocess import run

shutil.copy(files("cavirheo") / "app" / "examples" / "soft_gel.csv", ".")
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
os.environ["CLUSTER"] = address = f"tcp://127.0.0.1:{port}"
here = ["--host", "127.0.0.1", "--no-dashboard"]
commands = (
    ["dask", "scheduler", "--port", str(port), *here],
    ["dask", "worker", address, "--nworkers", "2", "--nthreads", "1", *here],
)
silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
cluster = [subprocess.Popen(command, **silent) for command in commands]

# %% [markdown]
# ## Infer on the cluster
# `--scheduler` is the only option that is new.
# Every worker must have the same version and code of cavirheo.
# A worker that differs is refused by name.

# %%
run("cavirheo infer soft_gel.csv --shots 1 --scheduler $CLUSTER -o by-cluster", shell=True, check=True)

# %% [markdown]
# ## The answer is the same
# Here is the same shot without the cluster.
# No number differs, because an answer does not depend on what computed it.

# %%
run("cavirheo infer soft_gel.csv --shots 1 --quiet -o here", shell=True, check=True)

# %%
import cavirheo

answers = {folder: cavirheo.load(folder).curves for folder in ("by-cluster", "here")}
for one, other in zip(*answers.values(), strict=True):
    same = one.shear_modulus_Pa == other.shear_modulus_Pa and one.viscosity_Pa_s == other.viscosity_Pa_s
    print(f"{one.name}: {'the same' if same else 'not the same'}")

# %% [markdown]
# ## Stop it

# %%
for process in reversed(cluster):
    process.terminate()
    process.wait()

# %% [markdown]
# ## Further
# SLURM, many recordings, and data sets for training: [scale](../../docs/how-to/scale.md).
