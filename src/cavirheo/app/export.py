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
from cavirheo.writing.document import LIST

_PICTURES = ("png", "svg")


def write_zip(session: Session) -> Path:
    """cavirheo-result.zip in the visitor's folder (docs/how-to/app.md, step 5). Raises InputError: no answer yet."""
    if (answers := session.answers) is None:
        raise InputError("nothing to export: infer first (step 3)", "app.no_answer")
    with TemporaryDirectory(dir=session.folder) as name:
        folder, command = Path(name) / "cavirheo-result", answers.document.command
        document = write_report(folder, answers.pairs, command, _PICTURES)
        if fitted := [(curve, answers.fits[curve.name]) for curve, _ in answers.pairs if curve.name in answers.fits]:
            write_report(folder / "least-squares", fitted, f"{command}; then fit", _PICTURES)
        for place in (folder, folder / "least-squares"):
            (place / LIST).unlink(missing_ok=True)  # it tells one run from the next; a zip is of one
        for kind in ("processed", "simulated"):
            (folder / kind).mkdir()
        names = file_names([record.name for record in document.curves])
        for stem, (curve, posterior) in zip(names, answers.pairs, strict=True):
            write_csv(folder / "processed" / f"{stem}.csv", curve)
            time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
            if time is not None and radius is not None:
                # a drawn point beside a frame, which ten digits of a microsecond do not tell from it
                kept = np.diff(time, prepend=-np.inf) > 1e-15
                write_csv(folder / "simulated" / f"{stem}.csv", RadiusCurve(time[kept], radius[kept]))
        return Path(shutil.make_archive(str(session.folder / "cavirheo-result"), "zip", name))
