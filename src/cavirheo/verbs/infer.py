"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from dataclasses import dataclass

from cavirheo.verbs import options
from cavirheo.verbs.run import Run


@dataclass(kw_only=True)
class Infer(options.Cluster, options.Figures, options.Measured, options.Inference):
    """Shear modulus and viscosity from measured radius histories, with intervals and pictures that show whether to
    believe them."""

    def __call__(self, run: Run) -> None:
        from cavirheo.reporting import DOCUMENTS
        from cavirheo.workflow.cluster import connected
        from cavirheo.writing.document import Outputs

        files, drawn = run.files(self.files), self.figure_kinds
        self.check_verify(files)
        analysis = self.analysis
        Outputs(self.out, *DOCUMENTS, inputs=files)
        with connected(self.scheduler, run.say) as executor:
            curves = run.read(files, self.liquid, self)
            run.report(curves, analysis, self.out, pictures=self.pictures, figures=drawn, executor=executor)
