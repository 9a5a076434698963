"""Files made to exhaust or to deceive a reader: what writes each, its ending, and the code by which it is refused."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from files import cells, save_v73, write_ods, write_xlsx
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
for name, (ending, code, content) in TEXTS.items():
    bomb(ending, code, name)(lambda path, content=content: path.write_text(content))


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


def deflated(data):
    packed = zlib.compress(data, 1)
    return struct.pack("<II", 15, len(packed)) + packed


EMPTY_CELLS = array("", 9, b"", shape=(0, 0)) * 100_000
HUGE = array("Rnew", 9, bytes(8_000_000), shape=(1, 1_000_000))
ALL_THAT_IS_READ = array("Rnew", 9, bytes(20_000_000 - 64), shape=(1, 2_499_992))
ELEMENTS = {
    "mat_that_unpacks_to_gigabytes": ("limits.unpacked", HUGE, deflated(array("t", 2, bytes(30_000_000)))),
    "mat_that_unpacks_to_all_that_is_read_and_more": (
        "limits.unpacked", deflated(ALL_THAT_IS_READ), deflated(array("t", 9, bytes(24_000_000))),
    ),
    "mat_of_ten_million_bytes_as_numbers": (
        "limits.numbers", deflated(array("Rnew", 2, bytes(10_000_000))), array("t", 9, bytes(80)),
    ),
    "mat_of_a_million_cells": (
        "limits.cells", deflated(array("R_nondim_All", 0, b"", 1, (1, 100_000), EMPTY_CELLS)),
        array("t_nondim_All", 9, bytes(80)),
    ),
}  # fmt: skip
for name, (code, *elements) in ELEMENTS.items():
    content = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements)
    bomb("mat", code, name)(lambda path, content=content: path.write_bytes(content))
VARIABLES = {
    "mat_of_cells_where_an_array_belongs": ("matlab.cells", cells(np.arange(5.0), np.arange(5.0))),
    "mat_of_complex_numbers": ("matlab.variables", 1j * np.arange(5.0)),
}
for name, (code, radius) in VARIABLES.items():
    bomb("mat", code, name)(lambda path, radius=radius: savemat(path, {"Rnew": radius, "t": np.arange(5.0)}))


@bomb("mat", "matfile.cut")
def mat_truncated(path):
    savemat(path, {"Rnew": np.linspace(1e-4, 2e-4, 500), "t": np.arange(500) * 1e-6})
    path.write_bytes(path.read_bytes()[:-200])


@bomb("mat", "limits.shape")
def mat73_of_one_array_named_often(path):
    save_v73(path, {"big": np.zeros(400_000)})
    with h5py.File(path, "r+") as file:
        for name in ("R_nondim_All", "t_nondim_All"):
            file.create_dataset(name, data=np.full((1, 100), file["big"].ref), dtype=h5py.ref_dtype)


@bomb("mat", "matlab.cells")
def mat73_of_a_cell_that_is_a_group(path):
    two = cells(np.ones(9), np.ones(9))
    save_v73(path, {"R_nondim_All": two, "t_nondim_All": two})
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


def borrowed(path, way):
    """Whose radius is taken, in one of three ways, from a file beside it, which is nobody's business."""
    other = str(path.with_name("secret.h5"))
    with h5py.File(other, "w") as file:
        file["radius"] = np.arange(1.0, 101.0)
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
    bomb("h5", "limits.elsewhere", f"hdf5_that_{way}_another_file")(lambda path, way=way: borrowed(path, way))


@bomb("h5", "hdf5.twice")
def hdf5_of_two_radii(path):
    with h5py.File(path, "w") as file:
        file["time"], file["R"], file["radius"] = (np.arange(1.0, 9.0),) * 3


@bomb("h5", "limits.no_shape")
def hdf5_without_a_shape(path):
    with h5py.File(path, "w") as file:
        file["time"], file["radius"] = np.arange(9.0), h5py.Empty("f8")


# --- workbooks

ENTITIES = '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>'
GRID = '<row r="1"><c r="A1"><v>1</v></c></row><row r="900000"><c r="XFD900000"><v>1</v></c></row>'
SHEETS = {  # what stands before a sheet, and its rows as XML or as cells
    "xlsx_of_one_huge_cell": ("limits.memory", "", f'<row><c t="str"><v>{"x" * 100_000_000}</v></c></row>'),
    "xlsx_of_a_million_rows": ("limits.cells", "", "<row><c><v>1</v></c><c><v>1</v></c></row>" * 600_000),
    "xlsx_of_one_text_named_often": ("limits.text", "", f'<row><c t="str"><v>{"x" * 50_000}</v></c></row>' * 2_400),
    "xlsx_of_a_huge_grid": ("limits.memory", "", GRID),  # the reader alone would end the process for want of memory
    "xlsx_of_entities": ("tabular.workbook", ENTITIES, '<row><c t="inlineStr"><is><t>&b;</t></is></c></row>'),
    "xlsx_of_many_columns": ("limits.columns", "", f"<row>{'<c><v>1</v></c>' * 1200}</row>"),
}
for name, (code, before, rows) in SHEETS.items():
    sheet = {"a": f"{before}<worksheet><sheetData>{rows}</sheetData></worksheet>"}
    bomb("xlsx", code, name)(lambda path, sheet=sheet: write_xlsx(path, sheet))


@bomb("ods", "limits.memory")
def ods_of_repeated_cells(path):
    cell = '<table:table-cell table:number-columns-repeated="9000" office:value-type="float" office:value="1"/>'
    write_ods(path, f'<table:table-row table:number-rows-repeated="9000">{cell}</table:table-row>')
