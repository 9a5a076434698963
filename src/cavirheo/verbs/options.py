"""The options of the command line, each defined once: a dataclass per group of options, which the verbs inherit.

The annotations are objects, not text (no `from __future__ import annotations`): typer reads them in the module of the
verb. Options without a panel are on the first screen of `--help`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option

from cavirheo.errors import InputError, parse_number, require
from cavirheo.writing.digits import elide

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.analysis import Analysis
    from cavirheo.inference.population import CommonErrors
    from cavirheo.io.shots import CurveSet
    from cavirheo.physics.bubble import Bubble
    from cavirheo.physics.media import Medium
    from cavirheo.verbs.run import Run

_MODELS = Path(__file__).parents[1] / "models"  # completion lists its files: reading the cards is too slow
INPUT = "Input"
MATERIAL = "Constants of the material"
BUBBLE = "Bubble, for experts"
INTERVAL = "Interval"
OUTPUT = "Output"
CLUSTER = "Cluster"


def argument(metavar: str, help: str, **keywords: Any) -> Any:
    """Return a positional argument."""
    return Argument(metavar=metavar, help=help, **keywords)


def option(help: str, panel: str | None = None, *names: str, **keywords: Any) -> Any:
    """Return an option in a panel of `--help`; without a panel, it is on the first screen."""
    return Option(*names, help=help, rich_help_panel=panel, **keywords)


def number(
    help: str, panel: str | None = None, *words: str, kind: Callable[[str], Any] = float, thousands: str = ","
) -> Any:
    """Return an option that takes a number or one of these words; without words, a number above 0. thousands: the marks
    that may separate thousands in it (`parse_number`)."""

    def parse(text: str) -> Any:
        if text in words:
            return text
        try:
            value: Any = kind(text) if kind is int else parse_number(text, "the number", thousands)
            if value is not None and (words or value > 0):
                return value
        except InputError as error:
            if error.code == "input.which_number":
                raise BadParameter(error.message) from None
        except ValueError:  # of int
            pass
        expected = f"a number or {' or '.join(map(repr, words))}" if words else "a number above 0"
        raise BadParameter(f"must be {expected}, got {elide(repr(text), 60)}")

    return option(help, panel, parser=parse, metavar=f"<{'|'.join((kind.__name__, *words))}>")


def folder(help: str) -> Any:
    """Return the option `-o` or `--out`, which takes a folder."""

    def parse_folder(text: object) -> Path:
        if not str(text).strip():
            raise BadParameter("a folder must have a name; leave the option out for the usual one")
        return Path(str(text))

    return option(help, None, "-o", "--out", parser=parse_folder, metavar="FOLDER")


# Shell completion of the values of options; nothing here imports a compiler, a network or the solver.


def _completer(words: Callable[[], Iterable[str]], separators: str = "") -> Callable[[str], list[str]]:
    """Return a completion by these words; if several may be given, it completes the text after the last separator."""

    def complete(incomplete: str) -> list[str]:
        start = max((incomplete.rfind(mark) for mark in separators), default=-1) + 1
        prefix = incomplete[:start]
        beginning = incomplete[start:]
        prefix += beginning[: len(beginning) - len(beginning.lstrip())]
        used = prefix.replace(",", " ").split() if "," in separators else []
        return [prefix + word for word in words() if word.startswith(beginning.strip()) and word not in used]

    return complete


def _laws() -> Iterable[str]:
    laws: Iterable[str] = resolve_name("cavirheo.physics.materials.LAWS")
    return laws


bubble_names = _completer(lambda: ("real", "field"), ",")
damage_names = _completer(lambda: ("none", "strain"), ",")
model_names = _completer(lambda: sorted(path.stem for path in _MODELS.glob("*.npz")))
medium_names = _completer(lambda: resolve_name("cavirheo.physics.media.MEDIA"))
sum_names = _completer(_laws, "+")
many_law_names = _completer(_laws, "+,")


def law_names(incomplete: str) -> list[str]:
    """Complete the laws, also as the next part of a sum, and auto."""
    return [*sum_names(incomplete), *_completer(lambda: ["auto"])(incomplete)]


Out = Annotated[Path, folder("folder for the results")]  # for documents: a run locks it; --replace belongs to it
ResumableOut = Annotated[Path, folder("folder, which may hold a part")]  # for work that a later call continues
Quiet = Annotated[bool, option("print errors only, no table and no progress", None, "--quiet")]
_MODEL = "shipped model (see `cavirheo models`), folder of a run of `train`, or its .npz file"
ModelName = Annotated[str, option(_MODEL, INTERVAL, "--model", autocompletion=model_names)]
REFERENCES = "CSV of published values, or sweeps of a rheometer, beside the answers; may be repeated"
_LAW = "a law of `cavirheo laws`; auto: a gel that may stiffen, or a liquid"
Material = Annotated[str | None, option(f"{_LAW}  [default: auto]", autocompletion=law_names)]
_FPS = "frames per second, of videos and of tables that number their frames"
Fps = Annotated[Any, number(_FPS, thousands=".,")]
UmPerPx = Annotated[Any, number("micrometres per pixel, of videos and of tables in pixels")]
Exclude = Annotated[str | None, option("frames of a video to leave out, such as '12,40-45' (the first is 1)", INPUT)]
Shots = Annotated[str | None, option("shots of every file, such as '1,4-7' (the first is 1)  [default: all]")]
_GROUP = "shots of one material; name: soft_1, soft_2 are soft; auto: those of a file, or all files of one shot"
Group = Annotated[Literal["auto", "file", "folder", "name", "none"], option(_GROUP)]
_STRETCH = "R_max/R_0; plateau: late radius as prior; free: no prior  [default: prior of the file]"
Stretch = Annotated[Any, number(_STRETCH, None, "plateau", "free")]
_WINDOW = "number of collapses to compare  [default: 3, or all if there are fewer]"
Window = Annotated[Any, number(_WINDOW, INPUT, "all", kind=int)]
ExactLaw = Annotated[bool, option("the bubble follows the law exactly (narrower intervals)", INTERVAL, "--exact-law")]
WantedPercent = Annotated[float, option("wanted half-width of the 90 % interval, % of the value", min=0.1, max=99.0)]
_SCHEDULER = "of a dask cluster: tcp://HOST:PORT  [default: the cores of this machine]"
Scheduler = Annotated[str | None, option(_SCHEDULER, CLUSTER)]
Slurm = Annotated[int | None, option("ask SLURM for so many jobs, as dask-jobqueue is set", CLUSTER, min=1)]
WallDistanceUm = Annotated[float | None, option("um to one rigid wall, instead of --confinement-inertia", BUBBLE)]
_TRUST = "I checked scale, frame rate and constants: report input warnings, but keep the verdict"
TrustInput = Annotated[bool, option(_TRUST, INPUT, "--trust-input")]
Seed = Annotated[int, option("of the random draws of the intervals", INTERVAL, min=0, max=2**64 - 1)]
_FILES = "measured R(t): .mat, .csv, .h5, .xlsx; or videos: .mp4, .tif, .cine, ...; a folder, or - for stdin"
_COLUMN = "table with a number (a concentration, ...) for each shot, file or group, or R_max: slope of the material"
_EXPOSURE = "exposure time of a frame, us, centred on its time: the simulation is blurred alike"
CONTENTS = "vapour: equilibrium (the field's model) or kinetic (condenses at a finite rate)"
_BUBBLE = "real: vapour condenses at a finite rate, damped by the surroundings; field: equilibrium, unbounded"
_MEDIUM = "named constants: water, bu2026, estrada2018, ...  [default: water, with those of the file]"
_ACCOMMODATION = "accommodation coefficient of kinetic contents, up to 10"
_SCALE_ERROR = "error of the radius scale that all shots of a group share, as a standard deviation, %"
_PICTURES = "draw pictures; --no-pictures is faster"


def shared_values(options: object, kind: Any) -> dict[str, Any]:
    """Return the values of the options that have the name of a field of the dataclass `kind`."""
    return {field.name: getattr(options, field.name) for field in fields(kind) if hasattr(options, field.name)}


@dataclass(kw_only=True)
class FileSettings:
    """Options that add to or select from measured files. Raises InputError: --shots is no list of numbers."""

    trust_input: TrustInput = False
    fps: Fps = None
    um_per_px: UmPerPx = None
    rmax_um: Annotated[Any, number("true R_max of the shots, um: rescales the radii")] = None
    shots: Shots = None
    group: Group = "auto"
    exposure_us: Annotated[Any, number(_EXPOSURE, INPUT)] = None
    column: Annotated[Path | None, option(_COLUMN, INPUT, readable=False)] = None

    def __post_init__(self) -> None:
        if self.shots is not None:
            from cavirheo.io.shots import shot_numbers

            shot_numbers(self.shots)


@dataclass(kw_only=True)
class Liquid:
    """Options for the constants of the medium around the bubble."""

    trust_input: TrustInput = False
    medium: Annotated[str | None, option(_MEDIUM, autocompletion=medium_names)] = None
    density: Annotated[float | None, option("density of the liquid or gel, kg/m3", MATERIAL)] = None
    sound_speed: Annotated[float | None, option("m/s", MATERIAL)] = None
    surface_tension: Annotated[float | None, option("N/m", MATERIAL)] = None
    pressure: Annotated[float | None, option("pressure far from the bubble, Pa", MATERIAL)] = None
    temperature: Annotated[float | None, option("temperature far from the bubble, K", MATERIAL)] = None

    @property
    def liquid(self) -> "Medium":
        """The medium of the options. Raises InputError: no such medium, or an impossible constant."""
        from cavirheo.physics.media import Medium, medium

        return medium(self.medium or "water", unusual=self.trust_input, **shared_values(self, Medium))

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the constants that the options give; with --medium, of all."""
        from cavirheo.physics.media import CONSTANTS

        return tuple(name for name in CONSTANTS if self.medium or getattr(self, name, None) is not None)


