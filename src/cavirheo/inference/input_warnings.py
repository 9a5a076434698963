"""Input warnings: doubts about a recording or its settings, with which an answer is never `ok`.

A maximum between two frames, or up to one frame before the first, gives no warning, because the priors of the clock and
of R_max allow for it (experiment.py), and so does the interval.

*Scale and rate.* The first collapse in a gel with the shear modulus G comes sqrt(1 + Be G/p) times earlier than in a
liquid. It also comes earlier in a soft material whose radii were given too large, or whose times too short. The stretch
R_max/R_0 distinguishes these: that of soft gels is 5 to 10, in open recordings it is about 7 at 28 kPa and 4 at 115
kPa, and that of stiffer gels is smaller, where the bubble oscillates about a level not far below R_max. If the first
collapse comes at a time that liquids and soft gels do not show, the curve is therefore compared with coarse simulations
of gels with their usual stretch on the stated clock, and with those of soft materials on any clock. Times are in units
of the first collapse time, so that the same simulations serve all curves.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import chain, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cavirheo import landmarks
from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve, rate_warnings
from cavirheo.errors import InputError
from cavirheo.landmarks import RAYLEIGH
from cavirheo.messages import Message
from cavirheo.parameters import LOG10
from cavirheo.physics.accuracy import COARSE
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.collapse import elastic_number
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Checks, Posterior, Verdict, weighted_quantile

if TYPE_CHECKING:
    from cavirheo.inference.experiment import Experiment

REBOUND_FRAMES = 3  # fewest frames after the first collapse that show a rebound
USUAL_COLLAPSE = (0.7, 1.4)  # first collapse of liquids and gels below 50 kPa, Rayleigh times after R_max
# largest stretch of gels: 3.4 for G above 400 kPa, else 3.4 (400 kPa/G)^0.25
STIFF_MODULUS, STIFF_STRETCH, STIFF_FALL = 4e5, 3.4, 0.25
WRONG_SCALE = 0.22  # natural logarithm of the factor of the clock above which a scale or rate is wrong
EXPLAINED_MISFIT = 0.045  # largest RMS misfit over R_max of a simulation that explains a curve
BETTER_FACTOR = 1.2  # factor between misfits above which one explanation is clearly better
PERIODS = 6.0  # length of the comparison, first collapse times
SMOOTHED_FRAMES = (3, 5, 7, 9)  # frames over which radii may be smoothed
SMOOTHED_SHARE = 0.85  # share of the residual's power that smoothing leaves unexplained, below which there is a warning
SMOOTHED_SIZE = (0.6, 2.0)  # of what smoothing explains, over what it should
FELT_INERTIA = 0.05  # least lower end of the interval of the inertia of walls that tells of one
# of a stated stretch, and of its standard deviation: a stretch so far from the late plateau contradicts it
CONTRADICTION, CONTRADICTION_SIGMAS = 0.4, 4.0

_RADIUS = 150e-6  # m, R_max of the simulations
_GRID = np.linspace(0.0, 1.1 * PERIODS, 661)  # times of the simulations over that of the first collapse
_FACTORS = np.exp(np.linspace(-0.06, 0.06, 9))  # factors of the time of the first collapse, which is known to a frame
_SHIFTS = np.array([-0.7, 0.0, 0.7])  # shifts of the time of R_max within its uncertainty, frames
_MODULUS_STEP = 0.16  # natural logarithm of the clock's factor between two moduli of the simulations
_VISCOUS = (0.004, 0.015, 0.05, 0.13, 0.35)  # viscosities of the simulations, Pa s
_BUBBLES: dict[str, list[Any]] = {  # all combinations of G (Pa), mu (Pa s), stretch and confinement damping
    "soft": [((1e3, 1.2e4, 4e4), _VISCOUS, (4.0, 4.5, 5.2, 6.2, 7.5, 9.0, 11.0), (0.1,))],
    "fast": [
        ((7.5e4, 1.3e5, 2.3e5), _VISCOUS, (1.3, 1.7, 2.1, 2.5, 2.9, 3.5, 4.2, 5.0), (0.1,)),
        ((4e5, 6.9e5, 1.2e6, 2.1e6, 3.6e6), _VISCOUS, (1.3, 1.7, 2.1, 2.5, 2.9, STIFF_STRETCH), (0.1,)),
    ],
    "slow": [
        ((1e3, 1.2e4, 4e4), _VISCOUS, (1.4, 2.0, 2.8), (0.1,)),
        ((1e3, 1.5e4), (0.02, 0.08), (2.8, 4.0, 5.2, 7.5, 11.0), (0.5, 1.0)),
    ],
}


def curve_warnings(curve: RadiusCurve, medium: Medium) -> list[Message]:
    """Warnings that need the curve alone: another frame rate, repeated frames, an R_max that lies further before the
    first frame than the clock of an answer can reach, a wrong scale."""
    radius = curve.radius[np.isfinite(curve.radius)]
    messages = [*curve.warnings, *rate_warnings(curve, curve.frame_rate)]
    if repeats := landmarks.repeated_samples(radius):
        equal, times = repeats
        messages.append(Message("check_input.frames_repeated", {"equal": equal, "frames": len(radius), "times": times}))
    with suppress(InputError):  # no R_max: the curve is not answered
        if missed := curve.frames_missed:
            messages.append(Message("check_input.late_start", {"frames": missed}))
        messages += scale_warnings(curve, medium)
    return messages


def answer_warnings(shot: Experiment, found: Posterior) -> list[Message]:
    """Warnings that need the answer."""
    of_walls = [*wall_warnings(shot), *felt_wall_warnings(shot, found)]
    return [*of_walls, *stretch_warnings(shot), *smoothing_warnings(found.checks), *stiffness_warnings(found)]


def felt_wall_warnings(shot: Experiment, found: Posterior) -> list[Message]:
    """A message if the answer needs a wall closer than vessels have."""
    ends = found.interval("confinement_inertia") if "confinement_inertia" in found.parameters else None
    if not ends or ends[0] <= FELT_INERTIA:
        return []
    inertia = float(weighted_quantile(found.draws("confinement_inertia"), 0.5, found.log_weight))
    return [Message("check_input.walls", {"distance": 0.5 * shot.max_radius / inertia})]


def wall_warnings(shot: Experiment) -> list[Message]:
    """A message if the model has no walls and no counted rebound distinguishes them from the viscosity of a liquid,
    which also lengthens the first collapse (docs/real-bubbles.md). Laws with an elastic part need none."""
    bubble, curve = shot.options.bubble, shot.curve
    if shot.family.elastic or bubble.confinement_inertia or bubble.confinement_damping or bubble.wall_distance:
        return []
    first = curve.collapse_times()[:1] - curve.time_of_max
    if len(first) and np.count_nonzero(shot.time_since_max[shot.counted] > first[0]) >= REBOUND_FRAMES:
        return []
    return [Message("check_input.no_rebound")]


def stretch_warnings(shot: Experiment) -> list[Message]:
    """A message if a stretch that the file or the user states contradicts the late plateau."""
    curve, plateau = shot.curve, shot.curve.stretch_from_tail()
    stated = shot.stretch or (shot.stretch_prior and not shot.options.stretch and curve.stretch)
    if not stated or not plateau:
        return []
    deviation = 0.0 if shot.stretch else curve.stretch_std or 0.0
    if abs(plateau[0] - stated) <= max(CONTRADICTION * stated, CONTRADICTION_SIGMAS * deviation):
        return []
    return [Message("check_input.stretch", {"stretch": stated, "plateau": plateau[0]})]


def stiffness_warnings(found: Posterior) -> list[Message]:
    """A message if G is at the upper end of its range, where no material is in which a bubble can be made."""
    if "shear_modulus" not in found.parameters or found.bound("shear_modulus") != "lower":
        return []
    return [Message("check_input.stiffness", {"limit_MPa": 1e-6 * 10.0 ** found.prior[LOG10 + "shear_modulus"][1]})]


def smoothing_warnings(checks: Checks) -> list[Message]:
    """A message if the radii seem to be smoothed: the measurement differs from the simulation as the smoothed
    simulation does, by a running mean or a parabola through neighbouring frames (Savitzky and Golay 1964,
    doi:10.1021/ac60214a047)."""
    time, line, radius = checks.compared_time, checks.reconstruction_time, checks.reconstruction_radius
    residual = checks.residual_over_rmax
    if time is None or line is None or radius is None or residual is None or len(time) <= max(SMOOTHED_FRAMES):
        return []
    simulated = np.interp(time, line, radius) / np.max(radius)
    best = (SMOOTHED_SHARE, 0)
    for frames, degree in product(SMOOTHED_FRAMES, (1, 2)):
        change = _smoothed(simulated, frames, degree) - simulated
        if not np.any(change):
            continue
        size = float(change @ residual / (change @ change))
        left = float(np.sum((residual - size * change) ** 2) / np.sum(residual**2))
        if SMOOTHED_SIZE[0] < size < SMOOTHED_SIZE[1]:
            best = min(best, (left, frames))
    return [Message("check_input.smoothed", {"frames": best[1]})] if best[1] else []


def _smoothed(values: Floats, frames: int, degree: int) -> Floats:
    """(n,) values after a least-squares polynomial through each one and its neighbours, `frames` of them."""
    half = frames // 2
    weights = np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), degree + 1, increasing=True))[0]
    return np.convolve(np.pad(values, half, mode="reflect"), weights[::-1], mode="valid")


def warned(checks: Checks, warnings: Iterable[Message], trust_input: bool) -> Checks:
    """The checks with these input warnings first. The verdict becomes "check_input", unless the user vouches for the
    input or the answer failed."""
    warnings = tuple(warnings)
    keeps = trust_input or not warnings or checks.verdict == "failed"
    verdict: Verdict = checks.verdict if keeps else "check_input"
    return replace(checks, verdict=verdict, messages=(*warnings, *checks.messages))


class Shapes(NamedTuple):
    """Simulated bubbles: G in Pa, stretch and t_1/t_c, each (k,), and R/R_max at _GRID times t_1, (k, n)."""

    modulus: Floats
    stretch: Floats
    first: Floats
    radius: Floats


@cache
def shapes(kind: str) -> Shapes:
    """Simulated bubbles of 150 um in water-like media (half a second); others differ by surface tension and heat."""
    rows = []
    for modulus, viscosity, stretch, damping in chain.from_iterable(product(*ways) for ways in _BUBBLES[kind]):
        early = RAYLEIGH / np.sqrt(1.0 + elastic_number(stretch) * modulus / WATER.pressure)
        time = early * np.linspace(0.0, 1.6 * PERIODS, 1001)
        run = simulate(
            NeoHookeanKelvinVoigt(modulus, viscosity),
            max_radius=_RADIUS,
            stretch=stretch,
            time=time * WATER.time_scale(_RADIUS),
            bubble=Bubble("kinetic", accommodation=0.1, confinement_damping=damping),
            accuracy=COARSE,
            throw=False,
        )
        rises = np.diff(run.radius) > 0
        if run.ok and rises.any():
            first = time[np.argmax(rises)]
            rows.append((modulus, stretch, first, np.interp(_GRID * first, time, run.radius / _RADIUS)))
    return Shapes(*(np.array(values) for values in zip(*rows, strict=True)))


def scale_warnings(curve: RadiusCurve, medium: Medium) -> list[Message]:
    """A message if the first collapse comes at an unusual time, and another scale or frame rate explains the curve
    clearly better than any material, or no material has such a collapse. It holds the smallest and the largest factor
    by which radii are too large, or times too short."""
    ratio = curve.rayleigh_ratio(medium.density, medium.pressure)
    if ratio is None or USUAL_COLLAPSE[0] <= ratio <= USUAL_COLLAPSE[1]:
        return []
    soft, hard = shapes("soft"), shapes("fast" if ratio < 1.0 else "slow")
    both = Shapes(*(np.concatenate(pair) for pair in zip(soft, hard, strict=True)))
    clock = both.first / (ratio * RAYLEIGH)  # above 1 the material is stiffer than simulated, or the scale too large
    elastic, p = elastic_number(both.stretch), medium.pressure
    modulus = np.maximum(((1.0 + elastic * both.modulus / p) * clock**2 - 1.0) * p / elastic, 1.0)
    time, radius = curve.normalised(medium)
    time = time / (ratio * RAYLEIGH)
    frame = float(np.median(np.diff(time)))  # uncertainty of the times of maximum and collapse
    reached = np.abs(np.log(clock)) < _MODULUS_STEP + frame
    right = reached & (both.stretch <= 1.001 * (STIFF_STRETCH * np.maximum(1.0, STIFF_MODULUS / modulus) ** STIFF_FALL))
    wrong = (np.arange(len(clock)) < len(soft.first)) & (np.abs(np.log(clock)) > WRONG_SCALE)
    counted = (time >= 0.0) & (time < PERIODS)
    missed = _misfits(both.radius, time[counted], radius[counted], frame * _SHIFTS)
    at_stated, at_another = float(np.min(missed[right], initial=np.inf)), float(np.min(missed[wrong]))
    if reached.any() and not (at_another < EXPLAINED_MISFIT and at_stated > BETTER_FACTOR * at_another):
        return []
    alike = clock[wrong & (missed <= BETTER_FACTOR * at_another)]
    low, high = float(np.min(alike)), float(np.max(alike))
    factors = (low, high) if ratio < 1.0 else (1.0 / high, 1.0 / low)
    numbers = {"ratio": ratio, "max_radius": curve.max_radius}
    return [Message("check_input.scale", {**numbers, "factors": () if at_another > EXPLAINED_MISFIT else factors})]


def _misfits(shapes: Floats, time: Floats, radius: Floats, shifts: Floats) -> Floats:
    """Smallest RMS difference (k,) of simulations (k, n) from frames (m,), over small changes of the clock."""
    best = np.full(len(shapes), np.inf)
    for factor, shift in product(_FACTORS, shifts):
        at = np.clip(np.abs(time * factor + shift) / _GRID[1], 0.0, len(_GRID) - 1.001)
        low = at.astype(int)
        share = at - low
        simulated = shapes[:, low] * (1.0 - share) + shapes[:, low + 1] * share
        best = np.minimum(best, np.sqrt(np.mean((simulated - radius) ** 2, axis=1)))
    return best
