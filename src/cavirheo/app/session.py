"""What one visitor has (files, curves, settings, answers), the limits, and which visitors there are."""

from __future__ import annotations

import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from threading import RLock, Timer
from typing import Any, TypeVar

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.companions.published_values import add_to_groups, published, values_of
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, number_of, require
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.assumptions import check_stretch
from cavirheo.inference.model import shipped
from cavirheo.io.shots import check_max_radius, with_maximum_notes
from cavirheo.io.subprocess_reader import Reader
from cavirheo.io.videos import Camera, history, parse_camera
from cavirheo.parallel import Stoppable
from cavirheo.physics.media import Medium, medium
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import Published
from cavirheo.reporting.material import kept_material_of
from cavirheo.reporting.record import Pairs, Result
from cavirheo.video.frames import is_video
from cavirheo.video.measurement import Measurement
from cavirheo.workflow.store import Store
from cavirheo.writing import digits
from cavirheo.writing.document import short_name

_Value = TypeVar("_Value")
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
    readers: int = 3  # whose files are read at the same time
    film_seconds: float = 120.0  # to measure a recording
    film_mb: float = 500.0  # of its frames
    visitors: int = 100
    absent: float = 600.0  # s after which one who closed the page is forgotten


@dataclass(frozen=True)
class PageSettings:
    """What the page asks for, as the options of `cavirheo infer`; None: not given. Raises InputError: what it does not
    take, and a model that is not shipped (no file of this machine is opened for a visitor)."""

    medium: str = "water"
    density: float | None = None
    sound_speed: float | None = None
    surface_tension: float | None = None
    pressure: float | None = None
    temperature: float | None = None
    rmax_um: float | None = None
    stretch: float | str | None = None  # or "free"
    window: int | None = None
    group: str = "auto"  # whose shots are one material
    model: str = DEFAULT
    material: str | None = None  # as `infer` has it: all laws, or the one that a model or the network alone knows
    bubble: str = "real"
    verify: str = "auto"
    trust_input: bool = False  # scale, frame rate and medium are as they are given, however odd they look

    def __post_init__(self) -> None:
        object.__setattr__(self, "trust_input", bool(self.trust_input))
        if self.stretch != "free":
            check_stretch(self.stretch)
        unknown = f"unknown model {self.model!r}; known here: {', '.join(shipped())}"
        require(self.model in shipped(), unknown, "app.unknown_model")
        if self.model in shipped("point"):
            object.__setattr__(self, "material", None)
            object.__setattr__(self, "bubble", "field")
        _ = self.analysis
        if self.material == "auto":  # which is what none asks for
            object.__setattr__(self, "material", None)

    @classmethod
    def of(cls, values: Sequence[Any]) -> tuple[PageSettings, dict[str, str]]:
        """From what stands in the fields of the page, in their order; why it cannot be, by field, "" for all together:
        settings are the usual ones then."""
        settings, wrong = dict[str, Any](), dict[str, str]()
        vouch = {"trust_input": dict(zip((field_.name for field_ in fields(cls)), values, strict=True))["trust_input"]}
        for field_, value in zip(fields(cls), values, strict=True):
            try:
                numeric, name = "float" in str(field_.type) and value != "free", field_.name.replace("_", " ")
                single: dict[str, Any] = {field_.name: number_of(value, name) if numeric else value or None}
                _, settings = cls(**(vouch | single)).read_options, settings | single
            except InputError as error:
                wrong[field_.name] = str(error)
        try:
            return cls() if wrong else cls(**settings), wrong
        except InputError as error:
            return cls(), {"": str(error)}

    @property
    def liquid(self) -> Medium:
        """Raises InputError."""
        names = ("density", "sound_speed", "surface_tension", "pressure", "temperature")
        return medium(self.medium, unusual=self.trust_input, **{name: getattr(self, name) for name in names})

    @property
    def read_options(self) -> dict[str, Any]:
        """The options of `read_shots`. Raises InputError."""
        liquid, scale = self.liquid, None if self.rmax_um is None else self.rmax_um * 1e-6
        check_max_radius(scale)
        return {"density": liquid.density, "pressure": liquid.pressure, "max_radius": scale, "group": self.group}

    @property
    def analysis(self) -> Analysis:
        """What is asked of each curve. Raises InputError."""
        names = ("model", "material", "bubble", "stretch", "window", "trust_input", "verify")
        return Analysis(medium=self.liquid, **{name: getattr(self, name) for name in names})