@dataclass(kw_only=True)
class BubbleOptions:
    """Options for the bubble: a named one, and values that replace those of the named one."""

    contents: Annotated[Literal["equilibrium", "kinetic"] | None, option(CONTENTS, BUBBLE)] = None
    accommodation: Annotated[Any, number(_ACCOMMODATION, BUBBLE, "free")] = None
    confinement_damping: Annotated[Any, number("2 pi (R_max^2/A) c/U_c of a tube around it", BUBBLE, "free")] = None
    confinement_inertia: Annotated[Any, number("R_max sum(s/d) over image bubbles", BUBBLE, "free")] = None
    wall_distance_um: WallDistanceUm = None
    vapour_excess: Annotated[Any, number("vapour at R_max above saturation, Pa", BUBBLE, "free")] = None
    bubble: Annotated[Literal["real", "field"] | None, option(_BUBBLE)] = None
    damage: Annotated[Literal["none", "strain"], option("softening of the gel", BUBBLE)] = "none"

    @property
    def bubbles(self) -> "tuple[Bubble, ...] | None":
        """The named bubbles, each with each damage and the given values; None if no option is given.

        Raises InputError: an unknown name, or impossible values.
        """
        from cavirheo.physics.bubble import DAMAGES, Bubble, bubbles_of

        damages = [word.strip() for word in self.damage.split(",")]
        message = f"--damage must be {', '.join(DAMAGES)}, got {self.damage!r}"
        require(set(damages) <= set(DAMAGES), message, "option.damage")
        wall = self.wall_distance_um and self.wall_distance_um * 1e-6
        values = shared_values(self, Bubble) | {"wall_distance": wall, "damage": None}
        values = {name: value for name, value in values.items() if value is not None}
        if wall:
            values.setdefault("confinement_inertia", 0.0)
        if self.bubble is None and not values and damages == ["none"]:
            return None
        names = "real" if self.bubble is None else self.bubble
        bubbles = [bubble for name in names.split(",") for bubble in bubbles_of(name.strip())]
        return tuple(replace(bubble, **{**values, "damage": damage}) for bubble in bubbles for damage in damages)


