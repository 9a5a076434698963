"""Recipes that are wrong in one way each: `RECIPES[name]` is their content, and what the refusal must name."""

from __future__ import annotations

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
    "zeros": (bytes(1000), "not"),
    "random bytes": (bytes(range(128, 256)) * 10, "UTF-8"),
    "latin 1": (RIGHT.replace("tiny", "gelé").encode("latin-1"), "UTF-8"),
    "UTF-16": (RIGHT.encode("utf-16"), "UTF-8"),
    "JSON": (b'{"problem": {"material": "nhkv"}}', "TOML"),
    "a table of numbers": (b"time_us,radius_um\n0,100\n1,99\n", "TOML"),
    "an onnx file": (b"\x08\n\x12\x07pytorch" * 100, "TOML"),
    "nested deeply": (b"a = " + b"[" * 20_000, "TOML"),
    "nested tables": (b"[" + b"a." * 5_000 + b"a]", "problem"),
    "cut short": (RIGHT[:60].encode(), "TOML"),
    "no end of a string": (instead('"tiny"', '"tiny'), "TOML"),
    "duplicate key": (training("epochs = 4\nepochs = 5"), "TOML"),
    "duplicate table": ((RIGHT + "[data]\nn = 5\n").encode(), "TOML"),
    "a number of 10000 digits": (instead("n = 100", "n = " + "9" * 10_000), "TOML"),
    # keys and tables
    "unknown table": ((RIGHT + "[optimizer]\nlr = 1\n").encode(), "optimizer"),
    "misspelt table": (instead("[training]", "[trainning]"), "training?"),
    "misspelt key": (training("epoch = 4"), "epochs?"),
    "misspelt key of the network": (network("widht = 16"), "width?"),
    "key in the wrong table": (instead("n = 100", "n = 100\nepochs = 5"), "data.epochs"),
    "table as a value": (b"problem = 5\n" + RIGHT.replace("[problem]", "[a]").encode(), "problem"),
    "table as a list": (instead("[data]", "[[data]]"), "data"),
    "key outside a table": (b"n = 5\n" + RIGHT.encode(), "n"),
    "missing table": (instead("[export]\nname =", "name ="), "export"),
    "missing n": (instead("n = 100", ""), "data.n"),
    "missing material": (instead('material = "nhkv"', ""), "problem.material"),
    "four at once": (RIGHT.replace("epochs", "e").replace("width", "w").replace("lr", "l").encode(), "lr?"),
    # values
    "n negative": (instead("n = 100", "n = -1"), "data.n"),
    "n zero": (instead("n = 100", "n = 0"), "data.n"),
    "n half": (instead("n = 100", "n = 10.5"), "data.n"),
    "n true": (instead("n = 100", "n = true"), "data.n"),
    "n as text": (instead("n = 100", 'n = "100"'), "data.n"),
    "n a date": (instead("n = 100", "n = 2026-01-01"), "data.n"),
    "n not a number": (instead("n = 100", "n = nan"), "data.n"),
    "seed negative": (instead("n = 100", "n = 100\nseed = -1"), "data.seed"),
    "seed beyond 64 bits": (instead("n = 100", f"n = 100\nseed = {1 << 70}"), "data.seed"),
    "seed of the training beyond 64 bits": (training(f"seed = {1 << 70}"), "training.seed"),
    "epochs zero": (training("epochs = 0"), "training.epochs"),
    "epochs a trillion": (training("epochs = 1000000000000"), "training.epochs"),
    "lr zero": (instead("lr = 0.01", "lr = 0"), "training.lr"),
    "lr negative": (instead("lr = 0.01", "lr = -0.01"), "training.lr"),
    "lr infinite": (instead("lr = 0.01", "lr = inf"), "training.lr"),
    "lr not a number": (instead("lr = 0.01", "lr = nan"), "training.lr"),
    "lr with a unit": (instead("lr = 0.01", 'lr = "1e-3 per step"'), "training.lr"),
    "batch a billion": (training("batch = 1000000000"), "training.batch"),
    "warmup negative": (training("warmup_steps = -1"), "training.warmup_steps"),
    "schedule unknown": (training('schedule = "linear"'), "training.schedule"),
    "dropout one": (network("dropout = 1.0"), "network.dropout"),
    "dropout not a number": (network("dropout = nan"), "network.dropout"),
    "width a billion": (network("width = 1000000000"), "network.width"),
    "layers a million": (network("layers = 1000000"), "network.layers"),
    "heads zero": (network("heads = 0"), "network.heads"),
    "activation a module": (network('activation = "os"'), "network.activation"),
    "norm_epsilon infinite": (network("norm_epsilon = inf"), "network.norm_epsilon"),
    "outputs without a prior": (network('outputs = ["log10_density"]'), "log10_density"),
    "outputs twice": (network('outputs = ["log10_viscosity", "log10_viscosity"]'), "log10_viscosity"),
    "outputs a text": (network('outputs = "log10_viscosity"'), "network.outputs"),
    "name a path": (instead('"tiny"', '"../../etc/cron.d/x"'), "export.name"),
    "name with an escape": (instead('"tiny"', '"\\u001b[31mred"'), "export.name"),
    "name of 300 letters": (instead('"tiny"', f'"{"x" * 300}"'), "export.name"),
    "name empty": (instead('"tiny"', '""'), "export.name"),
    # the problem
    "law unknown": (instead('"nhkv"', '"honey"'), "honey"),
    "law misspelt": (instead('"nhkv"', '"nhvk"'), "nhkv"),
    "law a number": (instead('"nhkv"', "5"), "problem.material"),
    "frames a billion": (problem("frames = 1000000000"), "frames"),
    "frames one": (problem("frames = 1"), "frames"),
    "frames negative": (problem("frames = -20"), "frames"),
    "frame interval zero": (problem("frame_interval_us = 0"), "frame_interval_us"),
    "frame interval in words": (problem('frame_interval_us = "1 us"'), "frame_interval_us"),
    "frame interval infinite": (problem("frame_interval_us = inf"), "frame_interval_us"),
    "frame interval of an hour": (problem("frame_interval_us = 3.6e9"), "grid"),
    "radius in m": (problem("reference_max_radius_um = 245e-6"), "reference_max_radius"),
    "radius negative": (problem("reference_max_radius_um = -245"), "reference_max_radius_um"),
    "medium unknown": (problem('medium = "mercury"'), "mercury"),
    "medium a number": (problem("medium = 5"), "medium"),
    "medium a list": (problem('medium = ["water"]'), "medium"),
    "medium with an unknown constant": (problem("medium = {densty = 1000.0}"), "density?"),
    "medium with a constant of its name in words": (problem("medium = {name = 5}"), "medium"),
    "medium with a unit": (problem('medium = {density = "1000 kg/m3"}'), "density"),
    "medium with a negative density": (problem("medium = {density = -1}"), "density"),
    "medium that boils": (problem("medium = {temperature = 400.0}"), "boil"),
    "medium not a number": (problem("medium = {surface_tension = nan}"), "surface_tension"),
    # the prior
    "prior upside down": (prior("stretch = [11.0, 3.0]"), "stretch"),
    "prior of one number": (prior("stretch = [3.0]"), "stretch"),
    "prior of three numbers": (prior("stretch = [3.0, 7.0, 11.0]"), "stretch"),
    "prior a number": (prior("stretch = 7.0"), "stretch"),
    "prior in words": (prior('stretch = ["low", "high"]'), "stretch"),
    "prior infinite": (prior("stretch = [3.0, inf]"), "stretch"),
    "prior without width": (prior("stretch = [3.0, 3.0]"), "stretch"),
    "prior missing": (prior(""), "stretch"),
    "prior of a stretch below 1": (prior("stretch = [0.1, 11.0]"), "stretch"),
    "prior of a negative modulus": (instead("log10_shear_modulus = [3.0, 6.0]", "shear_modulus = [-5, 1e4]"), "shear"),
    "prior beyond all numbers": (instead("[-3.0, 0.0]", "[-3.0, 4000.0]"), "viscosity"),
    "prior misspelt": (instead("log10_viscosity", "log10_viscocity"), "viscosity"),
    "prior of another law": (prior("stretch = [3.0, 11.0]\nyield_stress = [1.0, 2.0]"), "yield_stress"),
    "prior twice in two scales": (prior("stretch = [3.0, 11.0]\nviscosity = [0.1, 0.2]"), "viscosity"),
    "prior with an escape": (prior('"\\u001b[31m" = [3.0, 11.0]'), "x1b"),
}  # fmt: skip
