"""A report with all its curves as files, in one zip."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.io import write_csv
from cavirheo.reporting import file_names, write_report
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits
from cavirheo.writing.document import LIST
from cavirheo.writing.packing import key_of

_FIGURES = ("png", "svg")


def zipped(
    pairs: Pairs,
    document: Result,
    fits: Pairs,
    advance: Callable[[], None],
    once: Callable[[str, Callable[[], bytes]], bytes],
) -> bytes:
    """The zip of the folder cavirheo-result, as `write_bundle` makes it; once: as `Store.once`, by which a class with
    one demo file waits for one zip. Raises as `write_bundle`."""
    date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    published = {group.name: group.published for group in document.groups}
    head: dict[str, Any] = {"notes": document.notes, "published": published, "date": date}

    def build() -> bytes:
        with TemporaryDirectory() as base:
            folder = Path(base, "cavirheo-result")
            write_bundle(folder, pairs, document.command, fits, advance, **head)
            return Path(shutil.make_archive(f"{base}/made", "zip", base, folder.name)).read_bytes()

    return once(key_of([pairs, document.command, fits, head]), build)


def write_bundle(
    folder: Path, pairs: Pairs, command: str, fits: Pairs, advance: Callable[[], None], **head: Any
) -> None:
    """What `write_report` writes into `folder`, of conventional fits into least-squares/, and the processed and
    simulated curves as CSV. head: date, notes and published, as there. advance: called after each figure. Raises as
    `write_report`."""
    document = write_report(folder, pairs, command, _FIGURES, advance=advance, **head)
    if fits:
        write_report(folder / "least-squares", fits, f"{command}; then fit", _FIGURES, advance=advance, **head)
    for directory in (folder, folder / "least-squares"):
        (directory / LIST).unlink(missing_ok=True)  # it tells one run from the next; a bundle is of one
    for kind in ("processed", "simulated"):
        (folder / kind).mkdir()
    names = file_names([record.name for record in document.curves])
    for stem, (curve, posterior), record in zip(names, pairs, document.curves, strict=True):
        write_csv(folder / "processed" / f"{stem}.csv", curve)
        time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
        if time is not None and radius is not None:
            # a drawn point beside a frame, which ten digits of a microsecond do not tell from it
            distinct = np.diff(time, prepend=-np.inf) > 1e-15
            simulation = digits.simulated(posterior.method).replace(" ", "-")
            place = folder / "simulated" / f"{stem}-{simulation}.csv"
            remark = f"simulation of {record.name}, {record.simulated}"
            write_csv(place, RadiusCurve(time[distinct], radius[distinct]), remark)
