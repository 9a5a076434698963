"""From the shots of a group to mean ± standard deviation, and to result.json, result.csv and report.html."""

from pathlib import Path

import cavirheo
from cavirheo.reporting import write_report

curves = cavirheo.read_curves(Path(__file__).parent / "stiff_gel.mat")
answers = cavirheo.infer_many(curves)
document = write_report("group-result", list(zip(curves, answers, strict=True)), "group_to_table.py")
for group in document.groups:
    G, mu = group.shear_modulus_Pa, group.viscosity_Pa_s
    print(f"{group.name}: {group.n} shots, G {G.mean:.0f} ± {G.std:.0f} Pa, mu {mu.mean:.4f} ± {mu.std:.4f} Pa s")
