"""What the buttons do: the functions of the command line, called for one visitor."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import fields
from html import escape
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.app import words
from cavirheo.app.session import Session, Settings
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference import infer_many
from cavirheo.inference.fit import fit_many
from cavirheo.inference.model import load
from cavirheo.inference.reconstruct import Window, reconstruct, window
from cavirheo.physics.materials import MATERIALS
from cavirheo.posterior import Posterior
from cavirheo.reporting import html
from cavirheo.reporting.record import curve_record

EXAMPLES = Path(__file__).parent / "examples"
SLIDERS = ("shear_modulus", "viscosity", "stretch")
_FACTOR = {"shear_modulus": 1e-3, "viscosity": 1.0, "stretch": 1.0}  # kPa, Pa s, 1
_CHANGED = "files or settings were changed while it ran: its answers are dropped; run it again"

Report = Callable[[float, str], Any]


def examples() -> dict[str, Path]:
    """The shipped measurements by their names."""
    return {path.name: path for path in sorted(EXAMPLES.glob("*gel.*"))}


def network_grid(curve: RadiusCurve, settings: Settings) -> tuple[float, np.ndarray]:
    """(step s, (frames,) radius m) as the model reads the curve, NaN after its end. Raises InputError."""
    problem = load(settings.model).problem
    step = problem.grid_step(curve.max_radius, settings.liquid)
    return step, curve.resampled(step, problem.grid.frames, allow_short=True)


def compared(curve: RadiusCurve, settings: Settings) -> Window:
    """The part of the curve over which an answer of the model is compared. Raises InputError."""
    step, grid = network_grid(curve, settings)
    return window(curve, collapses=settings.window, end=step * (len(grid) - 1))


def infer(session: Session, names: Sequence[str], progress: Report) -> None:
    """Answers of the chosen shots into the session; a stop leaves out those that are not done.

    Raises:
        InputError: nothing loaded or chosen, too much, stopped before the first shot, a setting out of its domain, or
            other files or settings than when it began.
    """
    with session.lock:
        settings, curves, files = session.settings, session.curves, " ".join(path.name for path in session.files)
    chosen = [curve for curve in curves if curve.name in set(names)]
    if not chosen:
        raise InputError("no shots: load a file in step 1, and choose shots in step 2")
    if settings.verify == "full" and len(chosen) > session.limits.full:
        raise InputError(
            f"full uncertainty for {len(chosen)} shots; the page takes at most {session.limits.full} at once: choose "
            "fewer in step 2, or use the command line (cavirheo infer --verify full)"
        )
    liquid, stretch = settings.liquid, settings.stretch
    cores = max((os.cpu_count() or 1) // len(chosen), 1)

    def one(curve: RadiusCurve) -> Posterior:
        found = infer_many(
            [curve], model=settings.model, medium=liquid, stretch=stretch, window=settings.window, workers=1
        )
        if settings.verify != "none":
            from cavirheo.inference.verify import verify_many

            level: Any = settings.verify
            found = verify_many([curve], found, level=level, medium=liquid, stretch=stretch, workers=cores)
        return found[0]

    found = each(session, one, chosen, progress)
    pairs = [(curve, answer) for curve, answer in zip(chosen, found, strict=True) if answer]
    left = [curve.name for curve, answer in zip(chosen, found, strict=True) if not answer]
    part = "" if len(pairs) == len(curves) else f" ({len(pairs)} of {len(curves)} shots)"
    with session.lock:
        if session.curves is not curves or session.settings != settings:
            raise InputError(_CHANGED)
        session.answer(pairs, left, f"cavirheo infer {files}{settings.words}{part}")


def each(
    session: Session, work: Callable[[RadiusCurve], Posterior], curves: Sequence[RadiusCurve], progress: Report
) -> list[Posterior | None]:
    """`work` done on every curve on all cores, in their order; None for those that were not done when it was stopped.

    Raises:
        InputError: stopped before the first was done, or another run of this session goes on.
    """
    if not session.busy.acquire(blocking=False):
        raise InputError("the run before goes on: stop it, or wait for its end")
    try:
        wait(session.abandoned)  # one who stops and starts in turns takes no more cores than others
        pool = ThreadPoolExecutor(os.cpu_count())
        tasks = [pool.submit(work, curve) for curve in curves]
        left = set(tasks)
        progress(0.0, f"0 of {len(tasks)} shots")
        while left and not session.stopped.is_set():
            done, left = wait(left, timeout=0.1, return_when=FIRST_COMPLETED)
            if done:
                progress(1 - len(left) / len(tasks), f"{len(tasks) - len(left)} of {len(tasks)} shots")
        pool.shutdown(wait=False, cancel_futures=True)
        session.abandoned = {task for task in left if not task.cancelled()}
    finally:
        session.busy.release()
    if len(left) == len(tasks):
        raise InputError("stopped before a shot was done: nothing has changed")
    return [None if task in left else task.result() for task in tasks]


def answers(session: Session) -> str:
    """The table of the answers: groups, curves, and what is said of them."""
    if session.result is None:
        return words.NOTHING.format("No answers yet: press the button above.")
    factor, unit = session.result.modulus_unit
    said: dict[str, list[str]] = {}
    for record in session.result.curves:
        if record.message:
            said.setdefault(record.message, []).append(record.name)
    return words.report(
        words.stopped(len(session.pairs), session.not_run),
        html.groups_table(session.result.groups, factor, unit),
        html.curves_table(session.result.curves, factor, unit, title="Shots", linked=False),
        words.messages(said),
    )


def pair(session: Session, name: str | None) -> tuple[RadiusCurve, Posterior]:
    """The answered curve of this name. Raises InputError."""
    for curve, posterior in session.pairs:
        if curve.name == name:
            return curve, posterior
    raise InputError("no answer to check: infer first (step 3)")


def fit(session: Session, name: str | None, progress: Report) -> None:
    """The conventional fit of one answered curve, with the same medium, window and stretch. Raises InputError."""
    with session.lock:
        (curve, posterior), settings = pair(session, name), session.settings

    def one(curve: RadiusCurve) -> Posterior:
        options: dict[str, Any] = {"window": settings.window, "stretch": settings.stretch}
        return fit_many([curve], posterior.material, medium=settings.liquid, **options)[0]

    (found,) = each(session, one, [curve], progress)
    with session.lock:
        if found is None or not any(kept is posterior for _, kept in session.pairs):
            raise InputError(_CHANGED)
        session.fits[curve.name] = found


def beside(session: Session, name: str) -> str:
    """The answer, and the conventional fit if there is one, as rows of one table; then all facts of the answer."""
    curve, posterior = pair(session, name)
    found = [("answer", posterior), *([("least squares", session.fits[name])] if name in session.fits else [])]
    records = [curve_record(curve, one).model_copy(update={"name": what}) for what, one in found]
    factor, unit = session.result.modulus_unit  # type: ignore[union-attr]
    table = html.curves_table(records, factor, unit, title="Answer and conventional fit", linked=False)
    failed = {one.checks.message: [what] for what, one in found[1:] if one.checks.verdict == "failed"}
    article = html.article(0, curve_record(curve, posterior), factor, unit, "")
    return words.report(table if len(found) > 1 else "", words.messages(failed), article)


def sliders(session: Session, name: str) -> dict[str, dict[str, float] | None]:
    """Where the sliders start and end, in kPa, Pa s and 1; None for a parameter that the law does not have.

    They start at the answer, or where there is none in the middle of the trained range.
    """
    _, posterior = pair(session, name)
    prior = load(session.settings.model).problem.prior
    middle = dict(zip(prior.names, (prior.low + prior.high) / 2, strict=True))
    found: dict[str, dict[str, float] | None] = {}
    for key in SLIDERS:
        value = posterior.median(key)
        if key == "stretch" and value is None:
            value = posterior.provenance.get("stretch")
        if value is None and key not in middle and f"log10_{key}" not in middle:
            found[key] = None
            continue
        if value is None:
            value = middle[key] if key in middle else 10.0 ** middle[f"log10_{key}"]
        value = float(f"{value * _FACTOR[key]:.4g}")
        if key == "stretch":
            found[key] = {"minimum": 1.2, "maximum": 20.0, "step": 0.05, "value": value}
        else:
            top = 3.0 * max(value, 1e-6)
            unit = 10.0 ** floor(log10(top))
            top = float(f"{unit * next(n for n in (1.5, 2, 3, 4, 5, 6, 8, 10) if n * unit >= top):.3g}")
            found[key] = {"minimum": top / 500, "maximum": top, "step": top / 500, "value": value}
    return found


def trial(session: Session, name: str, values: Sequence[float | None]) -> tuple[str, dict[str, Any]]:
    """The simulation with the sliders' values over the window of the answer: (differences, {x, y} of what to draw).

    Drawn are the radius in µm and the residual in % of R_max, over µs. A simulation that fails gives the reason and
    nothing to draw.
    """
    try:
        curve, posterior = pair(session, name)
        given = {key: float(v) / _FACTOR[key] for key, v in zip(SLIDERS, values, strict=True) if v is not None}
        law = MATERIALS[posterior.material]
        material = law(**{f.name: given.get(f.name, posterior.median(f.name)) for f in fields(law)})
        seen = posterior.checks.compared_time
        end = None if seen is None else float(seen[-1]) - curve.time_of_max
        view = window(curve, end=end) if end else compared(curve, session.settings)
        found = reconstruct(view, material, session.settings.liquid, given["stretch"])
    except (InputError, SolverError) as error:
        text = f'<p class="message failed-message" role="alert">The simulation failed: {escape(str(error))}</p>'
        return words.report(text), {"x": [[], []], "y": [[], []]}
    checks = found.checks(view, session.settings.liquid.time_scale(curve.max_radius), "ok", [])
    start = curve.time_of_max
    return words.report(f'<p class="trial">Sliders: {words.differences(checks)}</p>'), {
        "x": [_short(1e6 * (found.drawn_time - start)), _short(1e6 * (found.time - start))],
        "y": [_short(1e6 * found.drawn_radius), _short(100 * found.residual)],
    }


def _short(values: np.ndarray) -> list[float]:
    """For the wire: five digits are finer than any screen."""
    return [float(f"{value:.5g}") for value in values]
