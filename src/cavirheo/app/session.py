"""The session of one visitor (files, curves, settings, answers), its limits, and all sessions of the server."""

from __future__ import annotations

import shlex
import shutil
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from threading import RLock
from typing import Any, TypeVar

import numpy as np

from cavirheo.arrays import Bools
from cavirheo.companions.published_values import add_to_groups, published, read_values
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, parse_number, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.assumptions import check_stretch
from cavirheo.inference.cards import shipped
from cavirheo.io.files import without_headers
from cavirheo.io.shots import check_camera, check_max_radius, with_maximum_notes
from cavirheo.io.subprocess_reader import Reader
from cavirheo.io.videos import Camera, history, parse_camera
from cavirheo.parallel import Stoppable
from cavirheo.physics.media import CONSTANTS, Medium, medium
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import Published
from cavirheo.reporting.material import cached_material_of
from cavirheo.reporting.record import Pairs, Result
from cavirheo.video.frames import is_video
from cavirheo.video.measurement import Measurement
from cavirheo.workflow.store import Store
from cavirheo.writing import digits
from cavirheo.writing.document import short_name

_Value = TypeVar("_Value")
UPLOAD_FOLDER = "your files"  # the folder of a visitor, which names the group of single-shot files


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
    film_mb: float = 500.0  # MB, of the frames of a recording
    visitors: int = 100
    absent_seconds: float = 600.0  # s from closing the page until the visitor is forgotten


@dataclass(frozen=True)
class PageSettings:
    """The settings of the page, as options of `cavirheo infer`; None: not given. Raises InputError: a value that
    `infer` rejects, or a model that is not shipped (a visitor must not open files of this machine)."""

    medium: str = "water"
    density: float | None = None
    sound_speed: float | None = None
    surface_tension: float | None = None
    pressure: float | None = None
    temperature: float | None = None
    fps: float | None = None  # of tables
    um_per_px: float | None = None  # of tables
    rmax_um: float | None = None
    stretch: float | str | None = None  # or "free"
    window: int | None = None
    group: str = "auto"  # which shots are of one material
    model: str = DEFAULT
    material: str | None = None  # None: the default family, or the law of the network
    bubble: str = "real"
    trust_input: bool = False  # scale, frame rate and medium are right even if they look odd

    def __post_init__(self) -> None:
        object.__setattr__(self, "trust_input", bool(self.trust_input))
        if self.stretch != "free":
            check_stretch(self.stretch)
        networks = shipped("point")
        if self.model not in (DEFAULT, *networks):
            message = f"unknown model {self.model!r}; known here: {', '.join((DEFAULT, *networks))}"
            raise InputError(message, "app.unknown_model")
        if self.model in networks:
            object.__setattr__(self, "material", None)
            object.__setattr__(self, "bubble", "field")
        _ = self.analysis
        if self.material == "auto":  # it means the same as None
            object.__setattr__(self, "material", None)

    @classmethod
    def from_page(cls, values: Sequence[Any]) -> tuple[PageSettings, dict[str, str]]:
        """Return (settings, error messages by field) from the values of the page's fields, in their order. The key ""
        is for an error of the values in combination. If there is any error, the settings are the defaults."""
        settings, errors = dict[str, Any](), dict[str, str]()
        vouch = {"trust_input": dict(zip((field_.name for field_ in fields(cls)), values, strict=True))["trust_input"]}
        for field_, value in zip(fields(cls), values, strict=True):
            try:
                numeric, name = "float" in str(field_.type) and value != "free", field_.name.replace("_", " ")
                marks = ".," if name == "fps" else ","
                single: dict[str, Any] = {field_.name: parse_number(value, name, marks) if numeric else value or None}
                _, settings = cls(**(vouch | single)).read_options, settings | single
            except InputError as error:
                errors[field_.name] = str(error)
        try:
            return cls() if errors else cls(**settings), errors
        except InputError as error:
            return cls(), {"": str(error)}

    @property
    def liquid(self) -> Medium:
        """The medium of these settings. Raises InputError."""
        names = ("density", "sound_speed", "surface_tension", "pressure", "temperature")
        return medium(self.medium, unusual=self.trust_input, **{name: getattr(self, name) for name in names})

    @property
    def read_options(self) -> dict[str, Any]:
        """The options of `read_shots`. Raises InputError."""
        liquid, scale = self.liquid, None if self.rmax_um is None else self.rmax_um * 1e-6
        check_max_radius(scale)
        options = {"density": liquid.density, "pressure": liquid.pressure, "max_radius": scale, "group": self.group}
        check_camera(self.fps, self.um_per_px)
        return options | {"frame_rate_hz": self.fps, "um_per_px": self.um_per_px}

    @property
    def analysis(self) -> Analysis:
        """The analysis of each curve. Raises InputError."""
        names = ("model", "material", "bubble", "stretch", "window", "trust_input")
        given = [name for name in CONSTANTS if self.medium != "water" or getattr(self, name, None) is not None]
        return Analysis(medium=self.liquid, given=given, **{name: getattr(self, name) for name in names})


