# %% [markdown]
# # The app in the browser
# You will start the app, answer five shots with three clicks, and get the same numbers from a program.
#
# ## Start it
# In a terminal: `cavirheo app`.
# The page opens in your browser.
# The app runs on your machine and listens there alone; no file leaves it.
# A notebook starts it like this, on a port that is free:

# %%
import socket
import subprocess
import time

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
app = subprocess.Popen(
    ["cavirheo", "app", "--no-browser", "--port", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
)
for _ in range(600):  # until it listens
    with socket.socket() as trial:
        if trial.connect_ex(("127.0.0.1", port)) == 0:
            break
    time.sleep(0.1)

# %% [markdown]
# ## Three clicks
# 1. **Data**: choose the example `soft_gel.csv`, or drop your own files.
# 2. **Infer**: press *Infer all shots*. A table of shots and their material appears.
# 3. **Check**: look at each shot. The simulation of the answer must lie on the measured points.
#
# ![Step 4: the answer over the measurement, with sliders](../../docs/app.png)
#
# Move the sliders for G, µ and λ: a simulation follows at once, and you see what each parameter does.
# **Export** gives a zip file with everything that `cavirheo infer` writes.
#
# ## The same from a program
# Every app has an endpoint.
# It takes files and returns the content of `result.json`.

# %%
from importlib.resources import files

from gradio_client import Client, handle_file

client = Client(f"http://127.0.0.1:{port}", verbose=False)
shots = handle_file(str(files("cavirheo") / "app" / "examples" / "soft_gel.csv"))
document = client.predict([shots], density=1000, api_name="/infer")
for shot in document["curves"]:
    G, mu = shot["shear_modulus_Pa"], shot["viscosity_Pa_s"]
    print(f"{shot['name']}: G {G['median']:.0f} Pa [{G['q05']:.0f}, {G['q95']:.0f}], µ {mu['median']:.4f} Pa s")

# %% [markdown]
# The true values of these shots are 6000 Pa and 0.03 Pa s.
#
# ## Stop it
# In a terminal: Ctrl+C, which also removes all temporary files.

# %%
app.terminate()
app.wait()

# %% [markdown]
# ## Further
# Recordings, limits, and the app for a group on a server: [the how-to of the app](../../docs/how-to/app.md).
