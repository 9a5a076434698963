"""`cavirheo fit`: curves in, least-squares answers, table, documents and pictures out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cavirheo.verbs import completion, options
from cavirheo.verbs.options import INPUT, INTERVAL, option
from cavirheo.verbs.run import Run

_FREE = "also fitted: t0 (clock), scale (of the radius), rmax; or none  [default: t0,rmax]"
_WEIGHTS = "learnt: the residuals tell how much less frames beside collapses count"
_OTHERS = "look at the field's bubble beside the real one, or the other way round"


@dataclass(kw_only=True)
class _Question:
    material: Annotated[
        str,
        option("nhkv, newtonian, power-law, ...; auto: the evidence chooses", autocompletion=completion.law_names),
    ] = "nhkv"
    stretch: options.Stretch = None
    window: options.Window = None
    window_us: Annotated[float | None, option("end of the window, us after R_max", INPUT)] = None
    free: Annotated[str | None, option(_FREE, INTERVAL)] = None
    t0_us: Annotated[float | None, option("largest |t0|, us  [default: half a frame]", INTERVAL)] = None
    scale_percent: Annotated[float, option("limit of the change of scale and rmax, %", INTERVAL)] = 1.5
    weights: Annotated[Literal["learnt", "equal"], option(_WEIGHTS, INTERVAL)] = "learnt"
    others: Annotated[bool, option(_OTHERS, INTERVAL, "--others/--no-others")] = True


@dataclass(kw_only=True)
class Fit(options.Cluster, options.Figures, options.Measured, options.Answering, options.OneBubble, _Question):
    """The field's conventional fit: least squares of simulated on measured radius histories, with intervals."""

    out: options.Out = Path("cavirheo-fit")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference.analysis import Analysis
        from cavirheo.reporting import DOCUMENTS
        from cavirheo.workflow.cluster import connected
        from cavirheo.writing.document import Outputs

        files, liquid, drawn = run.files(self.files), self.liquid, self.figure_kinds
        camera: dict[str, Any] = {"free": self.free, "scale_bound": self.scale_percent / 100}
        camera["t0_bound"] = None if self.t0_us is None else self.t0_us * 1e-6
        end = None if self.window_us is None else self.window_us * 1e-6
        cut: dict[str, Any] = {"window": self.window, "end": end, "weights": self.weights, "stretch": self.stretch}
        how: dict[str, Any] = {"medium": liquid, "others": self.others, "trust_input": self.trust_input}
        how |= {"bubble": self.bubbles, "seed": self.seed}
        analysis = Analysis("fit", material=self.material, **camera, **cut, **how)
        Outputs(self.out, *DOCUMENTS, inputs=files)
        with connected(self.scheduler, run.say) as executor:
            curves = run.read(files, liquid, self)
            run.report(curves, analysis, self.out, pictures=self.pictures, figures=drawn, executor=executor)
