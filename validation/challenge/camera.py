"""How a camera shows a bubble: frames, exposure, scale, noise, lost frames, and R_max as a laboratory reads it.

Written for the challenge alone: no line and no number is taken from the camera that a program assumes or is trained on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CAMERAS = ((5e6, 256), (2e6, 256), (2e6, 180), (1e6, 256), (1e6, 128), (5e5, 180), (3.8e5, 400), (2.7e5, 400))
LEAST = 14  # frames after R_max
LONGEST = 7.0  # t_c after R_max


@dataclass(frozen=True)
class Level:
    """Of a difficulty. Lengths in R_max, times in t_c; pairs are the ends of a range."""

    noise: tuple[float, float]  # of single frames; tails of Student's t with 5 degrees of freedom
    slow: float  # errors that last for half a t_c, in units of the noise; in half of the recordings
    scale: float  # standard deviation of the radius calibration
    exposure: tuple[float, float]  # share of the frame interval
    end: tuple[float, float]  # of the recording
    rate: tuple[float, float]  # frames per t_c
    lost: float  # share of frames without a radius
    smallest: float  # radius below which no circle is found
    troubled: bool  # half have a gap of a third of a t_c, half a frame whose circle is wrong by 10 to 30 %


LEVELS = {
    "easy": Level((0.003, 0.008), 0.0, 0.003, (0.1, 0.3), (4.0, LONGEST), (15, 60), 0.0, 0.04, False),
    "medium": Level((0.008, 0.018), 0.5, 0.005, (0.2, 0.6), (2.8, 5.0), (8, 40), 0.05, 0.08, False),
    "hard": Level((0.018, 0.035), 0.7, 0.008, (0.3, 1.0), (1.9, 3.5), (6, 20), 0.1, 0.12, True),
}


@dataclass(frozen=True)
class Recording:
    """time, radius: of the frames with a radius, s since the first frame and m. origin: true time of R_max there."""

    time: Floats
    radius: Floats
    frame_rate: float  # Hz
    exposure: float  # s
    scale: float
    noise: float  # of R_max
    origin: float


def read_maximum(time: Floats, radius: Floats) -> tuple[float, float]:
    """Time and radius at the top of the parabola through the frames about the largest one that are above 0.9 of it;
    the largest frame where they show no top."""
    peak = int(np.argmax(radius))
    first = last = peak
    while first > 0 and radius[first - 1] > 0.9 * radius[peak]:
        first -= 1
    while last + 1 < len(time) and radius[last + 1] > 0.9 * radius[peak]:
        last += 1
    if last - first >= 3:
        span = time[last] - time[first]
        t = (time[first : last + 1] - time[peak]) / span
        a, b, c = np.polyfit(t, radius[first : last + 1], 2)
        if a < 0 and t[0] <= -b / (2 * a) <= t[-1]:
            return float(time[peak] - b / (2 * a) * span), float(c - b * b / (4 * a))
    return float(time[peak]), float(radius[peak])


def film(
    rng: np.random.Generator, level: Level, ratio: Callable[[Floats], Floats], R_max: float, t_c: float
) -> Recording:
    """A Recording of R/R_max = ratio(t/t_c), known from R_max (0) to LONGEST.

    Before R_max the bubble grows as it collapses after, up to a tenth faster.
    """
    while True:
        frame_rate, most = CAMERAS[rng.integers(len(CAMERAS))]
        frame = 1.0 / (frame_rate * t_c)
        growth = 0 if rng.random() < 0.25 else int(min(rng.uniform(1, 12), 0.85 / frame))
        count = min(int(rng.uniform(*level.end) / frame), most - growth)
        if level.rate[0] <= 1.0 / frame <= level.rate[1] and count * frame > level.end[0] and count >= LEAST:
            break
    first = (rng.random() if growth == 0 else rng.random() - growth) * frame
    time = first + frame * np.arange(growth + count)
    time = time[time < LONGEST]
    exposure = rng.uniform(*level.exposure)
    instants = time[:, None] + exposure * frame * (np.arange(21) - 10.0) / 21.0
    faster = rng.uniform(1.0, 1.1)
    radius = ratio(np.minimum(np.where(instants < 0, -faster * instants, instants), LONGEST)).mean(axis=1)
    seen = radius > level.smallest
    noise = float(np.exp(rng.uniform(*np.log(level.noise))))
    slow = level.slow * (rng.random() < 0.5) * noise
    rough = np.sqrt(3 / 5) * rng.standard_t(5, len(time))  # variance 1
    lasting = np.exp(-np.abs(time[:, None] - time) / 0.5)
    drift = np.linalg.cholesky(lasting + 1e-9 * np.eye(len(time))) @ rng.standard_normal(len(time))
    radius = radius + noise * rough + slow * drift
    scale = float(1.0 + level.scale * np.clip(rng.standard_normal(), -2.5, 2.5))
    seen &= (rng.random(len(time)) > level.lost) & (radius > 0.5 * level.smallest)
    if level.troubled and rng.random() < 0.5:
        start = rng.uniform(0.5, time[-1] - 0.5)
        seen &= (time < start) | (time > start + 1 / 3)
    if level.troubled and rng.random() < 0.5:
        wrong = rng.choice(np.flatnonzero(time > 0.7))
        radius[wrong] *= 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.3)
    return Recording(
        time=(time[seen] - time[0]) * t_c,
        radius=radius[seen] * R_max / scale,
        frame_rate=frame_rate,
        exposure=exposure * frame * t_c,
        scale=scale,
        noise=noise,
        origin=-first * t_c,
    )
