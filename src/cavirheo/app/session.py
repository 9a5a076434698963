"""The session of one visitor (files, curves, settings, answers), what the buttons do with it, its limits, and all
sessions of the server."""

from __future__ import annotations

import re
import shlex
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from cavirheo.app.reader import Reader
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, parse_number_list, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.network_files import shipped
from cavirheo.inference.what_if import checks_with, slider
from cavirheo.io import write_csv
from cavirheo.io.files import without_headers
from cavirheo.parallel import Flow, cores, on_threads, run_on_any_core
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting import group_pictures, result, write_report
from cavirheo.reporting.documents import curve_record
from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.settings import Exclude, InferOptions, Number, checked
from cavirheo.video.formats import is_video, pixels_of
from cavirheo.workflow import with_source_of
from cavirheo.writing import digits
from cavirheo.writing.document import LIST_FILE, short_name

UPLOAD_FOLDER = "your files"  # the folder of a visitor, which names the group of single-shot files
# the settings of the page, in the order of the options of the endpoint: a new one comes last
PAGE_FIELDS = (
    *("model", "medium", "density", "rmax_um", "stretch", "window", "material", "bubble", "trust_input"),
    *("fps", "um_per_px", "exposure_us", "exclude"),
    *("group", "sound_speed", "surface_tension", "pressure", "temperature"),
)
SLIDERS = {  # label, factor from SI
    "shear_modulus": ("Try G (kPa)", 1e-3),
    "viscosity": ("Try µ (Pa s)", 1.0),
    "stretch": ("Try λ (R_max/R_0)", 1.0),
}
EXAMPLES = {name: Path(__file__).parent / "examples" / name for name in ("soft_gel.csv", "stiff_gel.mat", "bubble.mp4")}
EXAMPLE_CAMERA = {"fps": 500_000.0, "um_per_px": 4.0, "exposure_us": 0.4}  # of the shipped recording
STARTS = {"medium": "water", "material": "auto", "bubble": "real"}  # what fields show that stand for the default


def option_of(name: str) -> str:
    """The option of the command line for a field of PageSettings."""
    return f"--{name.replace('_', '-')}"


@dataclass(frozen=True)
class VisitorLimits:
    """What one visitor may load, and how many visitors there are."""

    file_mb: float = 50.0
    files: int = 50
    curves: int = 400
    frames: int = 400_000
    read_seconds: float = 20.0  # s, to read the files
    readers: int = 3  # processes that read files, shared by all visitors
    film_seconds: float = 120.0  # s, to measure a recording
    visitors: int = 100
    absent_seconds: float = 600.0  # s from closing the page until the visitor is forgotten


@dataclass(frozen=True, kw_only=True)
class PageSettings(InferOptions):
    """The settings of `cavirheo infer` that the page and its endpoint have; None: not given. Numbers may be texts, and
    an empty text is the default. Raises InputError: a value that `infer` rejects, or a model that is not shipped (a
    visitor must not open files of this machine)."""

    exclude: Exclude = None

    def __post_init__(self) -> None:
        for name in PAGE_FIELDS:
            value = getattr(self, name)
            if value in (None, "", STARTS.get(name)):
                value = getattr(PageSettings, name)
            object.__setattr__(self, name, value if value is None else checked(PageSettings, name, value))
        if self.exclude:
            parse_number_list(self.exclude, "exclude", "video.exclude")
        known = DEFAULT, *shipped("point")
        if self.model not in known:
            raise InputError(f"unknown model {self.model!r}; known here: {', '.join(known)}", "app.unknown_model")
        _ = self.analysis, self.read_options

    @property
    def camera(self) -> dict[str, Any]:
        """The options of `read_curves` for a recording."""
        camera = {"frame_rate_hz": self.fps, "um_per_px": self.um_per_px}
        return camera | {"exposure": self.exposure, "exclude": self.exclude}


@dataclass(frozen=True, eq=False)
class Answers:
    """The answers of one run."""

    pairs: list[tuple[RadiusCurve, Posterior]]
    document: Result  # of the pairs, in their order
    not_run: list[str]  # chosen shots without an answer, because the run was stopped
    pictures: dict[str, str]  # of groups, by name
    trials: dict[str, Checks] = field(default_factory=dict)  # simulations with the sliders' values, by shot


