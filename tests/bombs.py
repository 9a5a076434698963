"""Files made to exhaust or to deceive a reader: what writes each, its ending, and the code by which it is refused."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from files import save_v73, write_ods, write_xlsx
from scipy.io import savemat

HEAD = "time_us,radius_um\n"
FILES: dict[Callable[[Path], object], tuple[str, str]] = {}


def bomb(ending: str, code: str, name: str = "") -> Callable[[Any], Any]:
    def register(make: Callable[[Path], object]) -> Callable[[Path], object]:
        make.__name__ = name or make.__name__
        FILES[make] = ending, code
        return make

    return register


MANY = [f"{k},{k},1\n" for k in range(6000)]
TEXTS = {
    "csv_of_ten_million_lines": ("csv", "limits.lines", HEAD + "1,2\n" * 10_000_000),
    "csv_of_one_line": ("csv", "limits.characters", "1," * 3_000_000),
    "csv_of_many_columns": ("csv", "limits.columns", HEAD + "1,2\n" + "," * 20_000 + "1\n"),
    "csv_of_separators": ("txt", "limits.curves", "1,2\n-1000,-1000\n" * 6_000),
    "csv_of_a_title_of_spaces": ("csv", "table.columns", "time" + " " * 90_000 + "us,radius_um\n1,2\n"),
    "csv_of_many_cells": ("csv", "limits.cells", HEAD + ("1," * 999 + "1\n") * 5_100),
    "csv_of_as_many_shots_as_lines": ("csv", "limits.curves", f"shot,{HEAD}" + "".join(MANY)),
}
SHEETS = {  # the XML of rows
    "xlsx_of_one_huge_cell": ("limits.memory", f'<row><c t="str"><v>{"x" * 100_000_000}</v></c></row>'),
    "xlsx_of_a_million_rows": ("limits.cells", "<row><c><v>1</v></c><c><v>1</v></c></row>" * 600_000),
    "xlsx_of_one_text_named_often": ("limits.text", f'<row><c t="str"><v>{"x" * 50_000}</v></c></row>' * 2_400),
    "xlsx_of_a_huge_grid": (  # two cells; the reader alone would end the whole process for want of memory
        "limits.memory",
        '<row r="1"><c r="A1"><v>1</v></c></row><row r="900000"><c r="XFD900000"><v>1</v></c></row>',
    ),
}
for name, (ending, code, content) in TEXTS.items():
    bomb(ending, code, name)(lambda path, content=content: path.write_text(content))
for name, (code, rows) in SHEETS.items():
    sheet = {"a": f"<worksheet><sheetData>{rows}</sheetData></worksheet>"}
    bomb("xlsx", code, name)(lambda path, sheet=sheet: write_xlsx(path, sheet))


@bomb("csv", "limits.bytes")
def csv_of_a_terabyte(path):
    with path.open("wb") as file:
        file.truncate(10**12)


# --- MATLAB


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def array(name, kind, numbers, array_class=6, shape=None, inner=b""):
    flags = element(6, struct.pack("<II", array_class, 0))
    size = element(5, struct.pack("<2i", *(shape or (1, len(numbers)))))
    return element(14, flags + size + element(1, name.encode()) + (inner or element(kind, numbers)))


def mat(path, *elements):
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements))


def deflated(data):
    packed = zlib.compress(data, 1)
    return struct.pack("<II", 15, len(packed)) + packed


@bomb("mat", "limits.unpacked")
def mat_that_unpacks_to_gigabytes(path):
    huge = array("Rnew", 9, bytes(8_000_000), shape=(1, 1_000_000)), deflated(array("t", 2, bytes(30_000_000)))
    mat(path, *huge)


@bomb("mat", "limits.unpacked")
def mat_that_unpacks_to_all_that_is_read_and_more(path):
    exact = array("Rnew", 9, bytes(20_000_000 - 64), shape=(1, 2_499_992))
    mat(path, deflated(exact), deflated(array("t", 9, bytes(24_000_000))))


@bomb("mat", "limits.numbers")
def mat_of_ten_million_bytes_as_numbers(path):
    mat(path, deflated(array("Rnew", 2, bytes(10_000_000))), array("t", 9, bytes(80)))


@bomb("mat", "limits.cells")
def mat_of_a_million_cells(path):
    cells = array("", 9, b"", shape=(0, 0)) * 100_000
    mat(path, deflated(array("R_nondim_All", 0, b"", 1, (1, 100_000), cells)), array("t_nondim_All", 9, bytes(80)))


@bomb("mat", "matfile.cut")
def mat_truncated(path):
    savemat(path, {"Rnew": np.linspace(1e-4, 2e-4, 500), "t": np.arange(500) * 1e-6})
    path.write_bytes(path.read_bytes()[:-200])


@bomb("mat", "matlab.cells")
def mat_of_cells_where_an_array_belongs(path):
    cells = np.empty((1, 2), dtype=object)
    cells[0, :] = [np.arange(5.0)] * 2
    savemat(path, {"Rnew": cells, "t": np.arange(5.0)})


@bomb("mat", "matlab.variables")
def mat_of_complex_numbers(path):
    savemat(path, {"Rnew": 1j * np.arange(5.0), "t": np.arange(5.0)})


@bomb("mat", "limits.shape")
def mat73_of_one_array_named_often(path):
    with h5py.File(path, "w", userblock_size=512) as file:
        file["big"] = np.zeros(400_000)
        for name in ("R_nondim_All", "t_nondim_All"):
            cells = file.create_dataset(name, (1, 100), h5py.ref_dtype)
            for k in range(100):
                cells[0, k] = file["big"].ref
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(content)


@bomb("mat", "matlab.cells")
def mat73_of_a_cell_that_is_a_group(path):
    cells = np.empty((1, 2), object)
    cells[0, 0] = cells[0, 1] = np.ones((1, 9))
    save_v73(path, {"R_nondim_All": cells, "t_nondim_All": cells})
    with h5py.File(path, "r+") as file:
        file["R_nondim_All"][0, 0] = file["#refs#"].ref


@bomb("mat", "matlab.cells")
def mat73_of_one_reference(path):
    save_v73(path, {"t_nondim_All": np.ones((1, 9))})
    with h5py.File(path, "r+") as file:
        file.create_dataset("R_nondim_All", data=h5py.Reference(), dtype=h5py.ref_dtype)


# --- HDF5


def declared(path, shape, chunk, names=("time", "radius"), **more):
    with h5py.File(path, "w") as file:
        for name in names:
            file.create_dataset(name, shape, "f8", chunks=(chunk,), **more)


@bomb("h5", "limits.shape")
def hdf5_of_a_huge_shape(path):
    declared(path, (10**15,), 1000)


@bomb("h5", "limits.chunks")
def hdf5_of_a_huge_chunk(path):
    declared(path, (100,), 200_000_000, maxshape=(None,))


@bomb("h5", "limits.shape")
def hdf5_of_many_large_arrays(path):
    declared(path, (1_000_000,), 1000, [f"{k}/{name}" for k in range(10) for name in ("time", "radius")])


def theirs(path):
    """A file beside it, whose numbers are nobody's business."""
    other = path.with_name("secret.h5")
    with h5py.File(other, "w") as file:
        file["radius"] = np.arange(1.0, 101.0)
    return str(other)


