"""Files made to exhaust or to deceive a reader: what writes each, its ending, and the code by which it is refused."""

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from files import Make, cells, hdf5, save_v73, saved, terabyte, write_ods, write_xlsx

HEAD = "time_us,radius_um\n"
NUMBERS, TWO = np.arange(5.0), cells(np.ones(9), np.ones(9))


def abort(*_: Any) -> None:
    os.abort()


# --- MATLAB


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def array(name: str, *inner: bytes, kind: int = 6, shape: tuple[int, ...] = (1, 1)) -> bytes:
    about = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, about + element(1, name.encode()) + b"".join(inner))


def zeros(name: str, count: int, kind: int = 9) -> bytes:
    """Doubles (9), or bytes (2) that are read as doubles."""
    return array(name, element(kind, bytes(8 * count if kind == 9 else count)), shape=(1, count))


def deflated(data: bytes) -> bytes:
    packed = zlib.compress(data, 1)
    return struct.pack("<II", 15, len(packed)) + packed


def mat(*parts: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(parts)


def referring(refer: Any, **variables: np.ndarray) -> Make:
    """A file of version 7.3 with references beside its variables."""

    def make(path: Path) -> None:
        save_v73(path, variables)
        with h5py.File(path, "r+") as file:
            for name, references in refer(file).items():
                file.create_dataset(name, data=references, dtype=h5py.ref_dtype)

    return make


TIMES = zeros("t", 10)
NAMES = ("R_nondim_All", "t_nondim_All")
REFERENCES = referring(lambda file: dict.fromkeys(NAMES, np.full((1, 100), file["big"].ref)), big=np.zeros(400_000))


# --- HDF5: what is declared and not written, and what is taken from a file that is nobody's business


def declared(count: int, chunk: int, **more: Any) -> dict[str, Any]:
    return {"shape": (count,), "dtype": "f8", "chunks": (chunk,), **more}


HUGE, CHUNK = declared(10**15, 1000), declared(100, 200_000_000, maxshape=(None,))
OUTSIDE = {"shape": (5,), "dtype": "u1", "external": [("/etc/passwd", 0, 5)]}
LINKED = h5py.ExternalLink("secret.h5", "/radius")


SHOWN = h5py.VirtualLayout((5,), "f8")
SHOWN[:] = h5py.VirtualSource("secret.h5", "radius", (5,))


# --- workbooks


def sheet(rows: str, before: str = "") -> Make:
    return lambda path: write_xlsx(path, {"a": f"{before}<worksheet><sheetData>{rows}</sheetData></worksheet>"})


ENTITIES = '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>'
LONG_TEXT = f'<row><c t="str"><v>{"x" * 50_000}</v></c></row>'
GRID = '<row r="1"><c r="A1"><v>1</v></c></row><row r="900000"><c r="XFD900000"><v>1</v></c></row>'
CELL = '<table:table-cell table:number-columns-repeated="9000" office:value-type="float" office:value="1"/>'
REPEATED = f'<table:table-row table:number-rows-repeated="9000">{CELL}</table:table-row>'

BOMBS: dict[str, tuple[str, Make | str | bytes]] = {  # a name begins with the file's ending
    "csv_of_a_terabyte": ("limits.bytes", terabyte()),
    "csv_of_ten_million_lines": ("limits.lines", HEAD + "1,2\n" * 10_000_000),
    "csv_of_one_line": ("limits.characters", "1," * 3_000_000),
    "csv_of_as_many_shots_as_lines": ("limits.curves", f"shot,{HEAD}" + "".join(f"{k},{k},1\n" for k in range(6000))),
    "mat_that_unpacks_to_gigabytes": ("limits.memory", mat(deflated(array("t", element(2, bytes(10**9)))))),
    "mat_of_bytes_as_numbers": ("matlab.variables", mat(deflated(zeros("Rnew", 10**7, 2)), TIMES)),
    "mat_of_cells_where_an_array_belongs": ("matlab.cells", saved(Rnew=TWO, t=NUMBERS)),
    "mat_of_complex_numbers": ("matlab.variables", saved(Rnew=1j * NUMBERS, t=NUMBERS)),
    "mat_cut": ("reading.damaged", mat(zeros("Rnew", 500), zeros("t", 500))[:-200]),
    "mat_73_of_one_array_named_often": ("matlab.variables", REFERENCES),
    "h5_of_a_huge_shape": ("matlab.variables", hdf5(time=HUGE, radius=HUGE)),
    "h5_of_a_huge_chunk": ("matlab.variables", hdf5(time=CHUNK, radius=CHUNK)),
    "h5_without_a_shape": ("matlab.variables", hdf5(time=NUMBERS, radius=h5py.Empty("f8"))),
    "h5_that_reads_another_file": ("matlab.variables", hdf5(time=NUMBERS, radius=OUTSIDE)),
    "h5_that_links_to_another_file": ("matlab.variables", hdf5(time=NUMBERS, radius=LINKED)),
    "h5_that_shows_another_file": ("matlab.variables", hdf5(time=NUMBERS, radius=SHOWN)),
    "xlsx_of_one_huge_cell": ("limits.characters", sheet(f'<row><c t="str"><v>{"x" * 100_000_000}</v></c></row>')),
    "xlsx_of_one_text_named_often": ("limits.characters", sheet(LONG_TEXT * 2_400)),
    "xlsx_of_a_huge_grid": ("reading.ended", sheet(GRID)),
    "xlsx_of_entities": ("reading.damaged", sheet('<row><c t="str"><v>&b;</v></c></row>', ENTITIES)),
    "ods_of_repeated_cells": ("reading.ended", lambda path: write_ods(path, REPEATED)),
}
