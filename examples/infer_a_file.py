"""Infer G and mu of every curve of a file, and look at the verdict before the values are used."""

from pathlib import Path

import cavirheo

curves = cavirheo.read_curves(Path(__file__).parent / "soft_gel.csv")
gel = cavirheo.Medium(density=1000.0)  # kg/m3; the other constants are those of water
for curve, answer in zip(curves, cavirheo.infer_many(curves, medium=gel), strict=True):
    if answer.checks.verdict != "ok":
        print(f"{curve.name}: {answer.checks.verdict}, {answer.checks.message}")
        continue
    print(
        f"{curve.name}: R_max {curve.max_radius * 1e6:.0f} um, G {answer.median('G'):.0f} Pa, "
        f"mu {answer.median('mu'):.4f} Pa s, RMSE {answer.checks.rmse_over_rmax:.2%} of R_max"
    )