@dataclass(kw_only=True)
class SharedErrors:
    """Options for the errors that all shots of a group share, and for the rows on the screen."""

    scale_error: Annotated[float, option(_SCALE_ERROR, INTERVAL, min=0.0, max=20.0)] = 1.0
    rate_error: Annotated[float, option("the same of the frame rate, %", INTERVAL, min=0.0, max=20.0)] = 0.1
    density_error: Annotated[float, option("the same of the density, %", INTERVAL, min=0.0, max=20.0)] = 1.0
    pressure_error: Annotated[float, option("the same of the pressure, %", INTERVAL, min=0.0, max=20.0)] = 1.0
    every_shot: Annotated[bool, option("print a row for each shot, not for exceptions alone", OUTPUT, "--all")] = False

    @property
    def errors(self) -> "CommonErrors":
        """The errors as fractions. Raises InputError: one of them is below 0, or above 20 %."""
        from cavirheo.inference.population import CommonErrors

        per_cent = self.scale_error, self.rate_error, self.density_error, self.pressure_error
        return CommonErrors(*(0.01 * error for error in per_cent))


@dataclass(kw_only=True)
class Verb:
    """A command that writes documents into a folder, which it locks. Its fields are the values of its arguments and
    options; those of the last base class come first."""

    out: Out = Path("cavirheo-result")
    replace: Annotated[bool, option("write over the answers of another run in that folder", None, "--replace")] = False
    quiet: Quiet = False

    def __call__(self, run: "Run") -> None:
        """Run the command. Raises InputError, and typer.Exit with the exit status."""
        raise NotImplementedError


