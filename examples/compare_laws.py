"""Which of two laws explains a shot: the evidence of each, and the simplest law that is not clearly worse."""

from pathlib import Path

import cavirheo
from cavirheo.inference.which_law import rank_laws

curves = cavirheo.read_curves(Path(__file__).parent / "soft_gel.csv")[:1]
rankings, _ = rank_laws(curves, ["newtonian", "nhkv"], seed=1)
(ranking,) = rankings
for law, evidence in ranking.evidence.items():
    print(f"{law}: log evidence {evidence.log:.1f} ± {evidence.error:.1f}, probability {ranking.probability[law]:.3g}")
print("chosen:", ranking.chosen)
