"""Files -> RadiusCurves: MATLAB (BDT cells, IMR files), CSV and text tables, HDF5, Excel; and CSV back.

The content of a file decides, not its ending.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, as_path, require
from cavirheo.reading.curve_tables import write_csv
from cavirheo.reading.files import guarded, sha256, shown
from cavirheo.reading.selection import Chosen, selected
from cavirheo.video.frames import is_recording

if TYPE_CHECKING:
    from cavirheo.video.measurement import MeasureOptions

__all__ = ["read_curves", "write_csv"]

_EXPECTED = (
    "expected .mat (R_nondim_All + t_nondim_All + RmaxList, or Rnew + t), .csv or .txt (columns time_us,radius_um), "
    ".h5 (groups with time and radius), .xlsx, .xls or .ods"
)
_NO_GROWTH = (
    "no growth recorded: R_max is taken to be where the file says or at the first frame; "
    "if the recording began later, R_max is larger and G smaller than found"
)


def read_curves(
    path: str | Path,
    *,
    density: float = 998.0,
    pressure: float = 101325.0,
    frame_rate_hz: float | None = None,
    shots: Chosen = None,
    um_per_px: float | None = None,
    exposure: float | None = None,
    exclude: str | Iterable[int] | None = None,
) -> list[RadiusCurve]:
    """Every radius history of a file.

    Args:
        path: a table, a .mat or HDF5 file, or a recording (docs/how-to/your-shots.md).
        density: kg/m3. It and `pressure` turn dimensionless times into seconds, t = t* R_max sqrt(rho/p); files with
            times in seconds do not depend on them.
        pressure: Pa.
        frame_rate_hz: 1/s, of a recording, and of a table that has frame numbers and no times.
        shots: only these, "1,4-7" or [1, 4, 5, 6, 7], from 1 in the order of the file.
        um_per_px: micrometres per pixel of a recording, which is measured (`cavirheo.measure`).
        exposure: s, of a frame of a recording.
        exclude: frames of a recording to leave out, "12,40-45" or a list, from 1.

    Returns:
        The curves in the order of the file, (n,) times in s and radii in m. One that cannot be used (empty cell, three
        samples, all NaN) is returned with its reason; its `max_radius` raises it. What was recognised, converted or
        left out stands in each curve's `notes`, what makes the recording doubtful in its `warnings` too.

    Raises:
        InputError: the file cannot be found or read, or holds no radius history, or not so many; the message says what
            was found.
    """
    path = as_path(path)
    if is_recording(path):
        from cavirheo.reading.recordings import examine

        options: MeasureOptions = {"frame_rate": frame_rate_hz, "um_per_px": um_per_px}
        options |= {"exposure": exposure, "exclude": exclude}
        return [noted(curve) for curve in selected([examine(path, sheet=True, **options)[1]], shots)]
    message = f"{shown(path)}: frames are excluded of recordings; of a table empty their radius"
    require(exclude is None, message, "reading.exclude")
    with guarded(path, _EXPECTED):
        with path.open("rb") as file:
            head = file.read(1024)
        require(len(head) > 0, f"the file is empty; {_EXPECTED}", "reading.empty")
        found = _read(head, path, density, pressure, frame_rate_hz)
        require(len(found) > 0, f"no curve in it; {_EXPECTED}", "reading.none")
        digest = sha256(path)
        for k, curve in enumerate(found):
            name = path.stem if len(found) == 1 else f"{path.stem}[{curve.meta.get('label', k + 1)}]"
            origin: dict[str, Any] = {"name": name, "group": path.stem, "source": shown(path), "source_sha256": digest}
            found[k] = curve.labelled(**origin)
        return [noted(curve) for curve in selected(found, shots)]


def _read(head: bytes, path: Path, density: float, pressure: float, frame_rate: float | None) -> list[RadiusCurve]:
    """The curves of a file that begins with `head`."""
    from cavirheo.reading import curve_tables, formats, hdf5, matlab

    if found := matlab.read_variables(path, matlab.WANTED):
        return matlab.curves(*found, density, pressure)
    if head.startswith(matlab.HDF5):
        return hdf5.read(path)
    require(formats.kind_of(head) != "binary", f"binary data of no known format; {_EXPECTED}", "reading.binary")
    return curve_tables.read(path, density, pressure, frame_rate)


def noted(curve: RadiusCurve) -> RadiusCurve:
    """The curve with the notes that need its maximum."""
    try:
        start, spikes = curve.time_of_max, curve.spikes()
    except InputError:
        return curve
    growth = int(((curve.time < start) & (curve.radius > 0)).sum())
    notes = [f"{growth} measured frames before R_max (growth)" if growth else _NO_GROWTH]
    if spikes:
        notes.append(f"{len(spikes)} single frames stand out by more than 20 % of R_max; kept, but probably wrong")
    return curve.with_notes(*notes)
