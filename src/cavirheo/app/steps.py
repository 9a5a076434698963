"""What the buttons do: the functions of the command line, called for one visitor."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from cavirheo.app.session import Answers, Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.what_if import checks_with, slider
from cavirheo.io import write_csv
from cavirheo.parallel import Threads, cores, run_on_any_core
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting import group_pictures, result, write_report
from cavirheo.reporting.documents import curve_record
from cavirheo.workflow import with_source_of
from cavirheo.writing import digits
from cavirheo.writing.document import LIST_FILE, short_name

SLIDERS = {  # label, factor from SI
    "shear_modulus": ("Try G (kPa)", 1e-3),
    "viscosity": ("Try µ (Pa s)", 1.0),
    "stretch": ("Try λ (R_max/R_0)", 1.0),
}
EXAMPLE_CAMERA = {"fps": 500_000.0, "um_per_px": 4.0, "exposure_us": 0.4}  # of the shipped recording


def examples() -> dict[str, Path]:
    """The shipped measurements by their names."""
    folder = Path(__file__).parent / "examples"
    return {path.name: path for kind in ("*gel.*", "*.mp4") for path in sorted(folder.glob(kind))}


def infer(session: Session, names: Sequence[str]) -> Answers:
    """Return the answers of the chosen shots, and keep them in the session; after a stop no further shot is waited
    for. Raises InputError: no shots, another run goes on, or files or settings changed during the run."""
    with session.lock:
        settings, curves = session.settings, session.curves
        chosen = [curve for curve in curves if curve.name in names]
        require(bool(chosen), "no shots: load a file in step 1, and choose shots in step 2", "app.no_shots")
        run = session.start(names)
    workers = max(cores() // len(chosen), 1)

    def answer_one(curve: RadiusCurve) -> tuple[RadiusCurve, Posterior]:
        key = settings.analysis.key(curve)
        answer = session.shared.get(key)  # visitors with one file share one answer
        if answer is None:
            answer = run_on_any_core(partial(settings.analysis.answer, curve, workers=workers))
        session.kept[key] = session.shared[key] = answer
        pair = curve, with_source_of(answer, curve)
        return pair

    answered = dict[int, tuple[RadiusCurve, Posterior]]()
    try:
        with closing(Threads().map_unordered(answer_one, chosen)) as flow:
            for index, pair in flow:
                answered[index] = pair
                run.records[pair[0].name] = curve_record(*pair)
                if run.stopped.is_set():
                    break
        pairs = [answered[index] for index in sorted(answered)]
        names_answered = [curve.name for curve, _ in pairs]
        pooled = _pool_answers(session, pairs, [name for name in names if name not in names_answered])
    finally:
        with session.lock:
            session.run = None if session.run is run else session.run
    with session.lock:
        if session.curves is not curves or session.settings != settings:
            changed = "files or settings were changed while it ran: its answers are dropped; run it again"
            raise InputError(changed, "app.changed")
        session.answers = pooled
        return pooled


def _pool_answers(session: Session, pairs: list[tuple[RadiusCurve, Posterior]], not_run: list[str]) -> Answers:
    """Return the answers with their document: groups, command and notes."""
    command = session.command
    if len(pairs) < len(session.curves):
        command += f" ({len(pairs)} of {len(session.curves)} shots)"
    document = result(pairs, command)
    return Answers(pairs, document, not_run, group_pictures(pairs, document, []))


def sliders(session: Session, name: str) -> dict[str, dict[str, float] | None]:
    """Return the limits, step and start of each slider, in kPa, Pa s and 1; None for a parameter that the law lacks."""
    posterior = session.find_answer(name)[2]
    return {key: slider(posterior, key, factor) for key, (_, factor) in SLIDERS.items()}


def what_if(session: Session, name: str, values: Sequence[float | None]) -> Checks:
    """The checks of the answer with the sliders' values, which are kept beside the answer; failed ones hold the
    reason."""
    answers, curve, posterior, _ = session.find_answer(name)
    changed = {key: v / SLIDERS[key][1] for key, v in zip(SLIDERS, values, strict=True) if v is not None}
    answers.trials[name] = checks_with(curve, posterior, changed, session.settings.analysis)
    return answers.trials[name]


def export(session: Session) -> Path:
    """Return the path of the zip. Raises InputError: no current answers."""
    answers, base = session.current, session.folder / "export"
    folder, document = base / "cavirheo-result", answers.document
    shutil.rmtree(base, ignore_errors=True)
    for kind in ("processed", "simulated"):
        (folder / kind).mkdir(parents=True)
    write_report(folder, answers.pairs, document.model_copy(update={"notes": [*document.notes]}))
    for listing in folder.rglob(LIST_FILE):  # the list of files by run, which one run does not need
        listing.unlink()
    _write_curves(folder, answers)
    return Path(shutil.make_archive(str(session.folder / folder.name), "zip", base, folder.name))


def _write_curves(folder: Path, answers: Answers) -> None:
    """Write the processed and the simulated curves as CSV."""
    for number, (record, (curve, posterior)) in enumerate(zip(answers.document.curves, answers.pairs, strict=True), 1):
        safe_name = re.sub(r"[^\w.+-]+", "_", record.name).strip("_.")
        stem = short_name(f"{number:03}_{safe_name}")
        write_csv(folder / "processed" / f"{stem}.csv", curve)
        time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
        if time is not None and radius is not None:
            # leave out points so close to a frame that their times are equal in the digits of the CSV
            distinct = np.diff(time, prepend=-np.inf) > 1e-15
            place = folder / "simulated" / f"{stem}-{digits.simulation_name(posterior.method).replace(' ', '-')}.csv"
            write_csv(place, RadiusCurve(time[distinct], radius[distinct]), f"simulation of {record.name}")
