"""Files made to exhaust or to deceive a reader: each is refused with the reason before it takes time or memory."""

import os
import socket
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from files import save_v73, write_ods, write_xlsx
from scipy.io import savemat

from cavirheo.companions.collapse_times import read_table
from cavirheo.companions.published_values import read_references
from cavirheo.companions.rheometer.read import read_sweeps
from cavirheo.errors import InputError
from cavirheo.io import limits, read_curves, workbook
from cavirheo.io.trace import read_trace

HEAD = "time_us,radius_um\n"


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


def csv_of_ten_million_lines(path):
    path.write_bytes(HEAD.encode() + b"1,2\n" * 10_000_000)


def csv_of_one_line(path):
    path.write_text("1," * 3_000_000)


def csv_of_many_columns(path):
    path.write_text(HEAD + "1,2\n" + "," * 20_000 + "1\n")


def csv_of_as_many_shots_as_lines(path):
    path.write_text("shot,time_us,radius_um\n" + "".join(f"{k},{k},100\n" for k in range(6_000)))


def csv_of_separators(path):
    path.write_text("1,2\n-1000,-1000\n" * 6_000)


def mat_that_unpacks_to_gigabytes(path):
    huge = array("Rnew", 9, bytes(8_000_000), shape=(1, 1_000_000)), deflated(array("t", 2, bytes(30_000_000)))
    mat(path, *huge)


def mat_of_ten_million_bytes_as_numbers(path):
    mat(path, deflated(array("Rnew", 2, bytes(10_000_000))), array("t", 9, bytes(80)))


def mat_of_a_million_cells(path):
    cells = array("", 9, b"", shape=(0, 0)) * 100_000
    mat(path, deflated(array("R_nondim_All", 0, b"", 1, (1, 100_000), cells)), array("t_nondim_All", 9, bytes(80)))


def mat_truncated(path):
    savemat(path, {"Rnew": np.linspace(1e-4, 2e-4, 500), "t": np.arange(500) * 1e-6})
    path.write_bytes(path.read_bytes()[:-200])


def hdf5_of_a_huge_shape(path):
    with h5py.File(path, "w") as file:
        for name in ("time", "radius"):
            file.create_dataset(name, (10**15,), "f8", chunks=(1000,))


def hdf5_of_a_huge_chunk(path):
    with h5py.File(path, "w") as file:
        for name in ("time", "radius"):
            file.create_dataset(name, (100,), "f8", chunks=(200_000_000,), maxshape=(None,))


def hdf5_of_many_large_arrays(path):
    with h5py.File(path, "w") as file:
        for k in range(10):
            for name in ("time", "radius"):
                file.create_dataset(f"{k}/{name}", (1_000_000,), "f8", chunks=(1000,))


def hdf5_that_reads_another_file(path):
    other = path.with_name("secret")
    other.write_bytes(bytes(range(100)) * 8)
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(100.0)
        file.create_dataset("radius", (100,), "u1", external=[(str(other), 0, 100)])


def hdf5_that_links_to_another_file(path):
    other = path.with_name("secret.h5")
    with h5py.File(other, "w") as file:
        file["radius"] = np.arange(1.0, 101.0)
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(100.0)
        file["radius"] = h5py.ExternalLink(str(other), "/radius")


def hdf5_that_shows_another_file(path):
    other = path.with_name("secret.h5")
    with h5py.File(other, "w") as file:
        file["radius"] = np.arange(1.0, 101.0)
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(100.0)
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource(str(other), "radius", (100,))
        file.create_virtual_dataset("radius", layout)


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


def xlsx_of_one_huge_cell(path):
    write_xlsx(
        path,
        {"a": f'<worksheet><sheetData><row><c t="str"><v>{"x" * 100_000_000}</v></c></row></sheetData></worksheet>'},
    )


def xlsx_of_many_columns(path):
    write_xlsx(path, {"a": [["time_us", "radius_um"], [1.0] * 1200]})


def xlsx_of_a_huge_grid(path):
    """Two cells; the reader alone would end the whole process for want of memory."""
    cells = '<row r="1"><c r="A1"><v>1</v></c></row><row r="900000"><c r="XFD900000"><v>1</v></c></row>'
    write_xlsx(path, {"a": f"<worksheet><sheetData>{cells}</sheetData></worksheet>"})


def xlsx_of_entities(path):
    entities = '<!DOCTYPE w [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>'
    cell = '<row><c t="inlineStr"><is><t>&b;</t></is></c></row>'
    write_xlsx(path, {"a": f"{entities}<worksheet><sheetData>{cell}</sheetData></worksheet>"})


