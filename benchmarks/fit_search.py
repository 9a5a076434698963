"""Does `fit` find the minimum? Simulated shots without noise, from all over the ranges that a fit searches.

    python benchmarks/fit_search.py [-n 300] [-o missed.txt]

Truths fill the ranges of the prior evenly (G 10 Pa to 10 MPa, mu 1e-4 to 10 Pa s, stretch 1.2 to 16, R_max 30 to 600
um), recorded from R_max on at 1 Mfps for 20 to 100 us, simulated with PRECISE. A shot counts where 0.1 % of radius
noise would leave G within 1 % and mu within 3 % (one standard deviation, stretch, clock and R_max free): about one in
ten. Printed are those of which `cavirheo fit --bubble field --no-others` is off by more, and processor time and
simulations per curve.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cavirheo.inference.search import LeastSquares

from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, simulate
from cavirheo.arrays import even_points
from cavirheo.inference import fit
from cavirheo.inference.assumptions import Family, Options
from cavirheo.inference.experiment import Experiment
from cavirheo.physics.accuracy import PRECISE

NOISE, CLOSE_G, CLOSE_MU = 1e-3, 0.01, 0.03
BOX = np.array([[1, 7], [-4, 1], np.log10([1.2, 16]), np.log10([30e-6, 600e-6]), [20e-6, 100e-6]])


def determined() -> Iterator[tuple[np.ndarray, RadiusCurve]]:
    """log10 of G, mu, stretch, and the curve, of the shots that count, without end."""
    family, first = Family("nhkv"), 0
    while True:
        for *log10, duration in BOX[:, 0] + even_points(first + 500, len(BOX))[first:] * np.ptp(BOX, axis=1):
            G, mu, stretch, R_max = 10 ** np.array(log10)
            time_ = np.arange(0.0, duration, 1e-6)
            law = NeoHookeanKelvinVoigt(G, mu)
            run = simulate(law, max_radius=R_max, stretch=stretch, time=time_, accuracy=PRECISE, throw=False)
            if not run.ok:
                continue
            curve = RadiusCurve(time_, run.radius, meta={"name": "shot"}, maximum=(0.0, R_max))
            shot = Experiment(curve, family, options=Options(weights="equal"))
            shot.sigma = np.full(len(shot.measured), NOISE)
            x = np.array([*log10[:3], 0.0, 0.0])
            J = LeastSquares(shot).jacobian(x, PRECISE, shot.predict(x, PRECISE))
            # the rows after the frames are those of the priors; a uniform clock counts as one of equal variance
            precision = J.T @ J + np.diag([0.0, 0.0, 0.0, 3.0, 0.0])
            spread = np.log(10.0) * np.sqrt(np.diag(np.linalg.pinv(precision)))
            if spread[0] < CLOSE_G and spread[1] < CLOSE_MU:
                yield np.array(log10[:3]), curve
        first += 500


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=300)
    parser.add_argument("-o", "--out", type=Path)
    given = parser.parse_args()
    missed, seconds, runs = [], [], []
    for number, (truth, curve) in zip(range(given.n), determined(), strict=False):
        began = time.process_time()
        answer = fit(curve, bubble="field", workers=1, others=False, trust_input=True)
        seconds.append(time.process_time() - began)
        runs.append(answer.diagnostics.simulations or 0)
        best = [answer.best.get(name, np.nan) for name in ("shear_modulus", "viscosity", "stretch")]
        off = np.abs(np.log(best) - np.log(10.0) * truth)
        if not (off[0] < CLOSE_G and off[1] < CLOSE_MU):
            at = ", ".join(f"{value:.3g}" for value in [*10**truth, curve.max_radius * 1e6])
            found = ", ".join(f"{value:.3g}" for value in best)
            misfit = answer.checks.rmse_over_rmax or np.nan
            missed.append(f"{number}: G, mu, stretch, R_max/um {at}; found {found}; RMSE {misfit:.2g}, "
                          f"{answer.checks.verdict}")  # fmt: skip
            print(missed[-1], flush=True)
    print(f"within 1 % of G and 3 % of mu: {given.n - len(missed)} of {given.n}; processor time "
          f"{np.median(seconds):.2f} s in the median, {np.mean(seconds):.2f} s on average; {np.median(runs):.0f} "
          "simulations in the median")  # fmt: skip
    if given.out:
        given.out.write_text("\n".join(missed) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
