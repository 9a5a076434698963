"""Files for tests as other programs write them: workbooks (.xlsx, .ods, .xls), MATLAB files and HDF5."""

import os
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import h5py
import numpy as np
from scipy.io import savemat

Make = Callable[[Path], object]  # writes a file

_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006/relationships"
_ODS = ("office", "table", "text", "manifest")


def _cell(value: object) -> str:
    """Numbers as numbers, the rest as text; None is no cell."""
    if value is None:
        return "<c/>"
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    return f"<c><v>{value}</v></c>"


def write_xlsx(
    path: Path, sheets: Mapping[str, Iterable[Sequence[object]] | str | bytes], hidden: Sequence[str] = ()
) -> Path:
    """A workbook whose tabs are `sheets` in their order: rows, or the XML of a sheet.

    The last tab lies in sheet1.xml: the order of the files is not that of the tabs.
    """
    tabs = ""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for k, (name, content) in zip(range(len(sheets), 0, -1), sheets.items(), strict=True):
            state = ' state="hidden"' if name in hidden else ""
            tabs += f'<sheet name="{escape(name)}" sheetId="{k}"{state} r:id="rId{k}"/>'
            if not isinstance(content, str | bytes):
                rows = "".join(f"<row>{''.join(map(_cell, row))}</row>" for row in content)
                content = f'<worksheet xmlns="{_MAIN}"><sheetData>{rows}</sheetData></worksheet>'
            archive.writestr(f"xl/worksheets/sheet{k}.xml", content)
        book = f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}"><sheets>{tabs}</sheets></workbook>'
        archive.writestr("xl/workbook.xml", book)
        parts = [f"worksheets/sheet{k}" for k in range(1, len(sheets) + 1)]
        for place, kind, targets in (("", "officeDocument", ["xl/workbook"]), ("xl/", "worksheet", parts)):
            relations = "".join(
                f'<Relationship Id="rId{k}" Type="{_OFFICE}/{kind}" Target="{target}.xml"/>'
                for k, target in enumerate(targets, 1)
            )
            name = f"{place}_rels/{'workbook.xml' if place else ''}.rels"
            archive.writestr(name, f'<Relationships xmlns="{_PACKAGE}">{relations}</Relationships>')
    return path


def write_ods(path: Path, table: str) -> Path:
    """An OpenDocument workbook of one sheet, from the XML of its rows."""
    spaces = " ".join(f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in _ODS)
    body = f'<office:spreadsheet><table:table table:name="a">{table}</table:table></office:spreadsheet>'
    content = f"<office:document-content {spaces}><office:body>{body}</office:body></office:document-content>"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("META-INF/manifest.xml", f"<manifest:manifest {spaces}/>")
        archive.writestr("content.xml", content)
    return path


def ods_row(cells: Sequence[object]) -> str:
    """The XML of one row of numbers and texts."""
    made = ""
    for value in cells:
        about = 'string"' if isinstance(value, str) else f'float" office:value="{value}"'
        made += f'<table:table-cell office:value-type="{about}><text:p>{escape(str(value))}</text:p></table:table-cell>'
    return f"<table:table-row>{made}</table:table-row>"


def write_xls(path: Path) -> Path:
    """An old workbook: the cells a, b over 1.5, 2."""
    path.write_bytes((Path(__file__).parent / "cases" / "old.xls").read_bytes())
    return path


def save_v73(path, variables):
    """As MATLAB does it: HDF5 behind 512 bytes, arrays transposed, cells as references, empty ones flagged."""
    with h5py.File(path, "w", userblock_size=512) as file:
        store = file.create_group("#refs#")
        for name, value in variables.items():
            if not isinstance(value, np.ndarray) or value.dtype != object:
                file[name] = np.atleast_2d(value).T
                continue
            references = []
            for k, cell in enumerate(value.ravel()):
                item = store.create_dataset(f"{name}{k}", data=cell.T if cell.size else np.array([0, 0], dtype="u8"))
                if not cell.size:
                    item.attrs["MATLAB_empty"] = np.uint8(1)
                references.append(item.ref)
            file.create_dataset(name, data=np.array(references, dtype=h5py.ref_dtype)[:, None])
    content = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + content[128:])


def saved(packed: bool = False, **variables: object) -> Make:
    return lambda path: savemat(path, variables, do_compression=packed)


def saved73(**variables: object) -> Make:
    return lambda path: save_v73(path, variables)


def hdf5(named: Mapping[str | bytes, object] | None = None, **data: object) -> Make:
    """Data sets, and attributes of the file (`@name`) or of one (`t@unit`); a dict is what create_dataset takes."""

    def make(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, values in {**(named or {}), **data}.items():
                owner, at, attribute = str(name).partition("@")
                if at:
                    file[owner or "/"].attrs[attribute] = values
                elif isinstance(values, dict):
                    file.create_dataset(name, **values)
                elif isinstance(values, h5py.VirtualLayout):
                    file.create_virtual_dataset(name, values)
                else:
                    file[name] = values

    return make


def put(path: Path, content: str | bytes | Make) -> Path:
    """A text, bytes, or what writes the file."""
    if callable(content):
        content(path)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    return path


def terabyte(begins: bytes = b"") -> Make:
    """Of zeros, none of which is on the disk."""
    return lambda path: (path.write_bytes(begins), os.truncate(path, 10**12))


# growth, a collapse at t* = 0.93 and four smaller ones; enough like a bubble for a reader
T_STAR = np.linspace(-0.6, 4.0, 180)
_LOBES = np.sqrt(np.clip(1.0 - (((T_STAR + 0.93) % 1.86 - 0.93) / 0.93) ** 2, 0.0, 1.0)) ** 0.9
R_STAR = 0.12 + 0.88 * _LOBES * np.exp(-0.8 * np.maximum(T_STAR - 0.93, 0.0))
R_MAX = 200e-6
T_C = R_MAX * np.sqrt(998.0 / 101325.0)
TIME, RADIUS = T_STAR * T_C, R_STAR * R_MAX


def cells(*arrays):
    row = np.empty((1, len(arrays)), dtype=object)
    for k, array in enumerate(arrays):
        row[0, k] = np.asarray(array, dtype=float).reshape(-1, 1)
    return row


def bdt_variables(radii=(R_STAR, R_STAR, R_STAR), times=(T_STAR, T_STAR, T_STAR), maxima=(1e-4, 2e-4, 3e-4)):
    about = {"RmaxList": np.array([maxima]), "lambda_max_mean": 6.5, "lambda_max_std": 0.4}
    return {"R_nondim_All": cells(*radii), "t_nondim_All": cells(*times), **about}


def text_table(path, header, *columns):
    path.write_text((f"{header}\n" if header else "") + lines(",", *columns))
    return path


def write_curve(path, curve):
    """A RadiusCurve as other programs write it, with the stretch if it has one; its path."""
    columns = {"time_us": 1e6 * curve.time, "radius_um": 1e6 * curve.radius}
    stated = {"stretch": curve.stretch, "stretch_std": curve.stretch_std}
    columns |= {name: np.full(len(curve.time), value) for name, value in stated.items() if value is not None}
    return text_table(path, ",".join(columns), *columns.values())


def lines(separator, *columns, comma=False):
    text = "\n".join(separator.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)) + "\n"
    return text.replace(".", ",") if comma else text