def xlsx_of_a_million_rows(path):
    """A hundred kilobytes."""
    write_xlsx(
        path,
        {"a": f"<worksheet><sheetData>{'<row><c><v>1</v></c><c><v>1</v></c></row>' * 600_000}</sheetData></worksheet>"},
    )


def xlsx_of_one_text_named_often(path):
    cells = f'<row><c t="str"><v>{"x" * 50_000}</v></c></row>' * 2_400
    write_xlsx(path, {"a": f"<worksheet><sheetData>{cells}</sheetData></worksheet>"})


def csv_of_a_terabyte(path):
    with path.open("wb") as file:
        file.truncate(10**12)


def csv_of_a_title_of_spaces(path):
    path.write_text("time" + " " * 90_000 + "us,radius_um\n1,2\n")


def csv_of_many_cells(path):
    path.write_bytes(b"time_us,radius_um\n" + (b"1," * 999 + b"1\n") * 5_100)


def mat_of_cells_where_an_array_belongs(path):
    cells = np.empty((1, 2), dtype=object)
    cells[0, :] = [np.arange(5.0)] * 2
    savemat(path, {"Rnew": cells, "t": np.arange(5.0)})


def mat_of_complex_numbers(path):
    savemat(path, {"Rnew": 1j * np.arange(5.0), "t": np.arange(5.0)})


def hdf5_of_two_radii(path):
    with h5py.File(path, "w") as file:
        file["time"], file["R"], file["radius"] = (np.arange(1.0, 9.0),) * 3


def ods_of_repeated_cells(path):
    cell = '<table:table-cell table:number-columns-repeated="9000" office:value-type="float" office:value="1"/>'
    write_ods(path, f'<table:table-row table:number-rows-repeated="9000">{cell}</table:table-row>')


def hdf5_without_a_shape(path):
    with h5py.File(path, "w") as file:
        file["time"], file["radius"] = np.arange(9.0), h5py.Empty("f8")


def mat73_of_a_cell_that_is_a_group(path):
    cells = np.empty((1, 2), object)
    cells[0, 0] = cells[0, 1] = np.ones((1, 9))
    save_v73(path, {"R_nondim_All": cells, "t_nondim_All": cells})
    with h5py.File(path, "r+") as file:
        file["R_nondim_All"][0, 0] = file["#refs#"].ref


def mat73_of_one_reference(path):
    save_v73(path, {"t_nondim_All": np.ones((1, 9))})
    with h5py.File(path, "r+") as file:
        file.create_dataset("R_nondim_All", data=h5py.Reference(), dtype=h5py.ref_dtype)


FILES = {
    csv_of_ten_million_lines: ("csv", "limits.lines"),
    csv_of_one_line: ("csv", "limits.characters"),
    csv_of_many_columns: ("csv", "limits.columns"),
    csv_of_as_many_shots_as_lines: ("csv", "limits.curves"),
    csv_of_separators: ("txt", "limits.curves"),
    mat_that_unpacks_to_gigabytes: ("mat", "limits.unpacked"),
    mat_of_ten_million_bytes_as_numbers: ("mat", "limits.numbers"),
    mat_of_a_million_cells: ("mat", "limits.cells"),
    mat_truncated: ("mat", "matfile.cut"),
    hdf5_of_a_huge_shape: ("h5", "limits.shape"),
    hdf5_of_a_huge_chunk: ("h5", "limits.chunks"),
    hdf5_of_many_large_arrays: ("h5", "limits.shape"),
    hdf5_that_reads_another_file: ("h5", "limits.elsewhere"),
    hdf5_that_links_to_another_file: ("h5", "limits.elsewhere"),
    hdf5_that_shows_another_file: ("h5", "limits.elsewhere"),
    mat73_of_one_array_named_often: ("mat", "limits.shape"),
    csv_of_a_terabyte: ("csv", "limits.bytes"),
    csv_of_a_title_of_spaces: ("csv", "table.columns"),
    csv_of_many_cells: ("csv", "limits.cells"),
    mat_of_cells_where_an_array_belongs: ("mat", "matlab.cells"),
    mat_of_complex_numbers: ("mat", "matlab.variables"),
    hdf5_of_two_radii: ("h5", "hdf5.twice"),
    hdf5_without_a_shape: ("h5", "limits.no_shape"),
    mat73_of_a_cell_that_is_a_group: ("mat", "matlab.cells"),
    mat73_of_one_reference: ("mat", "matlab.cells"),
    xlsx_of_one_huge_cell: ("xlsx", "limits.memory"),
    xlsx_of_a_million_rows: ("xlsx", "limits.cells"),
    xlsx_of_one_text_named_often: ("xlsx", "limits.text"),
    xlsx_of_many_columns: ("xlsx", "limits.columns"),
    xlsx_of_a_huge_grid: ("xlsx", "limits.memory"),
    xlsx_of_entities: ("xlsx", "tabular.workbook"),
    ods_of_repeated_cells: ("ods", "limits.memory"),
}