@dataclass(eq=False)
class Clip:
    """A recording.

    measurement: with all frames. used: without those that are left out. frame: the number of that which is looked at.
    curve, command: the history that is confirmed, and the options of the command line that it has then.
    """

    path: Path
    camera: Camera = field(default_factory=Camera)
    measurement: Measurement | None = None
    used: Measurement | None = None
    frame: int = 1
    curve: RadiusCurve | None = None
    command: str = ""

    @property
    def measured(self) -> Measurement:
        """With all frames. Raises InputError: it is not measured."""
        if self.measurement is None:
            raise InputError("measure the recording first (step 1)", "app.not_measured")
        return self.measurement

    @property
    def exclude(self) -> str:
        """The frames that are left out: "12, 40-45"."""
        return str(self.used.options.get("exclude", "")) if self.used else ""

    @property
    def excluded(self) -> Bools:
        """(n,) frames that are left out."""
        return np.asarray((self.used or self.measured).track.flags == "excluded")

    @property
    def index(self) -> int:
        """Of the frame that is looked at, in arrays."""
        return self.frame - self.measured.first

    @property
    def options(self) -> str:
        """Of `cavirheo infer`, that mean the same."""
        return self.camera.options + f" --exclude {self.exclude.replace(' ', '')}" * bool(self.exclude)

    def history(self, *, sheet: bool = False) -> RadiusCurve:
        """As `read_curves` gives it. Raises InputError: not measured."""
        return with_maximum_notes(history(self.used or self.measured, self.path, sheet=sheet))

    def camera_of(self, texts: Sequence[str]) -> tuple[Camera, list[str]]:
        """Frame rate, scale and exposure; why it cannot be measured so, field by field, empty where it can."""
        unscaled = self.measurement is not None and self.measurement.um_per_px.value is None
        return parse_camera(texts, self.path.suffix.lower(), unscaled=unscaled)

    def unready(self, *texts: str) -> list[str]:
        """Why its curve cannot be confirmed so, field by field: numbers of the camera, then the list of frames."""
        new, wrong = self.camera_of(texts[:3])
        changed = ["changed since: measure again" * (now != old) for now, old in zip(new, self.camera, strict=True)]
        return [mistake or change for mistake, change in zip(wrong, changed, strict=True)] + self.leave_out(texts[3])

    def leave_out(self, listed: str) -> list[str]:
        """These frames, "12, 40-45", and no others; or say why not. A list half typed counts so far."""
        listed = listed.strip(" ,-–")
        try:
            self.used = self.measurement and self.measurement.without(listed) if listed else self.measurement
        except InputError as error:
            return [str(error)]
        return [""]

    def toggle(self) -> None:
        """Leave the shown frame out, or bring it back. Raises InputError: no frame would be left."""
        excluded = self.excluded
        excluded[self.index] ^= True
        (wrong,) = self.leave_out(digits.ranges((np.flatnonzero(excluded) + self.measured.first).tolist()))
        require(not wrong, wrong, "video.exclude")


@dataclass(frozen=True, eq=False)
class Answers:
    """What one run has answered."""

    pairs: list[tuple[RadiusCurve, Posterior]]
    document: Result  # of the pairs, in their order
    not_run: list[str]  # chosen shots that a stop left out
    request: tuple[PageSettings, Mapping[str, float]]  # that they stand on, with the densities that were typed
    fits: dict[str, Posterior] = field(default_factory=dict)  # conventional fits that were made since, by name
    trials: dict[str, Checks] = field(default_factory=dict)  # simulations with the sliders' values, by name
    # times, s, and the lower and the upper radius, m, of the draws' simulations, by name
    bands: dict[str, tuple[Floats, Floats, Floats] | None] = field(default_factory=dict)


