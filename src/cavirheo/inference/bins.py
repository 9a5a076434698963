"""A recording as a posterior network reads it: 192 bins of t* = t/t_c from R_max to t* 6, whatever the camera.

Frame counts, gaps and rates need no resampling: a bin knows the frames in it by their mean radius, mean time, count,
scatter, and how radius and time go together; an empty one between frames is passed by a straight line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats

BINS = 192
END = 6.0  # t* at the end of the last bin
CHANNELS = 7
SCALARS = 9
SIZE = BINS * CHANNELS + SCALARS  # of the input
CLOCK, WIDTH = 0.02, 0.015  # half-widths of the priors of clock (t_c) and R_max where frame and noise are smaller
SCALE = 0.005  # standard deviation of the radius scale


def half_widths(frame: Floats, noise: Floats, late: Floats) -> tuple[Floats, Floats]:
    """Half-widths of the priors of the clock (in t_c) and of the factor of R_max.

    frame: frame interval in t_c. noise: of the radius, over R_max. late: 1 where no growth is recorded, so that R_max
    may lie up to a frame from the first one (half a frame otherwise), where the radius is smaller by about
    (frame/t_c)^2/2.
    """
    read = np.minimum(2.25 * noise + late * frame**2, 0.2)
    return np.maximum(0.5 * (1.0 + late) * frame, CLOCK), np.maximum(WIDTH, read)


def binned(
    sample: NDArray[np.int64],
    time: Floats,
    radius: Floats,
    *,
    max_radius: Floats,
    frame: Floats,
    exposure: Floats,
    noise: Floats,
    discrepancy: Floats,
    late: Floats,
) -> NDArray[np.float32]:
    """(m, SIZE) inputs of m recordings.

    sample: (n,) to which of them a frame belongs. time: (n,) t* after R_max, from 0, ascending in each recording.
    radius: (n,) R/R_max. Of each recording, (m,): max_radius in m, frame interval and exposure in t_c, noise from frame
    to frame over R_max, discrepancy (1 where more than white noise lies between frames and simulation) and late (1
    where no growth is recorded).
    """
    m = len(max_radius)
    place = np.minimum(time * (BINS / END), BINS - 1e-9)
    inside = (time >= 0) & (time <= END)
    sample, place, radius = sample[inside], place[inside], radius[inside]
    bin_number = place.astype(np.int64)
    offset = (place - bin_number - 0.5).astype(float)
    at = sample * BINS + bin_number

    def summed(values: Floats | None = None) -> Floats:
        return np.bincount(at, values, m * BINS).reshape(m, BINS).astype(float)

    count = summed()
    filled = count > 0
    several = np.maximum(count, 1.0)
    mean, middle = summed(radius) / several, summed(np.asarray(offset)) / several
    together = np.where(count > 1, summed(radius * offset) / several - mean * middle, 0.0)
    spread = np.sqrt(np.maximum(summed(radius**2) / several - mean**2, 0.0))
    index = np.arange(BINS)
    before = np.maximum.accumulate(np.where(filled, index, -1), axis=1)
    after = np.minimum.accumulate(np.where(filled, index, BINS)[:, ::-1], axis=1)[:, ::-1]
    within = (before >= 0) & (after < BINS)
    rows = np.arange(m)[:, None]
    a, b = np.clip(before, 0, BINS - 1), np.clip(after, 0, BINS - 1)
    start, stop = a + 0.5 + middle[rows, a], b + 0.5 + middle[rows, b]
    share = np.clip((index + 0.5 - start) / np.maximum(stop - start, 1e-9), 0.0, 1.0)
    line = np.where(filled, mean, (1.0 - share) * mean[rows, a] + share * mean[rows, b])
    channels = [np.where(within, 2.0 * line - 1.0, 0.0), middle, 1.0 * filled, 1.0 * within]
    channels += [np.log1p(count), 20.0 * together, 10.0 * spread]
    frames = np.bincount(sample, minlength=m)
    end = np.zeros(m)
    np.maximum.at(end, sample, place * (END / BINS))
    scalars = [np.log(max_radius / 1.3e-4), np.log(frame / 0.04), exposure / frame]
    scalars += [0.7 * np.log(np.maximum(noise, 3e-4) / 0.01), 2.0 * discrepancy - 1.0, 0.5 * (end - 4.0)]
    scalars += [np.log(np.maximum(frames, 1) / 100.0), 1.0 * (noise < 1e-3), late]
    flat = np.stack(channels, axis=1).reshape(m, BINS * CHANNELS)
    return np.concatenate([flat, np.column_stack(scalars)], axis=1, dtype=np.float32, casting="same_kind")
