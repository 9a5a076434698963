"""Hostile and odd files, made by code: the name of each, and how it is written.

`FILES` maps a key to (file name, maker of its content). Every file lies in a folder of its own, so that a message can
be held against it whatever the name is made of.
"""

import contextlib
import json
import os
import socket
from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np
from bombs import BOMBS, HEAD, array, element, mat
from files import Make, hdf5, put, saved, terabyte, write_xlsx
from valid import BINARIES, RADIUS, TEXTS, TIME, documents, grid, rows

FILES: dict[str, tuple[str | bytes, Make | str | bytes]] = {}
CURVE = TEXTS["curve.csv"]  # where it is the whole content, a last line makes it a recording of its own


def add(**files: tuple[str | bytes, Make | str | bytes]) -> None:
    """Under the key: the file's name, and its maker or its content."""
    for key, (name, make) in files.items():
        assert key not in FILES, key
        if make == CURVE:
            make = f"{CURVE}92,{30 + len(FILES) / 100}\n"
        FILES[key] = name, make


add(
    name_of_255_bytes=("n" * 251 + ".csv", CURVE),
    name_not_utf8=(b"caf\xe9\xff.csv", CURVE),
    name_newline=("two\nlines.csv", CURVE),
    name_newline_bad=("two\nerror: lines.csv", "nothing"),
    name_escape=("\x1b[31mred\x1b[0m\x07.csv", CURVE),
    name_escape_bad=("\x1b]0;title\x07.csv", "nothing"),
    name_right_to_left=("\u202egpj.csv", CURVE),
    name_dash=("-o.csv", CURVE),
    name_quotes=('it\'s "quoted" `x` $HOME.csv', CURVE),
    name_html=("<img src=x onerror=alert(1)>.csv", CURVE),
    name_formula=("=cmd|x!A1.csv", CURVE),
    name_mathtext=("$\\frac{x}{.csv", CURVE),
)


def bound(path: Path) -> None:
    with contextlib.chdir(path.parent):  # the path of a socket may have 107 bytes
        socket.socket(socket.AF_UNIX).bind(path.name)


def link(target: str) -> Make:
    return lambda path: path.symlink_to(target)


def loop(path: Path) -> None:
    path.symlink_to("other")
    path.with_name("other").symlink_to(path.name)


def unreadable(path: Path) -> None:
    path.write_text(CURVE)
    path.chmod(0)


add(
    socket=("socket.csv", bound),
    device_full=("full.csv", link("/dev/full")),
    device_null=("null.csv", link("/dev/null")),
    device_random=("random.csv", link("/dev/urandom")),
    link_broken=("broken.csv", link("nowhere")),
    link_to_itself=("itself.csv", link("itself.csv")),
    link_loop=("loop.csv", loop),
    unreadable=("unreadable.csv", unreadable),
    missing=("missing.csv", lambda path: None),
)
for _end in ("csv", "mat", "json", "toml", "npz"):
    add(**{
        f"fifo_{_end}": (f"pipe.{_end}", os.mkfifo),
        f"device_zero_{_end}": (f"zero.{_end}", link("/dev/zero")),
        f"folder_{_end}": (f"folder.{_end}", Path.mkdir),
        f"empty_{_end}": (f"empty.{_end}", ""),
        f"sparse_{_end}": (f"sparse.{_end}", terabyte(mat() if _end == "mat" else b"")),
    })  # fmt: skip


N = np.nan
ODD_CURVES: dict[str, tuple[np.ndarray, np.ndarray]] = {  # us, um
    "all_nan": (TIME, np.full(100, N)),
    "some_infinite": (TIME, np.where(np.arange(100) % 7, RADIUS, np.inf)),
    "huge": (TIME, np.full(100, 1e308)),
    "denormal": (TIME, np.full(100, 5e-324)),
    "negative": (TIME, -RADIUS),
    "constant": (TIME, np.full(100, 250.0)),
    "no_rows": (TIME[:0], RADIUS[:0]),
    "four_rows": (TIME[:4], RADIUS[:4]),
    "same_times": (np.zeros(100), RADIUS),
    "shuffled_times": (np.random.default_rng(0).permutation(TIME), RADIUS),
    "growth_only": (TIME, TIME + 10),
}


for _name, (_t, _r) in ODD_CURVES.items():
    add(**{
        f"csv_{_name}": ("odd.csv", HEAD + rows(",", _t, _r)),
        f"mat_{_name}": ("odd.mat", saved(Rnew=_r * 1e-6, t=_t * 1e-6)),
    })  # fmt: skip