def borrowed(path, other, way):
    """A file whose radius is taken from another one, in one of three ways."""
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(100.0)
        if way == "reads":
            file.create_dataset("radius", (100,), "u1", external=[(other, 0, 100)])
        elif way == "links_to":
            file["radius"] = h5py.ExternalLink(other, "/radius")
        else:
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(other, "radius", (100,))
            file.create_virtual_dataset("radius", layout)


for way in ("reads", "links_to", "shows"):
    bomb("h5", "limits.elsewhere", f"hdf5_that_{way}_another_file")(
        lambda path, way=way: borrowed(path, theirs(path), way)
    )


@bomb("h5", "hdf5.twice")
def hdf5_of_two_radii(path):
    with h5py.File(path, "w") as file:
        file["time"], file["R"], file["radius"] = (np.arange(1.0, 9.0),) * 3


@bomb("h5", "limits.no_shape")
def hdf5_without_a_shape(path):
    with h5py.File(path, "w") as file:
        file["time"], file["radius"] = np.arange(9.0), h5py.Empty("f8")


# --- workbooks


@bomb("xlsx", "limits.columns")
def xlsx_of_many_columns(path):
    write_xlsx(path, {"a": [["time_us", "radius_um"], [1.0] * 1200]})


@bomb("xlsx", "tabular.workbook")
def xlsx_of_entities(path):
    entities = '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>'
    cell = '<row><c t="inlineStr"><is><t>&b;</t></is></c></row>'
    write_xlsx(path, {"a": f"{entities}<worksheet><sheetData>{cell}</sheetData></worksheet>"})


@bomb("ods", "limits.memory")
def ods_of_repeated_cells(path):
    cell = '<table:table-cell table:number-columns-repeated="9000" office:value-type="float" office:value="1"/>'
    write_ods(path, f'<table:table-row table:number-rows-repeated="9000">{cell}</table:table-row>')
