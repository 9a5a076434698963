"""What one visitor has (files, curves, settings, answers), the limits, and which visitors there are."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, RLock, Timer
from typing import Any

from cavirheo.app.apart import Reader
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import check_level
from cavirheo.inference.model import DEFAULT, shipped
from cavirheo.physics.media import Medium, medium
from cavirheo.posterior import Posterior
from cavirheo.reporting.record import CurveRecord, Result

YOURS = "your files"  # the folder of a visitor, which names the group of single-shot files


@dataclass(frozen=True)
class VisitorLimits:
    """What one visitor may load, and how many visitors there are."""

    file_mb: float = 50.0
    files: int = 50
    curves: int = 400
    frames: int = 400_000
    full: int = 100  # shots in one run with full uncertainty
    seconds: float = 20.0  # to read the files
    visitors: int = 100
    absent: float = 600.0  # s after which one who closed the page is forgotten


@dataclass(frozen=True)
class PageSettings:
    """What the page asks for, as the options of `cavirheo infer`; None: not given.

    Raises:
        InputError: an unknown level of `verify`, or a model that is not shipped: no file of this machine is opened
            for a visitor.
    """

    medium: str = "water"
    density: float | None = None
    sound_speed: float | None = None
    surface_tension: float | None = None
    pressure: float | None = None
    temperature: float | None = None
    rmax_um: float | None = None
    stretch: float | None = None
    window: int | None = None
    model: str = DEFAULT
    verify: str = "none"

    def __post_init__(self) -> None:
        check_level(self.verify)
        if self.model not in shipped():
            known = ", ".join(shipped())
            raise InputError(f"unknown model {self.model!r}; known here: {known}", "app.unknown_model")

    @property
    def liquid(self) -> Medium:
        """Raises InputError."""
        names = ("density", "sound_speed", "surface_tension", "pressure", "temperature")
        return medium(self.medium, **{name: getattr(self, name) for name in names})

    @property
    def reading(self) -> dict[str, float | None]:
        """The options of `read_shots`. Raises InputError."""
        liquid = self.liquid
        scale = None if self.rmax_um is None else self.rmax_um * 1e-6
        return {"density": liquid.density, "pressure": liquid.pressure, "max_radius": scale}

    def command(self, files: Sequence[Path]) -> str:
        """The command line that means the same for these files."""
        words = ["cavirheo", "infer", *(path.name for path in files)]
        for name, value in vars(self).items():
            if value != getattr(PageSettings, name):
                words += [f"--{name.replace('_', '-')}", str(value)]
        return shlex.join(words)


@dataclass(frozen=True, eq=False)
class Answers:
    """What one run has answered."""

    pairs: list[tuple[RadiusCurve, Posterior]]
    document: Result  # of the pairs, in their order
    not_run: list[str]  # chosen shots that a stop left out
    fits: dict[str, Posterior] = field(default_factory=dict)  # conventional fits that were made since, by name


class Session:
    """One visitor. The files lie in a folder that goes with the session.

    Attributes: limits; reader; settings; curves (of all files, as the settings have them read); problems (files that
    could not be read); answers (None before there are any); lock (held while anything of it is read or changed, never
    while shots are worked on); busy (held by a run); stopped (ends a run); abandoned (shots that were worked on when a
    run was stopped).
    """

    def __init__(self, limits: VisitorLimits, reader: Reader) -> None:
        self.limits, self.reader, self.settings = limits, reader, PageSettings()
        self.files: list[Path] = []
        self.curves: list[RadiusCurve] = []
        self.problems: list[str] = []
        self.answers: Answers | None = None
        self.lock, self.busy, self.stopped = RLock(), Lock(), Event()
        self.abandoned: set[Future[Any]] = set()
        self._temporary = TemporaryDirectory(prefix="cavirheo-")
        self.folder = Path(self._temporary.name)
        (self.folder / YOURS).mkdir()

    def add(self, files: Sequence[Path], settings: PageSettings, *, copy: bool = False) -> None:
        """Take the files over (or copy them) and read them; those that cannot be read are not kept.

        Raises:
            InputError: too many files, curves or frames, or a setting out of its domain.
        """
        if (count := len(self.files) + len(files)) > self.limits.files:
            raise InputError(
                f"{count} files; at most {self.limits.files} are read at once: start over with fewer, or put the "
                "shots of one material into one file",
                "app.too_many_files",
            )
        mine, read = [], set()
        for path in files:
            mine.append(self._free(path.name))
            (shutil.copyfile if copy else shutil.move)(path, mine[-1])
        try:
            curves, problems = self.reader.read([*self.files, *mine], **settings.reading)
            self._check(curves)
            read = {curve.source for curve in curves}
        finally:
            for path in mine:
                if path.name not in read:
                    path.unlink()
        self.files += [path for path in mine if path.name in read]
        self.problems += [problem for problem in problems if problem not in self.problems]
        self.settings, self.curves, self.answers = settings, curves, None

    def prepare(self, settings: PageSettings) -> None:
        """Read the files again if these settings change what they mean. Raises InputError."""
        if self.files and settings.reading != self.settings.reading:
            self.curves, _ = self.reader.read(self.files, **settings.reading)
        if settings != self.settings:
            self.settings, self.answers = settings, None

    def find(self, name: str | None) -> tuple[Answers, RadiusCurve, Posterior, CurveRecord]:
        """All answers, and the curve of this name with its own. Raises InputError: it is not answered."""
        if self.answers:
            for pair, record in zip(self.answers.pairs, self.answers.document.curves, strict=True):
                if record.name == name:
                    return self.answers, *pair, record
        raise InputError("no answer to check: infer first (step 3)", "app.no_answer")

    def clear(self) -> None:
        """As if just come."""
        for path in self.files:
            path.unlink(missing_ok=True)
        self.files, self.curves, self.problems, self.answers = [], [], [], None

    def close(self) -> None:
        self.stopped.set()
        self._temporary.cleanup()

    def _free(self, name: str) -> Path:
        """A path of this name in the visitor's folder, numbered where the name is taken."""
        to, number = self.folder / YOURS / name, 1
        while to.exists():
            number += 1
            to = to.with_name(f"{Path(name).stem} ({number}){Path(name).suffix}")
        return to

    def _check(self, curves: list[RadiusCurve]) -> None:
        frames = sum(len(curve.time) for curve in curves)
        if len(curves) > self.limits.curves or frames > self.limits.frames:
            raise InputError(
                f"{len(curves)} shots with {frames} frames in all; the page takes at most {self.limits.curves} shots "
                f"and {self.limits.frames} frames at once: load fewer, or use the command line (cavirheo infer)",
                "app.too_many_frames",
            )


