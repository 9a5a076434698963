"""Warnings on a recording and its settings: an answer with an input warning is never `ok`.

Some the curve shows by itself: a scale or a rate that explains it better than a material does (scale.py), or a
maximum that was missed. Frames that stand out count only where they move the answer: the recording is then read once
more without them, and the answers are compared. A maximum between two frames, or up to a frame before the first, is no
warning: the prior of the clock and of R_max holds it (experiment.py), and so does the interval.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cavirheo import landmarks
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference import scale
from cavirheo.messages import Message, of_error
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Verdict

if TYPE_CHECKING:
    from cavirheo.inference.experiment import Experiment

_log = logging.getLogger(__name__)
# what may end the answer of one curve: numbers that it, numpy or scipy refuse (InputError and LinAlgError are
# ValueErrors), simulations that fail, and a curve too large for the memory
ERRORS = ValueError, ArithmeticError, SolverError, MemoryError
REBOUND = 3  # frames after the first collapse, from which a rebound is seen
FACTOR = 1.5  # by which a parameter must move for a warning


def plain(curve: RadiusCurve, medium: Medium) -> list[Message]:
    """What the curve shows by itself."""
    messages = [*curve.warnings, *_of_frames(curve)]
    with suppress(InputError):  # no R_max: the curve is not answered
        messages += [*_of_maximum(curve), *of_scale(curve, medium)]
    return messages


def _of_frames(curve: RadiusCurve) -> list[Message]:
    """A message if frames stand several times, which flattens the curve and shifts its times; one if they stand in
    reverse."""
    radius, said = curve.radius[np.isfinite(curve.radius)], list[Message]()
    if found := landmarks.repeated(radius):
        equal, times = found
        said.append(Message("check_input.frames_repeated", {"equal": equal, "frames": len(radius), "times": times}))
    if collapses := landmarks.collapses_backwards(radius):
        said.append(Message("check_input.frames_backwards", {"collapses": collapses}))
    return said


def _of_maximum(curve: RadiusCurve) -> list[Message]:
    """A message if R_max lies further before the first frame than the clock of an answer is free."""
    missed = curve.frames_missed
    return [Message("check_input.late_start", {"frames": missed})] if missed else []


def of_scale(curve: RadiusCurve, medium: Medium) -> list[Message]:
    """A message if a wrong scale or frame rate explains the time of the first collapse, and a stiffness does not."""
    found = scale.compare(curve, medium)
    if found is None or not found.doubtful:
        return []
    factors = tuple(sorted(found.factor if found.ratio < 1.0 else (1.0 / factor for factor in found.factor)))
    seen = {"ratio": found.ratio, "max_radius": curve.max_radius}
    return [Message("check_input.scale", {**seen, "factors": () if found.wrong > scale.FOLLOWS else factors})]


def of_walls(shot: Experiment) -> list[Message]:
    """A message if nothing tells the viscosity of a liquid from what else lengthens a first collapse: in water it can
    pass for 0.09 Pa s (docs/real-bubbles.md). Elastic laws are left out: their G holds the answer together."""
    bubble, curve = shot.options.bubble, shot.curve
    if shot.family.elastic or bubble.confinement_inertia or bubble.confinement_damping or bubble.wall_distance:
        return []
    first = curve.collapse_times()[:1] - curve.time_of_max
    if len(first) and np.count_nonzero(shot.since[shot.counted] > first[0]) >= REBOUND:
        return []
    return [Message("check_input.no_rebound")]


def without_spikes(curve: RadiusCurve) -> tuple[int, RadiusCurve] | None:
    """(how many frames stand out, the curve without them), None if none does."""
    wrong = curve.spikes()
    if not wrong:
        return None
    radius = curve.radius.copy()
    radius[wrong] = np.nan
    return len(wrong), replace(curve, radius=radius)


def moved(frames: int, factors: Mapping[str, float]) -> list[Message]:
    """A message if a parameter would be another by more than FACTOR without so many frames; factors: by name, new
    value over old."""
    far = {name: float(factor) for name, factor in factors.items() if not 1.0 / FACTOR <= factor <= FACTOR}
    return [Message("check_input.spikes", {"frames": frames, "factors": far})] if far else []


def failed(error: Exception, curve: RadiusCurve, medium: Medium) -> Checks:
    """The checks of a curve whose answer an error ended; what is wrong with the input may be the cause."""
    _log.debug("%s has no answer", curve.name, exc_info=error)
    return warned(Checks("failed", (of_error(error),)), plain(curve, medium), trust_input=False)


def warned(checks: Checks, warnings: Iterable[Message], trust_input: bool) -> Checks:
    """The checks with these input warnings first, which decide the verdict unless the user vouches for the input (or
    it failed)."""
    warnings = tuple(warnings)
    keeps = trust_input or not warnings or checks.verdict == "failed"
    verdict: Verdict = checks.verdict if keeps else "check_input"
    return replace(checks, verdict=verdict, messages=(*warnings, *checks.messages))
