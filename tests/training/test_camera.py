"""The camera that films simulated curves for the training of the posterior network."""

import numpy as np

from cavirheo.inference.bins import END, SCALARS
from cavirheo.inference.latent import COORDINATES
from cavirheo.training.camera import film
from cavirheo.training.curves import NODES, STEPS, TOP, CurveStore


def test_an_exposure_does_not_move_the_clock():
    """A frame's time is the middle of its exposure: R_max is read as often too early as too late."""
    place = np.linspace(0, STEPS, NODES).astype(np.uint16)
    t = place * (END / STEPS)
    radius = np.where(t < 0.9, (1 - np.minimum(t / 0.93, 1) ** 2) ** 0.4, 0.2 + 0.4 * np.abs(np.sin(2.5 * (t - 0.9))))
    n, kept = 4000, np.round(radius * 65535 / TOP).astype(np.uint16)
    nothing = np.zeros((n, len(COORDINATES)), np.float32), np.zeros(n, np.uint8)
    one = CurveStore(np.tile(place, (n, 1)), np.tile(kept, (n, 1)), *nothing, np.full(n, 2.5e-4, np.float32))
    seen = film(one, np.arange(n), seed=3)
    exposure, late = seen.inputs[:, -SCALARS + 2], seen.inputs[:, -1]  # over the frame interval; 1 without growth
    origin = seen.z[(late == 0) & (exposure > 0.3), COORDINATES.index("time_origin")]
    assert len(origin) > 200
    assert abs(np.mean(origin)) < 0.1  # 0.02 is its standard error
