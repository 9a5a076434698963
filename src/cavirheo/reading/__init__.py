"""Files -> RadiusCurves: MATLAB (BDT cells, IMR files), CSV and text tables, HDF5, Excel; and CSV back.

| module | knows |
|---|---|
| clean | samples as they come -> one RadiusCurve with its notes: units, NaN, order, duplicates |
| tabular | any text or workbook as rows of cells; what the title of a column says |
| workbook | the sheets of an .xlsx, .xls, .ods, read in a process of its own |
| table | rows of cells as curves: columns with titles, InCA exports, curves separated by rows -1000,-1000 |
| matlab | .mat of v5 to v7.3: which variables make which format |
| matfile | the bytes of a .mat of v5 to v7 |
| hdf5 | this project's own .h5 layout |
| trace | the pressure far from the bubble, over time |
| limits | how much of a file is read |
| shots | several files -> the shots of one run and their groups |

The content of a file decides, not its ending.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading.table import write_csv

__all__ = ["read_curves", "write_csv"]

_VIDEO = {".mp4", ".avi", ".mov", ".mkv", ".cine", ".tif", ".tiff", ".gif"}
_EXPECTED = (
    "expected .mat (R_nondim_All + t_nondim_All + RmaxList, or Rnew + t), .csv or .txt (columns time_us,radius_um), "
    ".h5 (groups with time and radius), .xlsx, .xls or .ods"
)


def read_curves(path: str | Path, *, density: float = 998.0, pressure: float = 101325.0) -> list[RadiusCurve]:
    """Every radius history of a file, in its order; times in s, radii in m.

    `density` (kg/m3) and `pressure` (Pa) turn dimensionless times into seconds, t = t* R_max sqrt(rho/p), and serve the
    plausibility check of the scale; files with times in seconds do not depend on them. A curve of a file that cannot be
    used (empty cell, three samples, all NaN) is returned with its reason; its `max_radius` raises it. What was
    recognised, converted or left out stands in each curve's `notes`.

    Raises:
        InputError: the file cannot be found or read, or holds no radius history; the message says what was found.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory; give the files in it, e.g. {path}/*.mat", "reading.folder")
    if not path.exists():
        raise InputError(f"{path} does not exist", "reading.missing")
    if path.suffix.lower() in _VIDEO:
        raise InputError(
            f"{path} is a video or image; measure R(t) in it with another program and give its table, "
            "a CSV with the columns time_us,radius_um",
            "reading.video",
        )
    try:
        with path.open("rb") as file:
            head = file.read(1024)
            file.seek(0)
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if not head:
            raise InputError(f"the file is empty; {_EXPECTED}", "reading.empty")
        found = _reader(head, path)(path, density, pressure)
        return [_finished(curve, path, digest, k, len(found), density, pressure) for k, curve in enumerate(found, 1)]
    except InputError as error:
        raise error.within(str(path)) from None
    except Exception as error:  # damaged files make the parsers below raise nearly anything
        raise InputError(
            f"{path} cannot be read, it may be damaged ({type(error).__name__}: {error}); {_EXPECTED}",
            "reading.damaged",
        ) from error


def _reader(head: bytes, path: Path) -> Callable[[Path, float, float], list[RadiusCurve]]:
    """The reader for a file that begins with `head`."""
    from cavirheo.reading import hdf5, matlab, table
    from cavirheo.reading.tabular import kind_of

    if head.startswith(b"MATLAB 7.3") or (path.suffix.lower() == ".mat" and head[:4] == b"\x89HDF"):
        return matlab.read_v73
    if head.startswith(b"MATLAB 5.0") or head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        return matlab.read_v5
    if head.startswith(b"\x89HDF\r\n\x1a\n"):
        return hdf5.read
    if kind_of(head) != "binary":
        return table.read
    raise InputError(f"binary data of no known format; {_EXPECTED}", "reading.binary")


def _finished(
    curve: RadiusCurve, path: Path, digest: str, number: int, of: int, density: float, pressure: float
) -> RadiusCurve:
    """The curve with its name, its source, and the notes that need its maximum."""
    name = path.stem if of == 1 else f"{path.stem}[{curve.meta.get('label', number)}]"
    origin = {"name": name, "group": path.stem, "source": str(path), "source_sha256": digest}
    curve = replace(curve, meta={**curve.meta, **origin})
    try:
        start, spikes = curve.time_of_max, curve.spikes()
    except InputError:
        return curve
    growth = int(((curve.time < start) & (curve.radius > 0)).sum())
    notes = [
        f"{growth} measured frames before R_max (growth)"
        if growth
        else "no growth recorded: R_max is taken to be where the file says or at the first frame; "
        "if the recording began later, R_max is larger and G smaller than found"
    ]
    if spikes:
        notes.append(f"{len(spikes)} single frames stand out by more than 20 % of R_max; kept, but probably wrong")
    warning = curve.scale_warning(density, pressure)
    return curve.with_notes(*notes, *([warning] if warning else []))
