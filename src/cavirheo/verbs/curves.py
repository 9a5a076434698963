"""`cavirheo infer`, `fit`, `which-law` and `watch`: curves in; answers, a table, documents and pictures out.

The annotations of options are objects, not text, as in settings.py.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cavirheo import settings
from cavirheo.errors import InputError
from cavirheo.settings import INPUT, INTERVAL, OUTPUT, argument, number, option
from cavirheo.verbs.run import REFERENCES, Out, Run, Scheduler, Slurm, Verb, has_problems
from cavirheo.writing import digits

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.analysis import Analysis
    from cavirheo.inference.population import CommonErrors
    from cavirheo.io.shots import CurveSet
    from cavirheo.posterior import Posterior
    from cavirheo.reporting.record import LawsOfGroup, Result

_FILES = "measured R(t): .mat, .csv, .h5, .xlsx; or videos: .mp4, .tif, .cine, ...; or a folder"
_SCALE_ERROR = "error of the radius scale that all shots of a group share, as a standard deviation, %"
# options that change draws alone, of which a network has none
_OF_DRAWS = ("scale_error", "rate_error", "density_error", "pressure_error")
_PICTURES = "draw pictures; --no-pictures is faster"
_FITTED = "nhkv, newtonian, power-law, ...; auto: liquid or gel"
_LAWS = "nhkv,newtonian,power-law,carreau-yasuda,qkv,fung + newtonian,zener"
_FREE = "also fitted: t0 (clock), scale (of the radius), rmax; or none  [default: t0,rmax]"


def _error(help: str) -> Any:
    return number(help, INTERVAL, least=0, most=20)


@dataclass(frozen=True, kw_only=True)
class _AnsweringVerb(Verb, settings.Settings):
    """Answer measured curves, and write a report. Options: errors that all shots of a group share, and the output."""

    scale_error: Annotated[float, _error(_SCALE_ERROR)] = 1.0
    rate_error: Annotated[float, _error("the same of the frame rate, %")] = 0.1
    density_error: Annotated[float, _error("the same of the density, %")] = 1.0
    pressure_error: Annotated[float, _error("the same of the pressure, %")] = 1.0
    every_shot: Annotated[bool, option("print a row for each shot, not for exceptions alone", OUTPUT, "--all")] = False
    pictures: Annotated[bool, option(_PICTURES, OUTPUT, "--pictures/--no-pictures")] = True

    @property
    def analysis(self) -> "Analysis":
        analysis = super().analysis
        given = [name for name in _OF_DRAWS if getattr(self, name) != getattr(type(self), name)]
        if given and analysis.method == "bdt":
            raise analysis.idle_error(", ".join(f"--{name.replace('_', '-')}" for name in given))
        return analysis

    @property
    def errors(self) -> "CommonErrors":
        """The errors as fractions."""
        from cavirheo.inference.population import CommonErrors

        per_cent = self.scale_error, self.rate_error, self.density_error, self.pressure_error
        return CommonErrors(*(0.01 * error for error in per_cent))

    def read_recordings(self, files: list[Path], exclude: str | None = None) -> "CurveSet":
        """Read the files by `read_shots` with these options. Raises InputError."""
        from cavirheo.io.shots import read_shots

        if exclude is not None and len(files) > 1:
            message = f"--exclude is of one recording, {len(files)} files were given"
            raise InputError(f"{message}: `cavirheo measure` each with its own", "option.exclude")
        return read_shots(files, exclude=exclude, **self.read_options)


@dataclass(frozen=True, kw_only=True)
class _ReportVerb(_AnsweringVerb):
    """Answer the curves of given files by one or several analyses."""

    files: Annotated[list[Path], argument("FILE...", _FILES, readable=False)]
    exclude: settings.Exclude = None
    references: Annotated[list[Path] | None, option(REFERENCES, INPUT)] = None
    scheduler: Scheduler = None
    slurm: Slurm = None

    @property
    def analyses(self) -> dict[str, "Analysis"]:
        """The analyses of each curve, by name. Raises InputError."""
        return {"": self.analysis}

    def choose(
        self, curves: Sequence["RadiusCurve"], answers: Mapping[str, list["Posterior"]]
    ) -> tuple[list["Posterior"], dict[int, "LawsOfGroup"]]:
        """The answer of each curve; and the laws that were compared, by the first curve of a group."""
        return answers[""], {}

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.published_values import by_group, read_sets
        from cavirheo.physics.simulate import load_solver
        from cavirheo.reporting import DOCUMENTS, write_documents
        from cavirheo.reporting.documents import result
        from cavirheo.reporting.record import members_of
        from cavirheo.reporting.screen import print_result
        from cavirheo.workflow import UNFINISHED, Store, analyse_all, connected

        files = run.files(self.files)
        references = self.references or []
        analyses = self.analyses
        sets = read_sets(references)
        folder = run.outputs(self.out, *DOCUMENTS, inputs=[*files, *references])
        store = Store(self.out / UNFINISHED)
        with connected(self.scheduler, self.slurm, run.say) as executor:
            curves, problems, remarks = self.read_recordings(files, self.exclude)
            run.note_unreadable(*problems)
            run.notes += remarks
            run.require_any(curves, "curve")
            load_solver()
            published = by_group([name for name, _ in members_of(curves)], sets)
            for analysis in analyses.values():
                analysis.check(curves)
            found = analyse_all(curves, analyses, store, executor, visible=not run.quiet)
        answered = sorted(set.intersection(*map(set, found.values())))
        by_analysis = {name: [answers[i] for i in answered] for name, answers in found.items()}
        answers, laws = self.choose([curves[i] for i in answered], by_analysis)
        pairs = [(curves[i], answer) for i, answer in zip(answered, answers, strict=True)]
        interrupted = len(answered) < len(curves)
        if interrupted:
            note = f"interrupted: {len(answered)} of {len(curves)} answered; the same command again answers the rest"
            if folder.listed_entry("report.html"):
                run.end_interrupted(f"{note}; until then the earlier answers stay", self.out / "result.json")
            if not pairs:
                run.end_interrupted(note, None)
            run.notes.insert(0, note)
        document = result(pairs, errors=self.errors, **run.document_fields)
        for group, (first, *_) in document.indices_by_group():
            group.laws = laws.get(first)
        document.add_published(published)
        write_documents(folder, pairs, document, complete=not interrupted, draw=self.pictures)
        if interrupted:
            run.end_interrupted(note, self.out / "result.json")
        store.remove_used()
        how: dict[str, Any] = {"every_shot": self.every_shot, "printed_notes": run.printed_notes, "out": self.out}
        run.show(document, partial(print_result, **how))
        undecided = any(not compared.chosen for compared in laws.values())
        failed = has_problems(document) or undecided
        run.end(digits.counted(len(curves), "curve"), failed, f"; report: {self.out / 'report.html'}")


@dataclass(frozen=True, kw_only=True)
class Infer(_ReportVerb, settings.InferOptions):
    """Shear modulus and viscosity from measured radius histories, with intervals and pictures that show whether to
    believe them."""


@dataclass(frozen=True, kw_only=True)
class Fit(_ReportVerb):
    """The field's conventional fit: simulated on measured radius histories under white noise, with intervals."""

    material: Annotated[str, option(_FITTED)] = "nhkv"
    window_us: Annotated[float | None, number("end of the window, us after R_max", INPUT, above=0)] = None
    free: Annotated[str | None, option(_FREE, INTERVAL)] = None
    out: Out = Path("cavirheo-fit")

    @property
    def analysis_options(self) -> dict[str, Any]:
        end = None if self.window_us is None else self.window_us * 1e-6
        return super().analysis_options | {"method": "fit", "end": end}