class Run:
    """A run while it lasts: how far it is, and whether it is to stop."""

    def __init__(self, names: Sequence[str]) -> None:
        self.records: dict[str, CurveRecord | None] = dict.fromkeys(names)  # each shot's answer so far, or None
        self.began = time.monotonic()
        self.working = False  # it has its turn among the runs of all visitors
        self.stopped = threading.Event()

    @property
    def ready(self) -> list[CurveRecord]:
        """The answers so far."""
        return [record for record in self.records.values() if record]

    @property
    def seconds(self) -> tuple[float, float | None]:
        """(s since the run began, s that are left by the shots so far; None before the first)"""
        passed = time.monotonic() - self.began
        done = len(self.ready)
        return passed, passed / done * (len(self.records) - done) if done else None


class Session:
    """The state of one visitor. The files are in a temporary folder, which is removed with the session."""

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors
        self.kept: dict[str, Posterior] = {}  # this visitor's answers, by their keys
        self.settings = PageSettings()
        self.link = token_urlsafe(16)  # secret: a page with it in its address opens this session
        self.lock = threading.RLock()  # held while the session is read or changed, but not while a run answers shots
        self.run: Run | None = None
        self._temporary = TemporaryDirectory(prefix="cavirheo-")
        self.folder = Path(self._temporary.name)
        self.uploads = self.folder / UPLOAD_FOLDER
        self.clear()

    def clear(self) -> None:
        """Remove all files and results; the settings stay."""
        shutil.rmtree(self.uploads, ignore_errors=True)
        self.uploads.mkdir()
        self.files: list[Path] = []
        # of each recording its latest camera, and its curve or why there is none
        self.measured: dict[Path, tuple[dict[str, Any], tuple[list[RadiusCurve], list[str]]]] = {}
        self.curves: list[RadiusCurve] = []  # of all files, read with the settings
        self.problems: list[str] = []  # files that could not be read
        self.answers: Answers | None = None
        self.kept.clear()
        if self.run:
            self.run.stopped.set()
        self.run = None

    def add(self, files: Sequence[Path], settings: PageSettings, *, copy: bool = False) -> None:
        """Move or copy the files into the session, and read them; unreadable ones are removed. Raises InputError: too
        many files, curves or frames, or a setting out of its domain."""
        limits = self.visitors.limits
        number = len(list(self.uploads.iterdir())) + len(files)
        if number > limits.files:
            message = f"{number} files; at most {limits.files} are read at once: start over with fewer, "
            raise InputError(message + "or put the shots of one material into one file", "app.too_many_files")
        taken = list[Path]()
        for path in files:
            taken.append(self._unused_path(path.name))
            (shutil.copyfile if copy else shutil.move)(path, taken[-1])
        files = [*self.files, *taken]
        try:
            curves, problems = self._read(files, settings)
            frames = sum(len(curve.time) for curve in curves)
            if len(curves) > limits.curves or frames > limits.frames:
                message = f"{len(curves)} shots with {frames} frames in all; at most {limits.curves} and "
                message += f"{limits.frames} at once: load fewer, or use the command line (cavirheo infer)"
                raise InputError(message, "app.too_many_frames")
            read = {curve.source for curve in curves}
            waits = None in (settings.fps, settings.um_per_px)  # a recording that lacks them stays until they are typed
            for path in taken:
                recording = pixels_of(path) or path  # a header file stands for the file of pixels beside it
                if recording.name in read or (waits and is_video(path)):
                    self.files.append(path)
            self.settings = settings
            self.curves = curves
            self.problems = problems
            self.answers = None
        finally:
            for path in {*taken} - {*self.files}:
                path.unlink()

    def _read(self, files: Sequence[Path], settings: PageSettings) -> tuple[list[RadiusCurve], list[str]]:
        """(curves, problems) of files."""
        recordings = [path for path in without_headers(files) if is_video(path)]
        if settings.exclude and len(recordings) > 1:
            several = f"exclude is of one recording, there are {len(recordings)}"
            raise InputError(f"{several}: `cavirheo measure` each with its own", "option.exclude")
        contents: list[str | RadiusCurve] = [path.name for path in files if not is_video(path)]
        failed = list[str]()
        camera = settings.camera
        for path in recordings:
            if path not in self.measured or self.measured[path][0] != camera:
                self.measured[path] = camera, self.visitors.measurer.read(self.uploads, [path.name], **camera)
            curves, problems = self.measured[path][1]
            contents += curves
            failed += [] if curves else problems
        options = settings.read_options | {"exclude": None if recordings else settings.exclude}  # a table refuses it
        curves, problems = self.visitors.reader.read(self.uploads, contents, **options)
        return curves, failed + problems

    @property
    def names(self) -> list[str]:
        """Names of the shots."""
        return [curve.name for curve in self.curves]

    def announce(self, names: Sequence[str]) -> Run:
        """Announce a run, which waits for its turn. Raises InputError: another one goes on."""
        going_on = self.run is not None and self.run.working
        require(not going_on, "the run before goes on: stop it, or wait for its end", "parallel.busy")
        self.run = Run(names)
        return self.run

    def command(self, answered: int) -> str:
        """The equivalent command line, and how many of the shots are answered if these are not all."""
        words = ["cavirheo", "infer", *(path.name for path in self.files)]
        for name in PAGE_FIELDS:
            value = getattr(self.settings, name)
            if value not in (None, getattr(PageSettings, name)):
                words += [option_of(name), *([] if value is True else [str(value)])]
        total = len(self.curves)
        return shlex.join(words) + (f" ({answered} of {total} shots)" if answered < total else "")

    def apply_settings(self, settings: PageSettings) -> None:
        """Set the settings; read the files again if these change the curves. Answers by other settings are put away: a
        run with those finds them again. Raises InputError."""
        before, now = ((each.read_options, each.camera) for each in (self.settings, settings))
        if self.files and before != now:
            self.curves, self.problems = self._read(self.files, settings)
        if settings != self.settings:
            self.answers = None
        self.settings = settings

    def find_answer(self, name: str | None) -> tuple[Answers, RadiusCurve, Posterior, CurveRecord]:
        """Return (all answers, curve, posterior, record) of a shot. Raises InputError: no answer."""
        if answers := self.answers:
            for pair, record in zip(answers.pairs, answers.document.rows, strict=True):
                if record.name == name:
                    return answers, *pair, record
        missing = f"{name} has no answer" if name and self.answers else "no answer yet"
        raise InputError(f"{missing}: infer first (step 3)", "app.no_answer")

    def infer(self, names: Sequence[str]) -> Answers:
        """Return the answers of the chosen shots, and keep them; after a stop no further shot is waited for. Raises
        InputError: no shots, another run goes on, or files or settings changed during the run."""
        with self.lock:
            settings, curves = self.settings, self.curves
            chosen = [curve for curve in curves if curve.name in names]
            require(bool(chosen), "no shots: load a file in step 1, and choose shots in step 2", "app.no_shots")
            run = self.run if self.run and not self.run.working else self.announce(names)
            run.working = True
        answered = dict[int, Posterior]()
        try:
            settings.analysis.check(chosen)
            with closing(self._answers(settings.analysis, chosen)) as flow:
                for index, answer in flow:
                    answered[index] = with_source_of(answer, chosen[index])
                    run.records[chosen[index].name] = curve_record(chosen[index], answered[index])
                    if run.stopped.is_set():
                        break
            pairs = [(chosen[index], answered[index]) for index in sorted(answered)]
            not_run = [curve.name for index, curve in enumerate(chosen) if index not in answered]
            document = result(pairs, self.command(len(pairs)))
            pooled = Answers(pairs, document, not_run, group_pictures(pairs, document, []))
        finally:
            with self.lock:
                self.run = None if self.run is run else self.run
        with self.lock:
            if self.curves is not curves or self.settings != settings:
                changed = "files or settings were changed while it ran: its answers are dropped; run it again"
                raise InputError(changed, "app.changed")
            self.answers = pooled
            return pooled

    def _answers(self, analysis: Analysis, curves: Sequence[RadiusCurve]) -> Flow[Posterior]:
        """(index of a curve, its answer), in the order in which they are ready; visitors with one file share one."""
        workers = max(cores() // len(curves), 1)

        def answer_one(curve: RadiusCurve) -> Posterior:
            key = analysis.key(curve)
            answer = self.visitors.shared.get(key)
            if answer is None:
                answer = run_on_any_core(partial(analysis.answer, curve, workers=workers))
            self.kept[key] = self.visitors.shared[key] = answer
            return answer

        return on_threads(answer_one, curves)

    def sliders(self, name: str) -> dict[str, dict[str, float] | None]:
        """The limits, step and start of each slider, in its unit; None for a parameter that the law lacks."""
        posterior = self.find_answer(name)[2]
        return {key: slider(posterior, key, factor) for key, (_, factor) in SLIDERS.items()}

    def what_if(self, name: str, values: Sequence[float | None]) -> Checks:
        """The checks of the answer with the sliders' values, kept beside the answer; failed ones hold the reason."""
        answers, curve, posterior, _ = self.find_answer(name)
        typed = {key: Number().read(v, key) for key, v in zip(SLIDERS, values, strict=True) if v is not None}
        changed = {key: value / SLIDERS[key][1] for key, value in typed.items()}
        answers.trials[name] = checks_with(curve, posterior, changed, self.settings.analysis)
        return answers.trials[name]

    def export(self) -> Path:
        """Return the path of the zip. Raises InputError: no current answers."""
        answers, base = self.answers, self.folder / "export"
        if answers is None:
            raise InputError("no answer yet: infer first (step 3)", "app.no_answer")
        folder, document = base / "cavirheo-result", answers.document
        shutil.rmtree(base, ignore_errors=True)
        for kind in ("processed", "simulated"):
            (folder / kind).mkdir(parents=True)
        write_report(folder, answers.pairs, document.model_copy(update={"notes": [*document.notes]}))
        for listing in folder.rglob(LIST_FILE):  # the list of files by run, which one run does not need
            listing.unlink()
        _write_curves(folder, answers)
        return Path(shutil.make_archive(str(self.folder / folder.name), "zip", base, folder.name))

    def close(self) -> None:
        self.clear()
        self._temporary.cleanup()

    def _unused_path(self, name: str) -> Path:
        """Return an unused path of this name in the visitor's folder, with a number if the name is taken."""
        to = self.uploads / name
        numbers = count(2)
        while to.exists():
            to = to.with_name(f"{short_name(Path(name).stem)} ({next(numbers)}){Path(name).suffix}")
        return to


def _write_curves(folder: Path, answers: Answers) -> None:
    """Write the processed and the simulated curves as CSV."""
    for number, (record, (curve, posterior)) in enumerate(zip(answers.document.curves, answers.pairs, strict=True), 1):
        safe_name = re.sub(r"[^\w.+-]+", "_", record.name).strip("_.")
        stem = short_name(f"{number:03}_{safe_name}")
        write_csv(folder / "processed" / f"{stem}.csv", curve)
        time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
        if time is not None and radius is not None:
            # leave out points so close to a frame that their times are equal in the digits of the CSV
            distinct = np.diff(time, prepend=-np.inf) > 1e-15
            place = folder / "simulated" / f"{stem}-{digits.simulation_name(posterior.method).replace(' ', '-')}.csv"
            write_csv(place, RadiusCurve(time[distinct], radius[distinct]), f"simulation of {record.name}")


class Visitors:
    """All sessions. Gradio gives each page a random name. Another page can open a session by its secret link only."""

    def __init__(self, limits: VisitorLimits) -> None:
        self.limits = limits
        self.reader = Reader(limits.read_seconds, processes=limits.readers)
        self.measurer = Reader(limits.film_seconds)  # separate: reading tables need not wait for a recording
        # answers of all visitors by their keys, while a session keeps them
        self.shared: WeakValueDictionary[str, Posterior] = WeakValueDictionary()
        self._lock = threading.RLock()
        self._pages: dict[str, Session] = {}  # session of each page, in the order of use
        self._left: dict[str, float] = {}  # of each page that left: when it is to be forgotten
        self.on_forget: Callable[[str], Any] = lambda name: None  # called with the name of a page that is forgotten

    @property
    def _sessions(self) -> list[Session]:
        """Each session once, the latest used first."""
        return list(dict.fromkeys(reversed(self._pages.values())))

    def session_for(self, name: str | None) -> Session:
        """Return the page's session, or a new one; beyond the limit, close the longest unused. Raises InputError."""
        if not name:
            raise InputError("no session: reload the page")
        with self._lock:
            self._left.pop(name, None)
            session = self._pages.pop(name, None) or Session(self)
            self._pages[name] = session
            for unused in self._sessions[self.limits.visitors :]:
                self._forget([page for page, other in self._pages.items() if other is unused])
            return session

    def reopen(self, name: str, link: str) -> Session | None:
        """Give the page of this name the session with this link, and return it; None if there is none."""
        with self._lock:
            session = next((session for session in self._sessions if session.link == link), None)
            if session:
                self._pages[name] = session
            return session and self.session_for(name)

    def leave(self, name: str) -> None:
        """Let `forget_absent` forget this page after a delay, unless it sends a request until then (a phone slept)."""
        with self._lock:
            self._left[name] = time.monotonic() + self.limits.absent_seconds

    def forget_absent(self) -> None:
        """Forget the pages that left; a session is closed with its last page. The server calls this regularly."""
        with self._lock:
            now = time.monotonic()
            self._forget([name for name, due in self._left.items() if due <= now])

    def _forget(self, names: Sequence[str]) -> None:
        for name in names:
            self._left.pop(name, None)
            session = self._pages.pop(name, None)
            self.on_forget(name)
            if session and session not in self._pages.values():
                session.close()

    def close(self) -> None:
        """Close all sessions."""
        with self._lock:
            self._forget([*self._pages])
