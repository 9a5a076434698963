"""A report with all its curves as files, which go into one zip."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.reading import write_csv
from cavirheo.reporting import file_names, write_report
from cavirheo.reporting.record import Pairs
from cavirheo.writing.document import LIST

_PICTURES = ("png", "svg")


def write_bundle(folder: Path, pairs: Pairs, command: str, fits: Pairs, done: Callable[[], None]) -> None:
    """What `write_report` writes into `folder`, of conventional fits into least-squares/, and the processed and
    simulated curves as CSV. done: called after each picture. Raises as `write_report`."""
    document = write_report(folder, pairs, command, _PICTURES, done=done)
    if fits:
        write_report(folder / "least-squares", fits, f"{command}; then fit", _PICTURES, done=done)
    for one in (folder, folder / "least-squares"):
        (one / LIST).unlink(missing_ok=True)  # it tells one run from the next; a bundle is of one
    for kind in ("processed", "simulated"):
        (folder / kind).mkdir()
    names = file_names([record.name for record in document.curves])
    for stem, (curve, posterior) in zip(names, pairs, strict=True):
        write_csv(folder / "processed" / f"{stem}.csv", curve)
        time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
        if time is not None and radius is not None:
            # a drawn point beside a frame, which ten digits of a microsecond do not tell from it
            kept = np.diff(time, prepend=-np.inf) > 1e-15
            write_csv(folder / "simulated" / f"{stem}.csv", RadiusCurve(time[kept], radius[kept]))
