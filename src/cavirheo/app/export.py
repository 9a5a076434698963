"""Everything of a session in one zip: what `cavirheo infer -o` writes, and the curves as CSV."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo.app.session import Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading import write_csv
from cavirheo.reporting import file_names, write_report


def write_zip(session: Session) -> Path:
    """cavirheo-result.zip in the visitor's folder.

    | in it | what |
    |---|---|
    | result.json, result.csv, report.html, NAME.png, NAME.svg | as the command line writes them |
    | processed/NAME.csv | the curve as it was used: times from the file, radii scaled, frames without a radius nan |
    | simulated/NAME.csv | the simulation of the answer that was laid over it |
    | least-squares/ | the same documents for the conventional fits that were made |

    Raises:
        InputError: there is no answer yet.
    """
    if not session.pairs:
        raise InputError("nothing to export: infer first (step 3)")
    with TemporaryDirectory(dir=session.folder) as name:
        folder = Path(name) / "cavirheo-result"
        write_report(folder, session.pairs, session.command, ("png", "svg"))
        fitted = [(curve, session.fits[curve.name]) for curve, _ in session.pairs if curve.name in session.fits]
        if fitted:
            write_report(folder / "least-squares", fitted, f"{session.command}; then fit", ("png", "svg"))
        for kind in ("processed", "simulated"):
            (folder / kind).mkdir()
        names = file_names([curve.name for curve, _ in session.pairs])
        for stem, (curve, posterior) in zip(names, session.pairs, strict=True):
            write_csv(folder / "processed" / f"{stem}.csv", curve)
            checks = posterior.checks
            if checks.reconstruction_time is not None and checks.reconstruction_radius is not None:
                drawn = RadiusCurve(*_distinct(checks.reconstruction_time, checks.reconstruction_radius))
                write_csv(folder / "simulated" / f"{stem}.csv", drawn)
        made = shutil.make_archive(str(session.folder / "cavirheo-result"), "zip", name)
    return Path(made)


def _distinct(time: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without samples that ten digits of a microsecond do not tell apart: a drawn point beside a frame."""
    kept = np.diff(time, prepend=-np.inf) > 1e-15
    return time[kept], radius[kept]
