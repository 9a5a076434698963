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


RECIPES: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "problem"),
    "nested deeply": (b"a = " + b"[" * 20_000, "TOML"),
    "unknown table": ((RIGHT + "[optimizer]\nlr = 1\n").encode(), "optimizer"),
    "misspelt key": (instead("epochs = 4", "epoch = 4"), "training.epoch: "),
    "n negative": (instead("n = 100", "n = -1"), "data.n"),
    "epochs a trillion": (instead("epochs = 4", "epochs = 1000000000000"), "training.epochs"),
    "lr infinite": (instead("lr = 0.01", "lr = inf"), "training.lr"),
    "width a billion": (instead("width = 16", "width = 1000000000"), "network.width"),
    "an emulator of laws": (b"[emulator]\nlaws = 3", "emulator.laws"),
    "name a path": (instead('"tiny"', '"../../etc/cron.d/x"'), "export.name"),
    "law unknown": (instead('"nhkv"', '"honey"'), "honey"),
    "frames a billion": (instead("frames = 20", "frames = 1000000000"), "frames"),
    "medium with an unknown constant": (instead("frames = 20", "medium = {densty = 1000.0}"), "densty"),
    "prior upside down": (instead("stretch = [3.0, 11.0]", "stretch = [11.0, 3.0]"), "stretch"),
    "prior of a negative modulus": (instead("log10_shear_modulus = [3.0, 6.0]", "shear_modulus = [-5, 1e4]"), "shear"),
    "prior of another law": (instead("[data]", "yield_stress = [1.0, 2.0]\n[data]"), "yield_stress"),
}  # fmt: skip