@dataclass(eq=False)
class Clip:
    """A recording.

    measurement: of all frames. selection: without the excluded frames. shown_frame: the number of the shown frame.
    curve, confirmed_options: the confirmed radius history, and its command-line options when it was confirmed.
    """

    path: Path
    camera: Camera = field(default_factory=Camera)
    measurement: Measurement | None = None
    selection: Measurement | None = None
    shown_frame: int = 1
    curve: RadiusCurve | None = None
    confirmed_options: str = ""

    @property
    def measured(self) -> Measurement:
        """The measurement of all frames. Raises InputError: the recording is not measured."""
        if self.measurement is None:
            raise InputError("measure the recording first (step 1)", "app.not_measured")
        return self.measurement

    @property
    def excluded_text(self) -> str:
        """The excluded frames as text: "12, 40-45"."""
        return str(self.selection.options.get("exclude", "")) if self.selection else ""

    @property
    def excluded(self) -> Bools:
        """(n,) True for excluded frames."""
        return np.asarray((self.selection or self.measured).track.flags == "excluded")

    @property
    def shown_index(self) -> int:
        """The index of the shown frame in arrays."""
        return self.shown_frame - self.measured.first

    @property
    def options(self) -> str:
        """The options of `cavirheo infer` with the same effect."""
        return self.camera.options + f" --exclude {self.excluded_text.replace(' ', '')}" * bool(self.excluded_text)

    def history(self, *, sheet: bool = False) -> RadiusCurve:
        """Return the radius history, as `read_curves` does. Raises InputError: not measured."""
        return with_maximum_notes(history(self.selection or self.measured, self.path, sheet=sheet))

    def read_camera(self, texts: Sequence[str]) -> tuple[Camera, list[str]]:
        """Return (frame rate, scale and exposure; for each field, why it cannot be used, or "")."""
        unscaled = self.measurement is not None and self.measurement.um_per_px.value is None
        return parse_camera(texts, self.path.suffix.lower(), unscaled=unscaled)

    def confirm_errors(self, *texts: str) -> list[str]:
        """Return for each field why the curve cannot be confirmed, or "": three of the camera, then the frames."""
        new, errors = self.read_camera(texts[:3])
        changed = ["changed since: measure again" * (now != old) for now, old in zip(new, self.camera, strict=True)]
        return [error or change for error, change in zip(errors, changed, strict=True)] + self.set_excluded(texts[3])

    def set_excluded(self, listed: str) -> list[str]:
        """Exclude only these frames, "12, 40-45"; return [error message or ""]. A trailing comma is ignored."""
        listed = listed.strip(" ,-–")
        try:
            self.selection = self.measurement and self.measurement.excluding(listed) if listed else self.measurement
        except InputError as error:
            return [str(error)]
        return [""]

    def toggle_excluded(self) -> None:
        """Exclude the shown frame, or include it again. Raises InputError: no measured frame would be left."""
        excluded = self.excluded
        excluded[self.shown_index] ^= True
        (error,) = self.set_excluded(digits.number_ranges((np.flatnonzero(excluded) + self.measured.first).tolist()))
        require(not error, error, "video.exclude")


@dataclass(frozen=True, eq=False)
class Answers:
    """The answers of one run."""

    pairs: list[tuple[RadiusCurve, Posterior]]
    document: Result  # of the pairs, in their order
    not_run: list[str]  # chosen shots without an answer, because the run was stopped
    request: tuple[PageSettings, Mapping[str, float]]  # the settings of the run, and the typed densities
    fits: dict[str, Posterior] = field(default_factory=dict)  # conventional fits made after the run, by shot
    trials: dict[str, Checks] = field(default_factory=dict)  # simulations with the sliders' values, by shot
    # (times in s, lower radius in m, upper radius in m) of the band of the draws' simulations, by shot