@pytest.mark.parametrize("make", FILES, ids=lambda make: make.__name__)
def test_refused_with_the_reason(tmp_path, monkeypatch, make):
    monkeypatch.setattr(limits, "INFLATED", 20_000_000)
    monkeypatch.setattr(workbook, "MEMORY", 300_000_000)
    ending, code = FILES[make]
    path = tmp_path / f"file.{ending}"
    make(path)
    with pytest.raises(InputError) as error:
        read_curves(path)
    assert error.value.code == code, error.value


ROOMS = [read_curves, read_sweeps, read_table, read_references, read_trace]


@pytest.mark.parametrize("read", ROOMS, ids=lambda read: read.__name__)
def test_what_is_no_file_is_refused_before_it_is_opened(tmp_path, monkeypatch, read):
    """None of these may be waited for."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.csv")
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("socket.csv")
    Path("loop.csv").symlink_to("loop.csv")
    Path("file.csv").touch()
    refused = {
        "pipe.csv": "special", "socket.csv": "special", "/dev/zero": "special", "loop.csv": "unreadable",
        "n" * 300: "unreadable", ".": "folder", "file.csv/inside.csv": "missing", "a\0.csv": "missing",
    }  # fmt: skip
    for name, code in refused.items():
        with pytest.raises(InputError) as error:
            read(Path(name))
        assert error.value.code == f"reading.{code}", name
        assert str(error.value).isprintable()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("read", ROOMS, ids=lambda read: read.__name__)
def test_files_that_may_not_be_read(tmp_path, read):
    for path, locked in ((tmp_path / "a.csv", tmp_path / "a.csv"), (tmp_path / "sub" / "a.csv", tmp_path / "sub")):
        path.parent.mkdir(exist_ok=True)
        path.write_text(HEAD)
        locked.chmod(0)
        with pytest.raises(InputError) as error:
            read(path)
        locked.chmod(0o700)
        assert error.value.code == "reading.unreadable"


@pytest.mark.parametrize("read", ROOMS, ids=lambda read: read.__name__)
def test_damaged_files_are_refused_in_every_room(tmp_path, read):
    savemat(tmp_path / "a.mat", {"pIMR_array": np.ones((40, 3)), "Rnew": np.ones(40), "t": np.arange(40.0)})
    write_xlsx(tmp_path / "a.xlsx", {"a": [["time_us", "radius_um"], *((k, 100 + k) for k in range(40))]})
    random = np.random.default_rng(2)
    for trial in range(24):
        source = tmp_path / ("a.mat", "a.xlsx", "a.xlsx")[trial % 3]
        content = bytearray(source.read_bytes())
        for place in random.integers(0, len(content), 6):
            content[place] = random.integers(256)
        (tmp_path / "b.csv").write_bytes(content[: random.integers(100, len(content))] if trial % 2 else content)
        with suppress(InputError):
            read(tmp_path / "b.csv")


def test_a_large_recording_is_within_the_limits(tmp_path):
    """The limits are far above what cameras record: 100 000 frames of one shot are read."""
    path = tmp_path / "long.h5"
    t = np.arange(100_000) * 1e-9
    with h5py.File(path, "w") as file:
        file["time"], file["radius"] = t, 1e-4 * (0.2 + np.abs(np.cos(t / 9e-6)))
    (curve,) = read_curves(path)
    assert len(curve.time) == 100_000 < limits.SAMPLES / 10


def test_large_variables_that_are_not_read_do_not_count(tmp_path):
    """A workspace saved whole, pictures and all."""
    path = tmp_path / "workspace.mat"
    t = np.arange(160) * 1e-6
    shot = {"Rnew": 1e-4 * (0.2 + np.abs(np.cos(t / 2e-5))), "t": t}
    savemat(path, {"video": np.zeros((100, 256, 512), np.uint8), **shot}, do_compression=True)
    assert len(read_curves(path)) == 1


@pytest.mark.parametrize("radius", [1e308, np.nan])
def test_numbers_beyond_all_bounds_print_nothing(tmp_path, radius, recwarn):
    """A warning of numpy would be a line that nobody asked for."""
    path = tmp_path / "axes.txt"
    np.savetxt(path, np.c_[np.arange(50.0), np.full(50, radius), np.full(50, -radius)])
    with pytest.raises(InputError):
        read_curves(path)
    savemat(
        path.with_suffix(".mat"), {"shift_normRnew": np.full((2, 50), 1e308), "Rmax": [1e308] * 2, "t": np.arange(50)}
    )
    read_curves(path.with_suffix(".mat"))
    assert not recwarn.list
