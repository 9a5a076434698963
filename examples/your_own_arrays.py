"""A curve of your own as arrays: here it is simulated, with noise and a lost frame, and then inferred."""

import numpy as np

import cavirheo

time = np.arange(120) * 1e-6  # s, any origin
true = cavirheo.simulate(cavirheo.NeoHookeanKelvinVoigt(8e3, 0.05), max_radius=250e-6, stretch=7.0, time=time)
radius = true.radius + 1e-6 * np.random.default_rng(1).standard_normal(time.size)  # m
radius[40] = np.nan  # a frame without a measurement

# the first frame shows R_max: without this statement it may also be up to a frame earlier
curve = cavirheo.RadiusCurve(time, radius, meta={"name": "mine"}, stated_time_of_max=0.0)
answer = cavirheo.infer(curve, bubble="field")  # as it was simulated; leave `bubble` out for a recording
print(f"G {answer.median('G'):.0f} Pa (true 8000), mu {answer.median('mu'):.4f} Pa s (true 0.05)")
print(f"strain rate up to the first collapse: {curve.strain_rate():.3g} 1/s")
