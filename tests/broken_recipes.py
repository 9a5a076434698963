"""Recipes that are wrong in one way each: `RECIPES[name]` is their content, and what the refusal must name."""

RIGHT = """
[problem]
material = "nhkv"
frames = 20
[prior]
log10_shear_modulus = [3.0, 6.0]
log10_viscosity = [-3.0, 0.0]
stretch = [3.0, 11.0]
[data]
n = 100
[network]
width = 16
[training]
epochs = 4
lr = 0.01
[export]
name = "tiny"
"""


def instead(old: str, new: str) -> bytes:
    assert old in RIGHT
    return RIGHT.replace(old, new, 1).encode()


def problem(line: str) -> bytes:
    return instead("frames = 20", line)


def training(line: str) -> bytes:
    return instead("epochs = 4", line)


def network(line: str) -> bytes:
    return instead("width = 16", line)


def prior(line: str) -> bytes:
    return instead("stretch = [3.0, 11.0]", line)


RECIPES: dict[str, tuple[bytes, str]] = {
    # no recipe
    "empty": (b"", "problem"),
    "nested deeply": (b"a = " + b"[" * 20_000, "TOML"),
    "a number of 10000 digits": (instead("n = 100", "n = " + "9" * 10_000), "TOML"),
    # keys and tables
    "unknown table": ((RIGHT + "[optimizer]\nlr = 1\n").encode(), "optimizer"),
    "misspelt key": (training("epoch = 4"), "epochs?"),
    "missing table": (instead("[export]\nname =", "name ="), "export"),
    # values
    "n negative": (instead("n = 100", "n = -1"), "data.n"),
    "seed beyond 64 bits": (instead("n = 100", f"n = 100\nseed = {1 << 70}"), "data.seed"),
    "epochs a trillion": (training("epochs = 1000000000000"), "training.epochs"),
    "lr infinite": (instead("lr = 0.01", "lr = inf"), "training.lr"),
    "schedule unknown": (training('schedule = "linear"'), "training.schedule"),
    "width a billion": (network("width = 1000000000"), "network.width"),
    "activation a module": (network('activation = "os"'), "network.activation"),
    "outputs without a prior": (network('outputs = ["log10_density"]'), "log10_density"),
    "name a path": (instead('"tiny"', '"../../etc/cron.d/x"'), "export.name"),
    # the problem
    "law unknown": (instead('"nhkv"', '"honey"'), "honey"),
    "frames a billion": (problem("frames = 1000000000"), "frames"),
    "frame interval of an hour": (problem("frame_interval_us = 3.6e9"), "grid"),
    "radius in m": (problem("reference_max_radius_um = 245e-6"), "reference_max_radius"),
    "medium with an unknown constant": (problem("medium = {densty = 1000.0}"), "density?"),
    "medium that boils": (problem("medium = {temperature = 400.0}"), "boil"),
    # the prior
    "prior upside down": (prior("stretch = [11.0, 3.0]"), "stretch"),
    "prior of a stretch below 1": (prior("stretch = [0.1, 11.0]"), "stretch"),
    "prior of a negative modulus": (instead("log10_shear_modulus = [3.0, 6.0]", "shear_modulus = [-5, 1e4]"), "shear"),
    "prior beyond all numbers": (instead("[-3.0, 0.0]", "[-3.0, 4000.0]"), "viscosity"),
    "prior of another law": (prior("stretch = [3.0, 11.0]\nyield_stress = [1.0, 2.0]"), "yield_stress"),
    "prior with an escape": (prior('"\\u001b[31m" = [3.0, 11.0]'), "x1b"),
}  # fmt: skip
