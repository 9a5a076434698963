"""`cavirheo which-law`: the evidence of several laws for the same curves, and a report of the law that is chosen."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cavirheo.verbs import completion, options
from cavirheo.verbs.options import option
from cavirheo.verbs.run import Run

_LAWS = "two or more laws, with commas"


@dataclass(kw_only=True)
class _Question:
    laws: Annotated[str, option(_LAWS, autocompletion=completion.many_law_names)] = (
        "nhkv,newtonian,power-law,carreau-yasuda,qkv,fung + newtonian,zener"
    )
    stretch: options.Stretch = None
    window: options.Window = None
    exact_law: options.ExactLaw = False


@dataclass(kw_only=True)
class WhichLaw(options.Cluster, options.Figures, options.Measured, options.Answering, options.ManyBubbles, _Question):
    """Which of several laws explains the curves best? Evidence by importance sampling, 1 to 30 s a curve and law."""

    out: options.Out = Path("cavirheo-laws")

    def __call__(self, run: Run) -> None:
        from cavirheo import reporting
        from cavirheo.inference.options import Options
        from cavirheo.inference.verify.evidence import explained, models, plans, ranked, weighed
        from cavirheo.parallel import cores
        from cavirheo.physics.bubble import REAL
        from cavirheo.reporting.figures import laws_figure, names, save
        from cavirheo.reporting.laws import Laws, firmly, print_table, records
        from cavirheo.workflow.analyse import Unfinished
        from cavirheo.workflow.cluster import connected
        from cavirheo.writing import digits, document

        files, liquid, out, drawn = run.files(self.files), self.liquid, self.out, self.figure_kinds
        laws = [name.strip() for name in self.laws.split(",") if name.strip()]
        chosen = models(laws, self.bubbles or (REAL,))
        Options(window=self.window, stretch=self.stretch)
        outputs = document.Outputs(out, "laws.json", inputs=files)
        report = document.Outputs(out, *reporting.DOCUMENTS, inputs=files)
        with connected(self.scheduler, run.say) as executor:
            kept = Unfinished(out, shown=not run.quiet, executor=executor)
            curves = run.read(files, liquid, self)
            reporting.outputs(out, curves, drawn)
            how: dict[str, Any] = {"medium": liquid, "window": self.window, "trust_input": self.trust_input}
            asked = plans(chosen, stretch=self.stretch, seed=self.seed, discrepancy=not self.exact_law, **how)
            found = weighed(curves, asked, lambda *these: kept.answers(*these).numbered())
        complete = [i for i in range(len(curves)) if all(i in answers for answers in found.values())]
        answered, note = [curves[i] for i in complete], kept.note(len(complete), len(curves))
        singles, groups = ranked(answered, {law: [answers[i] for i in complete] for law, answers in found.items()})
        by_curve, by_group = records(answered, singles, groups)
        notes = [*([note] if note else []), *run.notes]
        made = Laws(command=run.command, notes=notes, curves=by_curve, groups=by_group)
        if note and report.holds("report.html"):
            run.stop(f"{note}; until then the earlier answers stay", out / "laws.json")
        if answered:
            outputs.write("laws.json", document.write_json, made)
        if note:
            run.stop(note, out / "laws.json" if answered else None)
        if "paper" in drawn:
            stems = names([one.name for one in made.curves], [one.name for one in made.groups], "paper-laws-")
            undrawn: list[str] = []
            for stem, one in zip(stems, [*made.curves, *made.groups], strict=True):
                with document.drawing(stem, undrawn):
                    save(outputs, stem, laws_figure(one))
            if undrawn:
                notes += undrawn
                outputs.write("laws.json", document.write_json, made.model_copy(update={"notes": notes}))
        outputs.finish()
        pairs = list(zip(answered, explained(singles, groups), strict=True))
        how = {"date": run.date, "draw": self.pictures, "workers": cores(), "notes": [*firmly(made), *notes]}
        with run.bar("drawing", unit="figures") if drawn else nullcontext() as advance:
            reporting.write_report(out, pairs, run.command, drawn, done=advance, **how)
        kept.remove()
        run.show(made, print_table)
        verdicts = {answer.checks.verdict for one in singles for answer in one.answers.values()}
        failed = "check_input" in verdicts or any(one.chosen is None for one in singles)
        places = f"{out / 'laws.json'}; report: {out / 'report.html'}"
        run.end(f"{digits.counted(len(curves), 'curve')} in {{seconds}}; {places}", failed)
