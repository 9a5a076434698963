"""Simulated recordings of gels whose times are measured: the field's bubble, 100 frames at 1 MHz, 1 % noise."""

from __future__ import annotations

import numpy as np

from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, SolverError, simulate
from cavirheo.prior import uniforms

STREAM = 77  # of the random numbers
FRAME, FRAMES, NOISE = 1e-6, 100, 0.01  # s, -, R_max
RANGES = ((1e3, 1e5), (0.01, 0.3), (4.0, 10.0), (1e-4, 4e-4))  # G Pa, mu Pa s, stretch, R_max m


def recording(number: int) -> RadiusCurve | None:
    """None where the bubble shows no collapse or cannot be simulated: take another number."""
    draw = uniforms(0, number, 12, STREAM)
    G, mu, stretch, radius = (low * (high / low) ** u for (low, high), u in zip(RANGES, draw, strict=False))
    time = FRAME * np.arange(FRAMES)
    seen_at = np.maximum(time + FRAME * (draw[7] - 0.5), 0.0)
    try:
        run = simulate(NeoHookeanKelvinVoigt(G, mu), max_radius=radius, stretch=stretch, time=np.sort(seen_at))
    except SolverError:
        return None
    seen = run.radius + NOISE * radius * np.random.default_rng([STREAM, number]).standard_normal(FRAMES)
    seen[seen < 0.02 * radius] = np.nan
    curve = RadiusCurve(time, seen, meta={"name": f"calibration{number}"})
    return curve if not curve.unusable and len(curve.collapse_times()) else None
