"""`cavirheo infer`, `fit`, `which-law` and `watch`: curves in; answers, a table, documents and pictures out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cavirheo import settings
from cavirheo.errors import require
from cavirheo.settings import BUBBLE, INPUT, INTERVAL, argument, option
from cavirheo.verbs import options
from cavirheo.verbs.run import Run, has_problems
from cavirheo.writing import digits

if TYPE_CHECKING:
    from cavirheo.reporting.record import Pairs, Result
    from cavirheo.writing.document import Outputs

_FITTED = "nhkv, newtonian, power-law, ...; auto: liquid or gel"
_LAWS = "nhkv,newtonian,power-law,carreau-yasuda,qkv,fung + newtonian,zener"
_FREE = "also fitted: t0 (clock), scale (of the radius), rmax; or none  [default: t0,rmax]"
_BUBBLES = option("real, field, or both with a comma")
_DAMAGES = "softening of the gel: none, strain, or both with a comma"


@dataclass(frozen=True, kw_only=True)
class _ReportVerb(options.MeasuredFiles, options.SharedErrors):
    """Answer the curves of files by one analysis, and write a report."""

    references: Annotated[list[Path] | None, option(options.REFERENCES, INPUT)] = None

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.published_values import TABLE, by_group, in_sets, read_sets, write_comparison
        from cavirheo.reporting import DOCUMENTS
        from cavirheo.reporting.record import group_names, result
        from cavirheo.reporting.screen import print_result
        from cavirheo.workflow.cluster import connected
        from cavirheo.workflow.store import Unfinished
        from cavirheo.writing.document import Outputs

        files = run.files(self.files)
        out = self.out
        references = self.references or []
        analysis = self.analysis
        sets = read_sets(references)
        inputs = [*files, *references]
        folder = Outputs(out, *DOCUMENTS, inputs=inputs)
        if references:
            Outputs(out, TABLE, inputs=inputs)
        with connected(self.scheduler, self.slurm, run.say) as executor:
            curves = self.read_curves(run, files)
            unfinished = Unfinished(out, visible=not run.quiet, executor=executor)
            curves = in_sets(curves, sets)
            published = by_group(group_names(curves), sets)
            analysis.check(curves)
            answers = unfinished.answers(curves, analysis)
        note = unfinished.note(len(answers), len(curves))
        pairs = [(curves[i], answer) for i, answer in answers.items()]
        document = result(pairs, errors=self.errors, **_head(run, note))
        document.add_published(published)
        _write(run, folder, pairs, document, note, draw=self.pictures)
        unfinished.remove()
        if references:
            write_comparison(out, document, inputs)
        run.show(document, partial(print_result, out=out, every_shot=self.every_shot, printed_notes=run.printed_notes))
        run.end(digits.counted(len(curves), "curve"), has_problems(document), f"; report: {out / 'report.html'}")


def _head(run: Run, note: str) -> dict[str, Any]:
    """The fields of a document that describe the run; `note`: why answers are missing."""
    return {**run.document_fields, "notes": [note, *run.notes] if note else run.notes}


def _write(run: Run, folder: Outputs, pairs: Pairs, document: Result, note: str, *, draw: bool) -> None:
    """Write the documents. note: why answers are missing; the run ends after what is written."""
    from cavirheo.reporting import write_report

    out = folder.folder
    if note and folder.listed_entry("report.html"):
        run.end_interrupted(f"{note}; until then the earlier answers stay", out / "result.json")
    if note and not pairs:
        run.end_interrupted(note, None)
    write_report(out, pairs, document, complete=not note, draw=draw)
    if note:
        run.end_interrupted(note, out / "result.json")


@dataclass(frozen=True, kw_only=True)
class Infer(_ReportVerb, settings.InferSettings):
    """Shear modulus and viscosity from measured radius histories, with intervals and pictures that show whether to
    believe them."""


@dataclass(frozen=True, kw_only=True)
class Fit(_ReportVerb):
    """The field's conventional fit: simulated on measured radius histories under white noise, with intervals."""

    material: Annotated[str, option(_FITTED)] = "nhkv"
    window_us: Annotated[float | None, option("end of the window, us after R_max", INPUT)] = None
    free: Annotated[str | None, option(_FREE, INTERVAL)] = None
    t0_us: Annotated[float | None, option("largest |t0|, us  [default: what the frames leave open]", INTERVAL)] = None
    scale_percent: Annotated[float, option("limit of the change of scale and rmax, %", INTERVAL)] = 1.5
    out: options.Out = Path("cavirheo-fit")

    @property
    def analysis_options(self) -> dict[str, Any]:
        t0_bound, end = (None if us is None else us * 1e-6 for us in (self.t0_us, self.window_us))
        own = {"method": "fit", "scale_bound": self.scale_percent / 100, "t0_bound": t0_bound, "end": end}
        return super().analysis_options | own