class Session:
    """One visitor. The files lie in a folder that goes with the session."""

    def __init__(
        self,
        limits: VisitorLimits,
        reader: Reader,
        measurer: Reader | None = None,
        store: Store | None = None,
        zips: Store | None = None,
    ) -> None:
        self.limits, self.reader, self.settings = limits, reader, PageSettings()
        self.store, self.zips = store or Store(), zips or Store(most=1)  # of all visitors
        self.keys: set[str] = set()  # of what this visitor has there
        self.measurer = measurer or reader  # its own, so that nobody's table waits for a film
        self.sent: list[str] = []  # uploads that are not looked at yet
        self.refusal = ""  # why the last thing that was asked was not done
        self.link = token_urlsafe(16)  # whoever knows it comes back here
        self.lock = RLock()  # held while anything here is read or changed, never while shots are worked on
        self.runs = Stoppable()  # on shots
        self._temporary = TemporaryDirectory(prefix="cavirheo-")
        self.folder = Path(self._temporary.name)
        self.clear()

    def clear(self) -> None:
        """As if just come."""
        shutil.rmtree(self.folder / YOURS, ignore_errors=True)
        (self.folder / YOURS).mkdir()
        self.films: dict[str, Clip] = {}  # recordings by the names of their files
        self.film = ""  # the name of that which is looked at
        self.files: list[Path] = []
        self.curves: list[RadiusCurve] = []  # of all files, as the settings have them read
        self.materials: dict[str, str] = {}  # by shot, as the visitor typed them
        self.densities: Mapping[str, float] = {}  # kg/m3 by shot, as the visitor typed them
        self.published: list[dict[str, Published]] = []  # values of other methods, by set, of each upload
        self.problems: list[str] = []  # files that could not be read
        self.answers: Answers | None = None
        self.previews: dict[str, CurveRecord | None] = {}  # in a run: of each shot what is known so far

    def add(self, files: Sequence[Path], settings: PageSettings, *, copy: bool = False) -> None:
        """Take the files over (or copy them) and read them; unreadable ones are not kept, recordings wait in `films`.
        Raises InputError: too many files, curves or frames, or a setting out of its domain."""
        number = len(list((self.folder / YOURS).iterdir())) + len(files)
        message = f"{number} files; at most {self.limits.files} are read at once"
        remedy = "start over with fewer, or put the shots of one material into one file"
        require(number <= self.limits.files, f"{message}: {remedy}", "app.too_many_files")
        taken = list[Path]()
        for path in files:
            taken.append(self._free(path.name))
            (shutil.copyfile if copy else shutil.move)(path, taken[-1])
        films = {path.name: Clip(path) for path in taken if is_video(path)}
        try:
            tables = [path for path in taken if path.name not in films]
            if tables or not films:
                self.take([*self.files, *tables], settings)
            self.films |= films
        finally:
            for path in {*taken} - {*self.files, *(film.path for film in self.films.values())}:
                path.unlink()
        if self.film not in self.recordings:
            self.film = next(iter(self.recordings), "")

    @property
    def recordings(self) -> list[str]:
        """Names of the films that can be measured; the header of a .mraw beside it is none."""
        return [name for name in self.films if f"{name.removesuffix('.cihx')}.mraw" not in self.films]

    @property
    def current(self) -> Clip:
        """The film that is looked at; an empty one if there is none."""
        return self.films.get(self.film) or Clip(Path())

    @property
    def waiting(self) -> list[str]:
        """Those that are not confirmed."""
        return [name for name in self.recordings if self.films[name].curve is None]

    def take(self, files: Sequence[Path], settings: PageSettings) -> None:
        """Read these instead of what was read; those that cannot be read are left out. Raises InputError: too much."""
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
        """Each shot as its own density has it read, which counts where a file has no seconds."""
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
        """The settings, and the densities that were typed, by shot."""
        return self.settings, self.densities

    def settings_of(self, shot: str) -> PageSettings:
        """With the density of its material, if one was typed."""
        return replace(self.settings, density=self.densities[shot]) if shot in self.densities else self.settings

    def grouped(self, pairs: Pairs) -> list[tuple[RadiusCurve, Posterior]]:
        """Curves as shots of the materials that were typed, or else of those that their files say."""
        groups = {curve.name: (curve.group, curve.group_source) for curve, _ in pairs}
        for curve in self.curves:
            groups[curve.name] = curve.group, curve.group if self.materials else curve.group_source
        groups |= {shot: (name, name) for shot, name in self.materials.items()}
        return [(curve.with_group(*groups[curve.name]), answer) for curve, answer in pairs]

    def command(self, settings: PageSettings) -> str:
        """The command line that means the same; of several files the recordings have their options after it."""
        words = ["cavirheo", "infer", *(path.name for path in self.files)]
        for name, value in vars(settings).items():
            if value not in (None, getattr(PageSettings, name)):
                words += [f"--{name.replace('_', '-')}", *([] if value is True else [str(value)])]
        films = [film for film in self.films.values() if film.path in self.files]
        messages = [film.command if len(self.files) == 1 else f" ({film.path.name}:{film.command})" for film in films]
        return shlex.join(words) + "".join(messages)

    def prepare(self, settings: PageSettings, densities: Mapping[str, float] | None = None) -> None:
        """Read the files again if these settings, or the densities of shots, change what they mean. Raises InputError:
        also a density that no medium has."""
        for density in set((densities or {}).values()):
            _ = replace(settings, density=density).liquid
        densities = self.densities if densities is None else dict(densities)
        if self.files and (settings.read_options != self.settings.read_options or densities != self.densities):
            self.curves, _ = self._read(self.files, settings, densities)
        self.settings, self.densities = settings, densities

    def publish(self, paths: Sequence[Path]) -> None:
        """Values of other methods stand beside the answers: of files for `cavirheo compare`, or of the sweeps of one
        material for `cavirheo rheometer`. Raises InputError."""
        values = published(self.reader.ask(paths, (values_of, *map(str, paths))))
        add_to_groups(self.answers.document.groups if self.answers else [], values)
        self.published.append(values)

    @property
    def stale(self) -> bool:
        """Whether there are answers, but to other settings."""
        return self.answers is not None and self.answers.request != self.request

    def find(self, name: str | None) -> tuple[Answers, RadiusCurve, Posterior, CurveRecord]:
        """All answers, and the curve of this name with its own. Raises InputError: it is not answered, or not so."""
        require(not self.stale, "settings changed: run again (step 3)", "app.stale")
        if self.answers:
            for pair, record in zip(self.answers.pairs, self.answers.document.curves, strict=True):
                if record.name == name:
                    return self.answers, *pair, record
        raise InputError("no answer to check: infer first (step 3)", "app.no_answer")

    def once(self, store: Store, key: str, function: Callable[[], _Value]) -> _Value:
        """As `Store.once`: a class with one demo file waits for one answer, which goes with the last who has it."""
        self.keys.add(key)
        return store.once(key, function)

    def close(self) -> None:
        self.runs.stopped.set()
        self._temporary.cleanup()

    def _free(self, name: str) -> Path:
        """A path of this name in the visitor's folder, numbered where the name is taken."""
        to, numbers = self.folder / YOURS / name, count(2)
        while to.exists():
            to = to.with_name(f"{short_name(Path(name).stem)} ({next(numbers)}){Path(name).suffix}")
        return to