LINES = CURVE.splitlines()
add(
    csv_open_quote=("a.csv", CURVE.replace("0,", '0,"', 1)),
    csv_nul=("a.csv", CURVE.replace("\n", "\0\n")),
    csv_surrogates=("a.csv", CURVE.replace("radius_um", "radius_um\ud800").encode("utf-8", "surrogatepass")),
    csv_escape_labels=("a.csv", "shot" + "\n\x1b[31mred\x1b[0m\x07".join([f",{line}" for line in LINES])),
    csv_long_line=("a.csv", HEAD + "1," * 49_000 + "\n"),
    csv_of_html=("a.csv", "<!DOCTYPE html><html><body>404 not found</body></html>\n"),
    sweep_zero=("a.csv", "omega (rad/s),G' (Pa),G'' (Pa)\n" + "0,0,0\n" * 9),
    sweep_huge=("a.csv", "omega (rad/s),G' (Pa),G'' (Pa)\n" + "".join(f"{10**k},1e308,1e308\n" for k in range(9))),
    sweep_markup=("a.txt", "[step [/] \x1b[31m]\nomega\tG'\tG''\nrad/s\tPa\tPa\n" + "".join(f"{k}\t5\t6\n" for k in range(1, 9))),
    times_too_fast=("a.csv", "name,rmax_um,stretch,t1_us\n" + "[/]\x1b[31m,250,7,0.1\n" * 5),
    references_names=("a.csv", "set\ncomparison.json\n..\n.\n/\nCON\n" + "s" * 300 + "\n"),
    references_huge=("a.csv", "set,method,quantity,mean,std\nx,IMR,G_kPa,1e308,1e308\nx,a,G_kPa,5e-324,0\n"),
)  # fmt: skip


def nested(depth: int) -> bytes:
    inside = array("", element(9, bytes(8)))
    for _ in range(depth):
        inside = array("", inside, kind=1)
    return array("R_nondim_All", inside, kind=1)


def loops(path: Path) -> None:
    hdf5(**GOOD, soft=h5py.SoftLink("/soft"))(path)
    with h5py.File(path, "r+") as file:
        file["again"] = file["/"]


GOOD = {"time_us": TIME, "radius_um": RADIUS}
LABELS = "<script>alert(1)</script>", "\x1b[31mred", "[/][bold]", "x" * 5000, "a\nb", "..", "$\\frac{", "😀"
add(
    mat_cells_as_a_number=("a.mat", saved(R_nondim_All=1.0, t_nondim_All=2.0, RmaxList=1e-4)),
    mat_empty_cells=("a.mat", saved(R_nondim_All=np.empty((0, 0), object), t_nondim_All=np.empty((0, 0), object), RmaxList=[])),
    mat_long_name=("a.mat", mat(array("v" * 5000, element(9, bytes(8))))),
    mat_nested_deep=("a.mat", mat(nested(2000))),
    mat_negative_shape=("a.mat", mat(array("Rnew", element(9, bytes(80)), shape=(-2, -5)))),
    h5_loops=("a.h5", loops),
    h5_labels=("a.h5", hdf5(**{f"{label}/{name}": data for label in LABELS for name, data in GOOD.items()})),
    xlsx_escape_labels=("a.xlsx", lambda path: write_xlsx(path, {"a": [["shot", "time_us", "radius_um"], *(["<b>[/]\u009b31m", *row] for row in grid(CURVE)[1:])]})),
)  # fmt: skip
add(**{f"bomb_{name}": (f"bomb.{name.partition('_')[0]}", make) for name, (_, make) in BOMBS.items()})

CUTS = {"early": 0.3, "middle": 0.6, "late": 0.9}
CUT = ("bdt.mat", "imr-packed.mat", "bdt-73.mat", "packed.h5", "groups.h5", "curve.xlsx", "old.xls", "shard-00000.h5")


def cut(name: str, share: float) -> Make:
    def make(path: Path) -> None:
        BINARIES[name](path)
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return make


for _name in CUT:
    add(**{f"cut_{_name}_{where}": (_name, cut(_name, share)) for where, share in CUTS.items()})


def document(kind: str, **changed: object) -> str:
    return json.dumps(json.loads(documents()[kind]) | changed)


add(
    json_deep=("a.json", "[" * 100_000 + "]" * 100_000),
    json_no_curves=("a.json", document("result.json", curves=[])),
    json_escape=("a.json", document("result.json", command="\x1b[31mred\x07", notes=["[/]", "\u009b31m", "<script>"])),
    toml_deep=("a.toml", "a = " + "[" * 20_000 + "]" * 20_000),
    npz_of_noise=("a.npz", np.random.default_rng(4).bytes(3000)),
)  # fmt: skip


def make_all(folder: Path, keys: Iterable[str] = FILES) -> dict[str, Path]:
    """These files, each in its folder, by key."""
    made = {}
    for key in keys:
        name, make = FILES[key]
        place = folder / key
        place.mkdir(parents=True)
        made[key] = put(Path(os.fsdecode(os.fsencode(place) + b"/" + os.fsencode(name))), make)
    return made