class Visitors:
    """The sessions by the page's own random name; nobody gets another's."""

    def __init__(self, limits: VisitorLimits) -> None:
        self.limits, self.reader = limits, Reader(limits.seconds)
        self._lock = RLock()
        self._sessions: dict[str, Session] = {}
        self._leaving: dict[str, Timer] = {}

    def of(self, name: str) -> Session:
        """The session of this name, new if there is none; the one unused for longest makes room. Raises InputError."""
        if not name:
            raise InputError("no session: reload the page")
        with self._lock:
            if timer := self._leaving.pop(name, None):
                timer.cancel()
            session = self._sessions.pop(name, None) or Session(self.limits, self.reader)
            self._sessions[name] = session  # last in the order of use
            while len(self._sessions) > self.limits.visitors:
                self._sessions.pop(next(iter(self._sessions))).close()
            return session

    def leave(self, name: str) -> None:
        """Forget this one after a while, unless something is asked for it again (a phone that slept)."""
        with self._lock:
            if name in self._sessions and name not in self._leaving:
                timer = self._leaving[name] = Timer(self.limits.absent, self._forget, (name,))
                timer.daemon = True
                timer.start()

    def _forget(self, name: str) -> None:
        with self._lock:
            if self._leaving.pop(name, None) and (session := self._sessions.pop(name, None)):
                session.close()

    def close(self) -> None:
        """Forget all."""
        with self._lock:
            for timer in self._leaving.values():
                timer.cancel()
            for session in self._sessions.values():
                session.close()
            self._sessions, self._leaving = {}, {}
        self.reader.close()
