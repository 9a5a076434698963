"""A program that mypy checks with the sources (pyproject.toml); an expected error that it misses is one, too."""

import cavirheo
from cavirheo.reporting.measured import Measured

curve = cavirheo.read_curves("gel.csv", shots="1,4-7")[0]
low, high = cavirheo.infer(curve, material="nhkv").interval("shear_modulus") or (0.0, 0.0)
print(low, high, cavirheo.fit(curve=curve, window=3, free=("t0",), medium="water").best["viscosity"])
cavirheo.fit(curve, windou=3)  # type: ignore[call-arg]
cavirheo.fit(curve, window=3.5)  # type: ignore[arg-type]
cavirheo.infer(curve, materail="nhkv")  # type: ignore[call-arg]
cavirheo.measure("bubble.mp4", framerate=5e5)  # type: ignore[call-arg]
gel = cavirheo.Newtonian(0.05)
cavirheo.simulate_many([gel], max_radius=2e-4, stretch=6.0, time=[0.0], relaxed=True)
cavirheo.simulate_many([gel], max_radius=2e-4, stretch=6.0, time=[0.0], nonsense=1)  # type: ignore[call-arg]
print(curve.radii)  # type: ignore[attr-defined]
print(cavirheo.load("result.json").records)  # type: ignore[union-attr]
print(cavirheo.load("measure.json", Measured).parameters)  # type: ignore[attr-defined]