@dataclass(kw_only=True)
class PrintingVerb(Verb):
    """A verb with a document that can be printed."""

    json: Annotated[bool, option("print the JSON document instead of the table", None, "--json")] = False


@dataclass(kw_only=True)
class Pictures:
    """The option for pictures in the documents."""

    pictures: Annotated[bool, option(_PICTURES, OUTPUT, "--pictures/--no-pictures")] = True


@dataclass(kw_only=True)
class AnsweringVerb(PrintingVerb, Pictures, Liquid, FileSettings, BubbleOptions):
    """Options of all verbs that answer measured curves; those with names of fields of Analysis are its settings."""

    stretch: Stretch = None
    window: Window = None
    seed: Seed = 0

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the analysis of each curve. Raises InputError: impossible constants."""
        from cavirheo.inference.analysis import Analysis

        return shared_values(self, Analysis) | {"bubble": self.bubbles, "medium": self.liquid}

    def make_analysis(self) -> "Analysis":
        """Return the analysis of each curve. Raises InputError: settings that are impossible, alone or together."""
        from cavirheo.inference.analysis import Analysis

        return Analysis(**self.settings)

    def read_recordings(self, files: list[Path], exclude: str | None = None) -> "CurveSet":
        """Read the files by `read_shots` with these options. Raises InputError."""
        from cavirheo.io.shots import read_shots

        message = f"--exclude is of one recording, {len(files)} files were given: `cavirheo measure` each with its own"
        require(exclude is None or len(files) == 1, message, "option.exclude")
        exposure = self.exposure_us and self.exposure_us * 1e-6
        scale = self.rmax_um and self.rmax_um * 1e-6
        video = {"um_per_px": self.um_per_px, "exposure": exposure, "exclude": exclude}
        keywords: dict[str, Any] = {
            "density": self.liquid.density,
            "pressure": self.liquid.pressure,
            "shots": self.shots,
        }
        curve_set = read_shots(files, max_radius=scale, group=self.group, frame_rate_hz=self.fps, **keywords, **video)
        if exposure is None:
            return curve_set
        return curve_set._replace(curves=[curve.labelled(exposure_s=exposure) for curve in curve_set.curves])


@dataclass(kw_only=True)
class MeasuredFiles(AnsweringVerb):
    """Options of verbs that answer given files: files, excluded frames, and the scheduler."""

    files: Annotated[list[Path], argument("FILE...", _FILES, readable=False)]
    exclude: Exclude = None
    scheduler: Scheduler = None
    slurm: Slurm = None

    def read_curves(self, run: "Run", files: list[Path]) -> "list[RadiusCurve]":
        """Return all curves of the files, with their values of --column, and load the solver. Raises InputError: no
        curve, or a column that does not match the curves."""
        from cavirheo.physics.simulate import load_solver

        recordings = self.read_recordings(files, self.exclude)
        run.note_unreadable(recordings.problems)
        run.notes += recordings.remarks + recordings.hints
        curves = recordings.curves
        run.require_any(curves, "curve")
        if self.column is not None:
            from cavirheo.column import with_column

            curves = with_column(curves, self.column)
        load_solver()
        return curves


@dataclass(kw_only=True)
class Inference(AnsweringVerb):
    """Options that `infer` and `watch` share."""

    material: Material = None
    model: ModelName = "posterior"
    exact_law: ExactLaw = False

    @property
    def settings(self) -> dict[str, Any]:
        """As `AnsweringVerb.settings`."""
        return super().settings | {"discrepancy": not self.exact_law}