@dataclass(frozen=True, kw_only=True)
class WhichLaw(_ReportVerb):
    """Which of several laws explains the curves best? Evidence by sampling."""

    laws: Annotated[str, option("two or more laws, with commas; with --damage usually those with a spring")] = _LAWS
    exact_law: settings.ExactLaw = False
    out: Out = Path("cavirheo-laws")

    @property
    def analyses(self) -> dict[str, "Analysis"]:
        from cavirheo.inference.assumptions import Family
        from cavirheo.inference.which_law import plans

        laws = [name.strip() for name in self.laws.split(",") if name.strip()]
        if self.laws == _LAWS and self.damage != "none":
            laws = [law for law in laws if Family(law).elastic]
        return plans(laws, **self.analysis_options)

    def choose(
        self, curves: Sequence["RadiusCurve"], answers: Mapping[str, list["Posterior"]]
    ) -> tuple[list["Posterior"], dict[int, "LawsOfGroup"]]:
        from cavirheo.inference.which_law import choose_answers, ranked
        from cavirheo.reporting.documents import laws_by_curve

        singles, groups = ranked(curves, answers)
        return choose_answers(singles, groups), laws_by_curve([*singles, *groups])


@dataclass(frozen=True, kw_only=True)
class Watch(settings.InferOptions, _AnsweringVerb):
    """Every recording that arrives in a folder, answered as `infer` does, until Ctrl-C."""

    folder: Annotated[Path, argument("FOLDER", "where the recordings arrive: R(t) files or videos", readable=False)]
    once: Annotated[bool, option("answer the files that exist, write the report, and stop", None, "--once")] = False

    def __call__(self, run: Run) -> None:
        from time import sleep

        from cavirheo import watch
        from cavirheo.physics.simulate import load_solver
        from cavirheo.reporting import DOCUMENTS, write_documents
        from cavirheo.reporting.documents import curve_record, result
        from cavirheo.reporting.screen import print_line, print_result
        from cavirheo.workflow import Store

        if not self.folder.is_dir():
            raise InputError(f"{self.folder} is no folder: give the one where recordings arrive", "watch.folder")
        outputs = run.outputs(self.out, *DOCUMENTS)

        def show(curve: "RadiusCurve", answer: "Posterior") -> None:
            if not run.quiet:
                print_line(curve_record(curve, answer))

        def publish(pairs: watch.Pairs, notes: list[str]) -> "Result":
            """Write the documents; earlier ones stay until there is an answer."""
            document = result(pairs, run.command, date=run.date, notes=notes, errors=self.errors)
            if pairs or not outputs.listed_entry("result.json"):
                write_documents(outputs, pairs, document, draw=self.pictures)
            return document

        store = Store(self.out / "watched")
        how = self.analysis, self.group, self.read_recordings
        watched = watch.Watch(self.folder, store, *how, notify=run.note, show=show, publish=publish)
        load_solver()
        watched.write()
        report = self.out / "report.html"
        run.say(f"watching {self.folder}: {report} has all answers{'' if self.once else '; Ctrl-C ends'}")
        stopped = False
        try:
            while watched.step() or not self.once:
                sleep(watch.PAUSE)
        except KeyboardInterrupt:  # the usual end
            stopped = True
        document = watched.write()
        if not document.curves and not stopped:
            raise InputError(f"{self.folder} holds no measurement: run it again when there is one", "watch.nothing")
        shown = partial(print_result, out=self.out, every_shot=self.every_shot, printed_notes=run.printed_notes)
        run.show(document, shown)
        run.unreadable = 0 if stopped else len(watched.unreadable)
        failed = not stopped and has_problems(document)
        run.end(digits.counted(len(document.curves), "curve"), failed, f"; report: {report}")
