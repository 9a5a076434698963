"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cavirheo.verbs import options
from cavirheo.verbs.run import Run


@dataclass(kw_only=True)
class Infer(options.Cluster, options.Figures, options.Measured, options.Inference):
    """Shear modulus and viscosity from measured radius histories, with intervals and pictures that show whether to
    believe them."""

    def __call__(self, run: Run) -> None:
        from cavirheo.cluster import connected
        from cavirheo.inference import check_models, infer_many
        from cavirheo.inference.model import Network
        from cavirheo.inference.options import check_wall
        from cavirheo.inference.posterior_model import network_of
        from cavirheo.parallel import Step
        from cavirheo.reporting import DOCUMENTS
        from cavirheo.writing.document import Outputs

        files, liquid, bubbles, drawn = run.files(self.files), self.liquid, self.bubbles, self.figure_kinds
        self.check_verify(files)
        check_models(self.model, self.material, bubbles, self.verify, self.stretch)
        network = network_of(self.model)
        single = isinstance(network, Network)
        Outputs(self.out, *DOCUMENTS, inputs=files)
        shared: dict[str, Any] = {"medium": liquid, "stretch": self.stretch}
        settings = {"model": self.model, "window": self.window, "trust_input": self.trust_input, **shared}
        checked: dict[str, Any] = {"seed": self.seed, "discrepancy": not self.exact_law}
        if not single:
            settings |= {"material": self.material, "verify": self.verify, "bubble": bubbles, **checked}
        else:
            checked["bubble"] = bubbles
        first = Step("inferring", infer_many, settings, made_with=network.sha256)
        checked |= {"verify": self.verify if single and self.verify != "auto" else "none", **shared}
        with connected(self.scheduler, run.say) as executor:
            curves = run.read(files, liquid, self)
            for bubble in bubbles or ():
                check_wall(bubble, curves)
            how: dict[str, Any] = {"pictures": self.pictures, "figures": drawn, "executor": executor}
            run.report(curves, first, self.out, **how, **checked)
