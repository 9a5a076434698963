"""Simulate one bubble in a neo-Hookean gel, in a gel that locks up, and in a material with memory."""

import numpy as np

import cavirheo
from cavirheo.physics.materials import parse

time = np.linspace(0.0, 100e-6, 101)  # s after R_max
for text in (
    "nhkv(2e3, 0.05)",
    "gent(shear_modulus=2e3, limit=200) + carreau-yasuda(0.5, 0.01, 1e-4, 0.4)",
    "zener(2e3, 0.05, 1e-6)",
):
    run = cavirheo.simulate(parse(text), max_radius=200e-6, stretch=5.0, time=time)
    print(f"{text}: smallest radius {run.radius.min() * 1e6:.1f} um, last {run.radius[-1] * 1e6:.1f} um, {run.status}")