class Visitors:
    """The sessions by the page's own random name; nobody gets another's but by its link, which is as random."""

    def __init__(self, limits: VisitorLimits) -> None:
        self.limits, self.reader = limits, Reader(limits.seconds, processes=limits.readers)
        self.measurer = Reader(limits.film_seconds, at_once=False)
        self.store, self.zips, self._lock = Store(most=200), Store(most=3), RLock()  # of a shot two answers
        self._sessions: dict[str, Session] = {}  # by their links, in the order of use
        self._links: dict[str, str] = {}  # by the names of pages
        self._requests = Counter[str]()  # how often each page asked for anything
        self.forgotten: Callable[[str], Any] = lambda name: None  # told the name of each page that is

    def of(self, name: str | None) -> Session:
        """The session of this name, new if there is none; the one unused for longest makes room. Raises InputError."""
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

    def back(self, name: str, link: str) -> Session | None:
        """The session that the page of this name comes back to, by its link."""
        with self._lock:
            if link not in self._sessions:
                return None
            self._links[name] = link
            return self.of(name)

    def answers(self, link: str) -> Answers | None:
        """Of the session with this link."""
        with self._lock:
            return self._sessions[link].answers if link in self._sessions else None

    def leave(self, name: str) -> None:
        """Forget this page after a while, and with the last of its pages a session, unless it asks for something again
        (a phone that slept)."""
        timer = Timer(self.limits.absent, self._forget, (name, self._requests[name]))
        timer.daemon = True
        timer.start()

    def _forget(self, name: str, requests: int) -> None:
        with self._lock:
            if self._requests[name] == requests:
                link = self._links.pop(name, "")
                del self._requests[name]
                self.forgotten(name)
                if link in self._sessions and link not in self._links.values():
                    self._close(link)

    def end(self, session: Session) -> None:
        """Close it, and forget the answers and zips that no other visitor has."""
        session.close()
        with self._lock:
            shared = set().union(*(visitor.keys for visitor in self._sessions.values()))
        for store in (self.store, self.zips):
            store.remove(session.keys - shared)
        kept_material_of.cache_clear()

    def _close(self, link: str) -> None:
        self.end(self._sessions.pop(link))
        for name in [name for name, of in self._links.items() if of == link]:
            self.forgotten(name)
            del self._links[name], self._requests[name]

    def close(self) -> None:
        """Forget all."""
        with self._lock:
            while self._sessions:
                self._close(next(iter(self._sessions)))
        self.reader.close()
        self.measurer.close()
