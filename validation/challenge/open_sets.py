"""Real recordings of the open sets, cut at the first rebound; what comes later is to be predicted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cavirheo import RadiusCurve, read_curves
from validation.challenge.make import write_recording, write_table

SETS = {  # name: (files, density in kg/m3)
    "alginate": ("paam_alginate_0p3/*.mat", 998.0),
    "stiff PA": ("pa_stiff/RofT_shifted_20_shots.mat", 998.0),
    "agarose 0.5 %": ("agarose_0p5/Rt_nondim_exp.mat", 1003.0),
    "agarose 2.5 %": ("agarose_2p5/Rt_nondim_exp.mat", 1025.0),
    "PEG 10 %": ("peg8000_10wv/*.mat", 998.0),
    "PEG 40 %": ("peg8000_40wv/*.mat", 998.0),
}
END = 0.4  # s/m of R_max: four t_c of water after R_max, where prediction ends


def cut(curve: RadiusCurve) -> float | None:
    """Time of the largest radius between the first two collapses; None where there is no second one."""
    collapses = curve.collapse_times()
    if len(collapses) < 2:
        return None
    between = (curve.time > collapses[0]) & (curve.time < collapses[1]) & np.isfinite(curve.radius)
    return float(curve.time[between][np.argmax(curve.radius[between])]) if between.any() else None


def make(folder: Path, out: Path, shots: int) -> None:
    """Writes at most so many shots of each set in `folder`: out/recordings/ as make.py does, and out/held.csv, the
    frames that are to be predicted."""
    recordings = out / "recordings"
    recordings.mkdir(parents=True, exist_ok=True)
    known, held = [], []
    for group, (files, density) in SETS.items():
        curves = [curve for file in sorted(folder.glob(files)) for curve in read_curves(file)]
        usable = [(curve, last) for curve in curves if not curve.unusable and (last := cut(curve)) is not None]
        for curve, last in usable[:shots]:
            name, seen = f"real{len(known) + 1:03d}", np.isfinite(curve.radius) & (curve.radius > 0)
            start = curve.time[seen][0]
            early, end = seen & (curve.time <= last), curve.time_of_max + END * curve.max_radius
            write_recording(recordings, name, curve.time[early] - start, curve.radius[early])
            R_max_um = f"{1e6 * curve.max_radius:.3f}"
            rate = 1.0 / float(np.median(np.diff(curve.time)))
            known.append({"name": name, "R_max_um": R_max_um, "frame_rate_Hz": f"{rate:.0f}", "exposure_us": "0"})
            known[-1]["density_kg_m3"] = f"{density:g}"
            for i in np.flatnonzero(seen & (curve.time > last) & (curve.time < end)):
                frame = {"time_us": f"{1e6 * (curve.time[i] - start):.4f}", "radius_um": f"{1e6 * curve.radius[i]:.4f}"}
                held.append({"name": name, **frame, "set": group, "R_max_um": R_max_um})
    write_table(recordings / "known.csv", known)
    write_table(out / "held.csv", held)