@dataclass(frozen=True, kw_only=True)
class WhichLaw(options.MeasuredFiles):
    """Which of several laws explains the curves best? Evidence by sampling."""

    laws: Annotated[str, option("two or more laws, with commas")] = _LAWS
    exact_law: settings.ExactLaw = False
    bubble: Annotated[str, _BUBBLES] = "real"  # type: ignore[assignment]
    damage: Annotated[str, option(_DAMAGES, BUBBLE)] = "none"  # type: ignore[assignment]
    out: options.Out = Path("cavirheo-laws")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference.assumptions import Options
        from cavirheo.inference.which_law import choose_answers, models, plans, ranked
        from cavirheo.physics.bubble import REAL
        from cavirheo.reporting import DOCUMENTS
        from cavirheo.reporting.laws import laws_by_curve
        from cavirheo.reporting.record import result
        from cavirheo.reporting.screen import print_all
        from cavirheo.workflow.cluster import connected
        from cavirheo.workflow.store import Unfinished
        from cavirheo.writing.document import Outputs

        files = run.files(self.files)
        out = self.out
        materials = [name.strip() for name in self.laws.split(",") if name.strip()]
        candidates = models(materials, self.bubbles or (REAL,))
        Options(window=self.window, stretch=self.stretch)
        folder = Outputs(out, *DOCUMENTS, inputs=files)
        with connected(self.scheduler, self.slurm, run.say) as executor:
            unfinished = Unfinished(out, visible=not run.quiet, executor=executor)
            curves = self.read_curves(run, files)
            shared = {name: value for name, value in self.analysis_options.items() if name != "bubble"}
            analyses = plans(candidates, **shared, discrepancy=not self.exact_law)
            by_law = {law: unfinished.answers(curves, plan) for law, plan in analyses.items()}
        complete = sorted(set.intersection(*map(set, by_law.values())))
        answered = [curves[i] for i in complete]
        singles, groups = ranked(answered, {law: [answers[i] for i in complete] for law, answers in by_law.items()})
        pairs = list(zip(answered, choose_answers(singles, groups), strict=True))
        note = unfinished.note(len(complete), len(curves))
        document = result(pairs, **_head(run, note))
        document.add_laws(laws_by_curve([*singles, *groups]))
        _write(run, folder, pairs, document, note, draw=self.pictures)
        unfinished.remove()
        run.show(document, partial(print_all, out=out))
        failed = has_problems(document) or any(not ranking.chosen for ranking in singles)
        run.end(digits.counted(len(curves), "curve"), failed, f"; report: {out / 'report.html'}")


@dataclass(frozen=True, kw_only=True)
class Watch(settings.InferSettings, options.AnsweringVerb, options.SharedErrors):
    """Every recording that arrives in a folder, answered as `infer` does, until Ctrl-C."""

    folder: Annotated[Path, argument("FOLDER", "where the recordings arrive: R(t) files or videos", readable=False)]
    once: Annotated[bool, option("answer the files that exist, write the report, and stop", None, "--once")] = False
    patience: Annotated[float, option("how long to try a file again that cannot be read, s", INPUT, min=0.0)] = 10.0

    def __call__(self, run: Run) -> None:
        from cavirheo import watch
        from cavirheo.physics.simulate import load_solver
        from cavirheo.reporting.screen import print_line, print_result

        folder = self.folder
        out = self.out
        require(folder.is_dir(), f"{folder} is no folder: give the one where recordings arrive", "watch.folder")
        analysis = self.analysis
        read_settings = settings.shared_values(self, settings.FileSettings)
        keywords: dict[str, Any] = {"group": self.group, "read_timeout": self.patience, "notify": run.say}
        keywords |= {"command": run.command, "date": run.date, "draw": self.pictures, "errors": self.errors}
        if not run.quiet:
            keywords["show"] = print_line
        watched = watch.Watch(folder, out, analysis, self.read_recordings, read_settings, **keywords)
        load_solver()
        result = watched.write()
        end = "" if self.once else "; Ctrl-C ends"
        run.say(f"watching {folder}: {len(result.curves)} answered before; {out / 'report.html'} has all{end}")
        try:
            while watched.answer_next() or watched.pause() or not self.once:
                pass
            stopped = False
        except KeyboardInterrupt:  # the usual end
            stopped = True
        result = watched.write()
        run.show(result, partial(print_result, out=out, every_shot=self.every_shot))
        run.unreadable = 0 if stopped else watched.unreadable
        failed = not stopped and has_problems(result)
        run.end(digits.counted(len(result.curves), "curve"), failed, f"; report: {out / 'report.html'}")
