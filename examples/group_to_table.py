"""From the shots of a group to G and mu of their material, and to result.json, result.csv and report.html."""

from pathlib import Path

import cavirheo
from cavirheo.reporting import result, write_report

curves = cavirheo.read_curves(Path(__file__).parent / "stiff_gel.mat")
answers = cavirheo.infer_many(curves)
pairs = list(zip(curves, answers, strict=True))
document = result(pairs, "group_to_table.py")
write_report("group-result", pairs, document)
for group in document.groups:
    G, mu = group.value("shear_modulus"), group.value("viscosity")
    print(f"{group.name}: {group.n} shots, {group.verdict}")
    print(f"G {G.median:.0f} [{G.q05:.0f}, {G.q95:.0f}] Pa, mu {mu.median:.4f} [{mu.q05:.4f}, {mu.q95:.4f}] Pa s")
