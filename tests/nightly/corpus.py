"""Hostile and odd files, made by code: odd names, what is no file, bombs, and damaged files of every kind.

`FILES` maps a key to (file name, maker of its content). Every file lies in a folder of its own, so that a message can
be held against it whatever the name is made of.
"""

import contextlib
import os
import socket
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from bombs import BOMBS, HEAD, mat
from files import Make, put, saved, terabyte
from mutate import mutated
from valid import BINARIES, RADIUS, TEXTS, TIME, documents, rows

FILES: dict[str, tuple[str | bytes, Make | str | bytes]] = {}
CURVE = TEXTS["curve.csv"]  # where it is the whole content, a last line makes it a recording of its own
DAMAGED = 6  # of each valid file


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
    name_newline_bad=("two\nerror: lines.csv", "nothing"),
    name_escape=("\x1b[31mred\x1b[0m\x07.csv", CURVE),
    name_right_to_left=("\u202egpj.csv", CURVE),
    name_dash=("-o.csv", CURVE),
    name_quotes=('it\'s "quoted" `x` $HOME.csv', CURVE),
    name_html=("<img src=x onerror=alert(1)>.csv", CURVE),
    name_formula=("=cmd|x!A1.csv", CURVE),
)


def bound(path: Path) -> None:
    with contextlib.chdir(path.parent):  # the path of a socket may have 107 bytes
        socket.socket(socket.AF_UNIX).bind(path.name)


def link(target: str) -> Make:
    return lambda path: path.symlink_to(target)


def unreadable(path: Path) -> None:
    path.write_text(CURVE)
    path.chmod(0)


add(
    socket=("socket.csv", bound),
    device_full=("full.csv", link("/dev/full")),
    device_random=("random.csv", link("/dev/urandom")),
    link_broken=("broken.csv", link("nowhere")),
    link_to_itself=("itself.csv", link("itself.csv")),
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

ODD_CURVES: dict[str, tuple[np.ndarray, np.ndarray]] = {  # us, um
    "all_nan": (TIME, np.full(100, np.nan)),
    "huge": (TIME, np.full(100, 1e308)),
    "denormal": (TIME, np.full(100, 5e-324)),
    "negative": (TIME, -RADIUS),
    "no_rows": (TIME[:0], RADIUS[:0]),
    "same_times": (np.zeros(100), RADIUS),
}
for _name, (_t, _r) in ODD_CURVES.items():
    add(**{
        f"csv_{_name}": ("odd.csv", HEAD + rows(",", _t, _r)),
        f"mat_{_name}": ("odd.mat", saved(Rnew=_r * 1e-6, t=_t * 1e-6)),
    })  # fmt: skip


def labelled(label: str) -> str:
    """The curve as a shot of this label."""
    head, *lines = CURVE.splitlines()
    return "\n".join([f"shot,{head}", *(f"{label},{line}" for line in lines)])


add(
    csv_escape_labels=("a.csv", labelled("\x1b[31mred\x1b[0m\x07")),
    csv_html_labels=("a.csv", labelled("<script>alert(1)</script>")),
    csv_of_html=("a.csv", "<!DOCTYPE html><html><body>404 not found</body></html>\n"),
    json_deep=("a.json", "[" * 100_000 + "]" * 100_000),
    toml_deep=("a.toml", "a = " + "[" * 20_000 + "]" * 20_000),
    references_huge=("a.csv", "set,method,quantity,mean,std\nx,IMR,G_kPa,1e308,1e308\nx,a,G_kPa,5e-324,0\n"),
)
add(**{f"bomb_{name}": (f"bomb.{name.partition('_')[0]}", make) for name, (_, make) in BOMBS.items()})


def damaged(name: str, valid: Make | str, number: int) -> Make:
    return lambda path: path.write_bytes(mutated(name, put(path, valid).read_bytes(), 2, number))


for _name, _valid in (TEXTS | BINARIES | documents()).items():
    add(**{f"damaged_{_name}_{k}": (_name, damaged(_name, _valid, k)) for k in range(DAMAGED)})


def make_all(folder: Path, keys: Iterable[str] = FILES) -> dict[str, Path]:
    """These files, each in its folder, by key."""
    made = {}
    for key in keys:
        name, make = FILES[key]
        place = folder / key
        place.mkdir(parents=True)
        made[key] = put(Path(os.fsdecode(os.fsencode(place) + b"/" + os.fsencode(name))), make)
    return made