class Session:
    """The state of one visitor. The files are in a temporary folder, which is removed with the session."""

    def __init__(
        self,
        limits: VisitorLimits,
        reader: Reader,
        measurer: Reader | None = None,
        store: Store | None = None,
        zips: Store | None = None,
    ) -> None:
        self.limits, self.reader, self.settings = limits, reader, PageSettings()
        self.store, self.zips = store or Store(), zips or Store(capacity=1)  # shared by all visitors
        self.keys: set[str] = set()  # keys of this visitor's values in these two stores
        self.measurer = measurer or reader  # separate: reading tables need not wait for a recording
        self.pending_uploads: list[str] = []  # uploads that are not read yet
        self.error_message = ""  # error message of the last event
        self.link = token_urlsafe(16)  # secret: a page with it in its address opens this session
        self.lock = RLock()  # held while the session is read or changed, but not while a run answers shots
        self.runs = Stoppable()  # computations on shots
        self._temporary = TemporaryDirectory(prefix="cavirheo-")
        self.folder = Path(self._temporary.name)
        self.clear()

    def clear(self) -> None:
        """Remove all files and results; the settings stay."""
        shutil.rmtree(self.folder / UPLOAD_FOLDER, ignore_errors=True)
        (self.folder / UPLOAD_FOLDER).mkdir()
        self.films: dict[str, Clip] = {}  # recordings by the names of their files
        self.film_name = ""  # the name of the shown recording
        self.files: list[Path] = []
        self.curves: list[RadiusCurve] = []  # of all files, read with the settings
        self.materials: dict[str, str] = {}  # by shot, as the visitor typed them
        self.densities: Mapping[str, float] = {}  # kg/m3 by shot, as the visitor typed them
        self.published: list[dict[str, Published]] = []  # for each upload: values of other methods, by set
        self.problems: list[str] = []  # files that could not be read
        self.answers: Answers | None = None
        self.so_far: dict[str, CurveRecord | None] = {}  # during a run: each shot's answer so far, or None

    def add(self, files: Sequence[Path], settings: PageSettings, *, copy: bool = False) -> None:
        """Move or copy the files into the session, and read them; unreadable ones are removed. Videos go to `films`.
        Raises InputError: too many files, curves or frames, or a setting out of its domain."""
        number = len(list((self.folder / UPLOAD_FOLDER).iterdir())) + len(files)
        message = f"{number} files; at most {self.limits.files} are read at once"
        remedy = "start over with fewer, or put the shots of one material into one file"
        require(number <= self.limits.files, f"{message}: {remedy}", "app.too_many_files")
        taken = list[Path]()
        for path in files:
            taken.append(self._unused_path(path.name))
            (shutil.copyfile if copy else shutil.move)(path, taken[-1])
        films = {path.name: Clip(path) for path in taken if is_video(path)}
        try:
            tables = [path for path in taken if path.name not in films]
            if tables or not films:
                self.set_files([*self.files, *tables], settings)
            self.films |= films
        finally:
            for path in {*taken} - {*self.files, *(film.path for film in self.films.values())}:
                path.unlink()
        if self.film_name not in self.film_names:
            self.film_name = next(iter(self.film_names), "")

    @property
    def film_names(self) -> list[str]:
        """Names of the recordings that can be measured; the header of a .mraw beside it is left out."""
        return [path.name for path in without_headers(film.path for film in self.films.values())]

    @property
    def current_clip(self) -> Clip:
        """The shown recording; an empty Clip if there is none."""
        return self.films.get(self.film_name) or Clip(Path())

    @property
    def unconfirmed(self) -> list[str]:
        """Names of the recordings that are not confirmed."""
        return [name for name in self.film_names if self.films[name].curve is None]

    def set_files(self, files: Sequence[Path], settings: PageSettings) -> None:
        """Read these files instead of all others, and drop the answers. Raises InputError: too many shots or frames."""
        curves, problems = self._read(files, settings, self.densities)
        limits, frames = self.limits, sum(len(curve.time) for curve in curves)
        message = f"{len(curves)} shots with {frames} frames in all; at most {limits.curves} and {limits.frames}"
        remedy = "load fewer, or use the command line (cavirheo infer)"
        fine = len(curves) <= limits.curves and frames <= limits.frames
        require(fine, f"{message} at once: {remedy}", "app.too_many_frames")
        read = {curve.source for curve in curves}
        self.files = [path for path in files if path.name in read or path in self.files]
        self.settings, self.curves, self.problems, self.answers = settings, curves, problems, None

    def _read(
        self, files: Sequence[Path], settings: PageSettings, densities: Mapping[str, float]
    ) -> tuple[list[RadiusCurve], list[str]]:
        """Read each shot with its own density, which matters for files without times in seconds: (curves, problems)."""
        confirmed = {film.path: film.curve for film in self.films.values()}
        sources = [confirmed.get(path) or path for path in files]
        curves, problems = self.reader.read(sources, **settings.read_options)
        for density in set(densities.values()):
            reread, _ = self.reader.read(sources, **replace(settings, density=density).read_options)
            by_name = {curve.name: curve for curve in reread if densities.get(curve.name) == density}
            curves = [by_name.get(curve.name, curve) for curve in curves]
        return curves, problems

    @property
    def request(self) -> tuple[PageSettings, Mapping[str, float]]:
        """The settings, and the typed densities, kg/m3, by shot."""
        return self.settings, self.densities

    def settings_of(self, shot: str) -> PageSettings:
        """Return the settings of a shot, with its own density if one was typed."""
        return replace(self.settings, density=self.densities[shot]) if shot in self.densities else self.settings

    def regroup(self, pairs: Pairs) -> list[tuple[RadiusCurve, Posterior]]:
        """Return the pairs with each curve in the group of its typed material, or else in the group of its file."""
        groups = {curve.name: (curve.group, curve.group_source) for curve, _ in pairs}
        for curve in self.curves:
            groups[curve.name] = curve.group, curve.group if self.materials else curve.group_source
        groups |= {shot: (name, name) for shot, name in self.materials.items()}
        return [(curve.with_group(*groups[curve.name]), answer) for curve, answer in pairs]

    def command(self, settings: PageSettings) -> str:
        """Return the equivalent command line; with several files, the options of recordings follow in parentheses."""
        words = ["cavirheo", "infer", *(path.name for path in self.files)]
        for name, value in vars(settings).items():
            if value not in (None, getattr(PageSettings, name)):
                words += [f"--{name.replace('_', '-')}", *([] if value is True else [str(value)])]
        films = [film for film in self.films.values() if film.path in self.files]
        messages = [
            film.confirmed_options if len(self.files) == 1 else f" ({film.path.name}:{film.confirmed_options})"
            for film in films
        ]
        return shlex.join(words) + "".join(messages)

    def apply_settings(self, settings: PageSettings, densities: Mapping[str, float] | None = None) -> None:
        """Set the settings and the densities of shots; read the files again if these change the curves. Raises
        InputError: also for a density that no medium has."""
        for density in set((densities or {}).values()):
            _ = replace(settings, density=density).liquid
        densities = self.densities if densities is None else dict(densities)
        if self.files and (settings.read_options != self.settings.read_options or densities != self.densities):
            self.curves, _ = self._read(self.files, settings, densities)
        self.settings, self.densities = settings, densities

    def add_published(self, paths: Sequence[Path]) -> None:
        """Add values of other methods to the answers' groups, from files for `cavirheo compare`, or from the sweeps of
        one material for `cavirheo rheometer`. Raises InputError."""
        groups, problems = self.answers.document.groups if self.answers else [], list[InputError]()
        for values in published(self.reader.ask(paths, (read_values, *map(str, paths)))):
            try:
                add_to_groups(groups, values)
                self.published.append(values)
            except InputError as error:  # the other values are added
                problems.append(error)
        if problems:
            raise problems[0]

    @property
    def stale(self) -> bool:
        """Whether there are answers, but with other settings or densities."""
        return self.answers is not None and self.answers.request != self.request

    def find_answer(self, name: str | None) -> tuple[Answers, RadiusCurve, Posterior, CurveRecord]:
        """Return (all answers, curve, posterior, record) of a shot. Raises InputError: no answer, or a `stale` one."""
        require(not self.stale, "settings changed: run again (step 3)", "app.stale")
        if self.answers:
            for pair, record in zip(self.answers.pairs, self.answers.document.curves, strict=True):
                if record.name == name:
                    return self.answers, *pair, record
        raise InputError("no answer to check: infer first (step 3)", "app.no_answer")

    def compute_once(self, store: Store, key: str, function: Callable[[], _Value]) -> _Value:
        """As `Store.get_or_compute`: visitors with one file share one value, which is removed with the last of them."""
        self.keys.add(key)
        return store.get_or_compute(key, function)

    def close(self) -> None:
        self.runs.stopped.set()
        self._temporary.cleanup()

    def _unused_path(self, name: str) -> Path:
        """Return an unused path of this name in the visitor's folder, with a number if the name is taken."""
        to, numbers = self.folder / UPLOAD_FOLDER / name, count(2)
        while to.exists():
            to = to.with_name(f"{short_name(Path(name).stem)} ({next(numbers)}){Path(name).suffix}")
        return to


