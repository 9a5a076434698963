"""What is doubtful about a recording and its settings: an answer that rests on a doubt is never `ok`.

Some doubts the curve shows by itself (a scale or a rate that no bubble has). Others count only where they move the
answer: the recording is then read once more as it may have been, and the answers are compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import reason
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Verdict

if TYPE_CHECKING:
    from cavirheo.inference.experiment import Experiment

REBOUND = 3  # frames after the first collapse, from which a rebound is seen
FACTOR = 1.5  # by which a parameter must move to be doubtful: half of what one missing frame does to a soft gel


def plain(curve: RadiusCurve, medium: Medium) -> list[str]:
    """What the curve shows by itself, a sentence each."""
    warning = curve.scale_warning(medium.density, medium.pressure)
    return [*curve.doubts, *([warning] if warning else [])]


def of_walls(shot: Experiment) -> list[str]:
    """A sentence if nothing tells the viscosity of a liquid from what else lengthens a first collapse: in water it can
    pass for 0.09 Pa s (docs/real-bubbles.md). Elastic laws are left out: their G holds the answer together."""
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


def readings(curve: RadiusCurve, *, spikes: bool = True) -> Iterator[tuple[str, RadiusCurve]]:
    """(what would be different, the curve as it may have been); `spikes`: also without the frames that stand out."""
    if curve.begins_late:
        frame = float(np.median(np.diff(curve.time)))
        earlier = (curve.time_of_max - frame, curve.max_radius)
        yield "no growth is recorded, and if R_max was one frame before the first", replace(curve, maximum=earlier)
    if spikes and (wrong := curve.spikes()):
        radius = curve.radius.copy()
        radius[wrong] = np.nan
        yield (
            f"{len(wrong)} frames stand out by more than 20 % of R_max, and without them",
            replace(curve, radius=radius),
        )


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
