"""What is doubtful about a recording and its settings: an answer that rests on a doubt is never `ok`.

Some doubts the curve shows by itself: a scale or a rate that explains it better than a material does (scale.py), or a
maximum that was missed. Frames that stand out count only where they move the answer: the recording is then read once
more without them, and the answers are compared. A maximum between two frames, or up to a frame before the first, is no
doubt: the prior of the clock and of R_max holds it (experiment.py), and so does the interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cavirheo import landmarks
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, reason
from cavirheo.inference import scale
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Verdict

if TYPE_CHECKING:
    from cavirheo.inference.experiment import Experiment

REBOUND = 3  # frames after the first collapse, from which a rebound is seen
FACTOR = 1.5  # by which a parameter must move to be doubtful


def plain(curve: RadiusCurve, medium: Medium) -> list[str]:
    """What the curve shows by itself, a sentence each."""
    messages = [*curve.doubts, *_of_frames(curve)]
    with suppress(InputError):  # no R_max: the curve is not answered
        messages += [*_of_maximum(curve), *of_scale(curve, medium)]
    return messages


def _of_frames(curve: RadiusCurve) -> list[str]:
    """A sentence if frames stand several times, which flattens the curve and shifts its times; one if they stand in
    reverse."""
    radius, said = curve.radius[np.isfinite(curve.radius)], list[str]()
    if found := landmarks.repeated(radius):
        equal, times = found
        often = {2: "twice"}.get(times, f"{times} times")
        each = f"each frame seems to stand {often}: keep one of each"
        cause = each if times else "frames seem to be repeated: keep the first of equal ones"
        seen = f"{equal} of {len(radius)} radii equal the one before, also where the bubble moves fast"
        said.append(f"check the frames: {seen}; {cause}, with its time, or add --trust-input")
    if collapses := landmarks.collapses_backwards(radius):
        seen = f"{collapses} collapses come before R_max, and after each the bubble is larger than before"
        said.append(
            f"check the order of the frames: {seen}; time seems to run backwards: give the radii in reverse, or add "
            "--trust-input"
        )
    return said


def _of_maximum(curve: RadiusCurve) -> list[str]:
    """A sentence if R_max lies further before the first frame than the clock of an answer is free."""
    missed = curve.frames_missed
    message = f"check the recording: its first radii fall as they do {missed:.2g} frames after R_max"
    return [f"{message}: begin it at R_max or before, or add --trust-input"] if missed else []


def of_scale(curve: RadiusCurve, medium: Medium) -> list[str]:
    """A sentence if a wrong scale or frame rate explains the time of the first collapse, and a stiffness does not."""
    found = scale.compare(curve, medium)
    if found is None or not found.doubtful:
        return []
    fast = found.ratio < 1.0
    factors = sorted(found.factor if fast else (1.0 / factor for factor in found.factor))
    by = " to ".join(dict.fromkeys(f"{factor:.2g}" for factor in factors))
    large, short = ("large (a diameter given as radius?)", "short") if fast else ("small (a radius in pixels?)", "long")
    cause = "stiff gel with its small stretch" if fast else "material"
    seen = f"the first collapse comes {found.ratio:.2g} Rayleigh times after R_max ({curve.max_radius * 1e6:.4g} um)"
    mend = "give the true R_max (--rmax-um) or frame rate (--fps), or add --trust-input if both are right"
    if found.wrong > scale.FOLLOWS:
        return [f"check the scale of radius and time: {seen}, which no material shows: {mend}"]
    return [
        f"check the scale of radius and time: {seen}, and no {cause} follows the curve as well as a soft material does "
        f"if radii are {by} times too {large} or times that much too {short}: {mend}"
    ]


def of_walls(shot: Experiment) -> list[str]:
    """A sentence if nothing tells the viscosity of a liquid from what else lengthens a first collapse: in water it can
    pass for 0.09 Pa s (docs/real-bubbles-notes.md). Elastic laws are left out: their G holds the answer together."""
    bubble, curve = shot.options.bubble, shot.curve
    if shot.family.elastic or bubble.confinement_inertia or bubble.confinement_damping or bubble.wall_distance:
        return []
    first = curve.collapse_times()[:1] - curve.time_of_max
    if len(first) and np.count_nonzero(shot.since[shot.counted] > first[0]) >= REBOUND:
        return []
    return [
        "no rebound is counted, and walls and sound of the vessel lengthen a first collapse as a viscosity does: read "
        "the upper end of µ alone, or let them be free (--confinement-inertia free --confinement-damping free)"
    ]


def without_spikes(curve: RadiusCurve) -> tuple[str, RadiusCurve] | None:
    """(what would be different, the curve without the frames that stand out), None if none does."""
    wrong = curve.spikes()
    if not wrong:
        return None
    radius = curve.radius.copy()
    radius[wrong] = np.nan
    message = f"{len(wrong)} frames stand out by more than 20 % of R_max, and without them"
    return message, replace(curve, radius=radius)


def moved(difference: str, factors: Mapping[str, float]) -> list[str]:
    """A sentence if a parameter would be another by more than FACTOR; factors: by name, new value over old."""
    far = {name: factor for name, factor in factors.items() if not 1.0 / FACTOR <= factor <= FACTOR}
    words = " and ".join(f"{name.replace('_', ' ')} times {factor:.2g}" for name, factor in far.items())
    return [f"check the recording: {difference}, the answer would be {words}"] if far else []


def failed(error: Exception, curve: RadiusCurve, medium: Medium) -> Checks:
    """The checks of a curve whose answer an exception ended; a doubt about the input may be the cause."""
    return doubted(Checks("failed", reason(error)), plain(curve, medium), trust_input=False)


def doubted(checks: Checks, doubts: list[str], trust_input: bool) -> Checks:
    """The checks with these doubts, which decide the verdict unless the user vouches for the input (or it failed)."""
    told = "; ".join(filter(None, [*doubts, checks.message]))
    keeps = trust_input or not doubts or checks.verdict == "failed"
    verdict: Verdict = checks.verdict if keeps else "check_input"
    return replace(checks, verdict=verdict, message=told, doubts=tuple(doubts))