class Visitors:
    """All sessions. Gradio gives each page a random name. Another page can open a session by its secret link only."""

    def __init__(self, limits: VisitorLimits) -> None:
        self.limits, self.reader = limits, Reader(limits.read_seconds, processes=limits.readers)
        self.measurer = Reader(limits.film_seconds, prestart=False)
        self.store, self.zips, self._lock = Store(capacity=200), Store(capacity=3), RLock()  # two answers per shot
        self._sessions: dict[str, Session] = {}  # by their links, in the order of use
        self._links: dict[str, str] = {}  # link of each page's session, by the name of the page
        self._requests = Counter[str]()  # number of requests of each page
        self._left: dict[str, tuple[float, int]] = {}  # of each page that left: when it is due, and its requests
        self.on_forget: Callable[[str], Any] = lambda name: None  # called with the name of a page that is forgotten

    def session_for(self, name: str | None) -> Session:
        """Return the page's session, or a new one; beyond the limit, close the longest unused. Raises InputError."""
        if not name:
            raise InputError("no session: reload the page")
        with self._lock:
            earlier = self._sessions.pop(self._links.get(name, ""), None)
            session = earlier or Session(self.limits, self.reader, self.measurer, self.store, self.zips)
            self._sessions[session.link], self._links[name] = session, session.link
            self._requests[name] += 1
            while len(self._sessions) > self.limits.visitors:
                self._close(next(iter(self._sessions)))
            return session

    def reopen(self, name: str, link: str) -> Session | None:
        """Give the page of this name the session with this link, and return it; None if there is none."""
        with self._lock:
            if link not in self._sessions:
                return None
            self._links[name] = link
            return self.session_for(name)

    def leave(self, name: str) -> None:
        """Let `forget_absent` forget this page after a delay, unless it sends another request until then (a phone that
        slept)."""
        with self._lock:
            self._left[name] = time.monotonic() + self.limits.absent_seconds, self._requests[name]

    def forget_absent(self) -> None:
        """Forget the pages that left; a session is closed with its last page. The server calls this regularly."""
        with self._lock:
            now = time.monotonic()
            for name in [name for name, (due, _) in self._left.items() if due <= now]:
                if self._left.pop(name)[1] == self._requests[name]:
                    link = self._links.pop(name, "")
                    del self._requests[name]
                    self.on_forget(name)
                    if link in self._sessions and link not in self._links.values():
                        self._close(link)

    def end_session(self, session: Session) -> None:
        """Close a session, and remove the answers and zips that no other session uses."""
        session.close()
        with self._lock:
            shared = set().union(*(visitor.keys for visitor in self._sessions.values()))
        for store in (self.store, self.zips):
            store.remove(session.keys - shared)
        cached_material_of.cache_clear()

    def _close(self, link: str) -> None:
        self.end_session(self._sessions.pop(link))
        for name in [name for name, other in self._links.items() if other == link]:
            self.on_forget(name)
            del self._links[name], self._requests[name]

    def close(self) -> None:
        """Close all sessions, and end the processes that read files."""
        with self._lock:
            while self._sessions:
                self._close(next(iter(self._sessions)))
        self.reader.close()
        self.measurer.close()
