"""What may be set of the analysis of recordings: each setting is declared once, with its help, unit and check. The
options of the command line, the fields of the browser app and its endpoint are made of these.

The annotations are objects, not text (no `from __future__ import annotations`): typer reads them in the module of a
verb. Options without a panel are on the first screen of `--help`. Nothing here imports a compiler, a network or the
solver before it is needed: `--help` is quick.
"""

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from typer import Argument, BadParameter, Option

from cavirheo.errors import InputError, brief

if TYPE_CHECKING:
    from cavirheo.inference.analysis import Analysis
    from cavirheo.physics.bubble import Bubble
    from cavirheo.physics.media import Medium

INPUT = "Input"
MATERIAL = "Constants of the material"
BUBBLE = "Bubble, for experts"
INTERVAL = "Interval"
OUTPUT = "Output"
CLUSTER = "Cluster"


def argument(metavar: str, help: str, **keywords: Any) -> Any:
    return Argument(metavar=metavar, help=help, **keywords)


def option(help: str, panel: str | None = None, *names: str, **keywords: Any) -> Any:
    """Return an option in a panel of `--help`; without a panel, it is on the first screen."""
    return Option(*names, help=help, rich_help_panel=panel, **keywords)


@dataclass(eq=False)
class Number:
    """Reads a finite number in a range, or one of `words`."""

    words: tuple[str, ...] = ()
    kind: type[Any] = float
    above: float = -inf
    least: float = -inf
    most: float = inf

    def __post_init__(self) -> None:
        self.__name__ = self.kind.__name__  # which older versions of typer need

    @property
    def range(self) -> str:
        """The range in words."""
        if self.above > -inf:
            return f" above {self.above:g}" + (f", up to {self.most:g}" if self.most < inf else "")
        if self.least > -inf:
            return f" from {self.least:g} " + (f"to {self.most:g}" if self.most < inf else "up")
        return ""

    def read(self, value: Any, name: str = "the value") -> Any:
        """The number of a text or a number. Raises InputError, which names it."""
        if value in self.words:
            return value
        with suppress(TypeError, ValueError, OverflowError):
            number = self.kind(value) if isinstance(value, str) else value
            if isfinite(number) and self.above < number and self.least <= number <= self.most:
                return number
        kind = "a whole number" if self.kind is int else "a number"
        expected = " or ".join([kind + self.range, *map(repr, self.words)])
        comma = ": use a decimal point, and no mark between thousands" if "," in str(value) else ""
        raise InputError(f"{name} must be {expected}, got {brief(value)}{comma}", "option.number")

    def __call__(self, text: str) -> Any:
        """As `read`, for the command line."""
        try:
            return self.read(text)
        except InputError as error:
            raise BadParameter(error.message) from None


def number(
    help: str, panel: str | None = None, *names: str, words: tuple[str, ...] = (), metavar: str = "", **domain: Any
) -> Any:
    """Return an option that is a `Number` of these words and this domain."""
    parser = Number(words, **domain)
    kinds = "|".join([parser.kind.__name__ + parser.range, *words])
    return option(help, panel, *names, parser=parser, metavar=metavar or f"<{kinds}>")


SIZES_UM: dict[str, Any] = {"least": 0.01, "most": 5e4}  # of bubbles: RADIUS of parameters.py
_MODEL = "shipped model (see `cavirheo models`), folder of a run of `train`, or its .npz file"
_LAW = "a law of `cavirheo laws`; auto: a gel that may stiffen, or a liquid that may thin  [default: auto]"
_FPS = "frames per second, of videos and of tables that number their frames"
Fps = Annotated[Any, number(_FPS, above=0)]
UmPerPx = Annotated[Any, number("micrometres per pixel, of videos and of tables in pixels", above=0)]
Exclude = Annotated[str | None, option("frames of a video to leave out, such as '12,40-45' (the first is 1)", INPUT)]
Shots = Annotated[str | None, option("shots of every file, such as '1,4-7' (the first is 1)  [default: all]")]
_GROUP = "shots of one material; name: soft_1, soft_2 are soft; auto: those of a file, or all files of one shot"
Group = Annotated[Literal["auto", "file", "folder", "name", "none"], option(_GROUP)]
_STRETCH = "R_max/R_0; plateau: late radius as prior; free: no prior  [default: prior of the file]"
_WINDOW = "number of collapses to compare  [default: 3, or all if there are fewer]"
ExactLaw = Annotated[bool, option("the bubble follows the law exactly (narrower intervals)", INTERVAL, "--exact-law")]
_WALL = "um to one rigid wall, instead of --confinement-inertia"
_TRUST = "I checked scale, frame rate and constants: report input warnings, but keep the verdict"
Seed = Annotated[int, number("of the random draws of the intervals", INTERVAL, kind=int, least=0)]
_EXPOSURE = "exposure time of a frame, us, centred on its time: the simulation is blurred alike"
ExposureUs = Annotated[Any, number(_EXPOSURE, INPUT, above=0)]
_CONTENTS = "vapour: equilibrium (the field's model) or kinetic (condenses at a finite rate)"
_BUBBLE = "real: vapour condenses at a finite rate, damping and inertia of walls; field: equilibrium, unbounded"
MEDIUM = "named constants: water, bu2026, estrada2018, ..."
_DAMPING = "2 pi (R_max^2/A) c/U_c of a tube around it"
_FREE = ("free",)
_ACCOMMODATION = "accommodation coefficient of kinetic contents, up to 10"


def shared_values(options: object, kind: Any) -> dict[str, Any]:
    """Return the values of the options that have the name of a field of the dataclass `kind`."""
    return {field.name: getattr(options, field.name) for field in fields(kind) if hasattr(options, field.name)}


@dataclass(frozen=True, kw_only=True)
class Liquid:
    """Options for the constants of the medium around the bubble."""

    trust_input: Annotated[bool, option("the constants are meant, however unusual", MATERIAL, "--trust-input")] = False
    medium: Annotated[str | None, option(f"{MEDIUM}  [default: water]")] = None
    density: Annotated[float | None, number("density of the liquid or gel, kg/m3", MATERIAL, above=0)] = None
    sound_speed: Annotated[float | None, number("m/s", MATERIAL, above=0)] = None
    surface_tension: Annotated[float | None, number("N/m", MATERIAL)] = None
    pressure: Annotated[float | None, number("pressure far from the bubble, Pa", MATERIAL, above=0)] = None
    temperature: Annotated[float | None, number("temperature far from the bubble, K", MATERIAL, above=0)] = None

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


@dataclass(frozen=True, kw_only=True)
class BubbleOptions:
    """Options for the bubble: a named one, and values that replace those of the named one."""

    contents: Annotated[Literal["equilibrium", "kinetic"] | None, option(_CONTENTS, BUBBLE)] = None
    accommodation: Annotated[Any, number(_ACCOMMODATION, BUBBLE, words=_FREE)] = None
    confinement_damping: Annotated[Any, number(_DAMPING, BUBBLE, words=_FREE)] = None
    confinement_inertia: Annotated[Any, number("R_max sum(s/d) over image bubbles", BUBBLE, words=_FREE)] = None
    wall_distance_um: Annotated[float | None, number(_WALL, BUBBLE, above=0)] = None
    vapour_excess: Annotated[Any, number("vapour at R_max above saturation, Pa", BUBBLE, words=_FREE)] = None
    bubble: Annotated[Literal["real", "field"] | None, option(_BUBBLE)] = None
    damage: Annotated[Literal["none", "strain"], option("softening of the gel", BUBBLE)] = "none"

    @property
    def bubble_values(self) -> dict[str, Any]:
        """The fields of a `Bubble` that the options give, besides damage."""
        from cavirheo.physics.bubble import Bubble

        wall = self.wall_distance_um and self.wall_distance_um * 1e-6
        values = shared_values(self, Bubble) | {"wall_distance": wall, "damage": None}
        values = {name: value for name, value in values.items() if value is not None}
        return {"confinement_inertia": 0.0, **values} if wall else values

    @property
    def full_bubble(self) -> "Bubble | None":
        """The named bubble with the given values; None if no option is given. Raises InputError: impossible values."""
        from cavirheo.physics.bubble import bubble_of

        values = self.bubble_values
        if self.bubble is None and not values and self.damage == "none":
            return None
        return replace(bubble_of(self.bubble or "real"), **{**values, "damage": self.damage})


@dataclass(frozen=True, kw_only=True)
class Settings(Liquid, BubbleOptions):
    """How measured curves are read and analysed; values with names of fields of Analysis are its settings. Raises
    InputError: `shots` is no list of numbers."""

    trust_input: Annotated[bool, option(_TRUST, INPUT, "--trust-input")] = False
    medium: Annotated[str | None, option(f"{MEDIUM}  [default: water; measured files may state others]")] = None
    fps: Fps = None
    um_per_px: UmPerPx = None
    rmax_um: Annotated[Any, number("true R_max of the shots, um: rescales the radii", **SIZES_UM)] = None
    shots: Shots = None
    group: Group = "auto"
    exposure_us: ExposureUs = None
    stretch: Annotated[Any, number(_STRETCH, words=("plateau", "free"))] = None
    window: Annotated[Any, number(_WINDOW, INPUT, words=("all",), kind=int)] = None
    seed: Seed = 0
    exact_law = False  # for verbs without this option

    def __post_init__(self) -> None:
        from cavirheo.io.shots import shot_numbers

        shot_numbers(self.shots)

    @property
    def exposure(self) -> float | None:
        """Exposure time of a frame, s."""
        return self.exposure_us and self.exposure_us * 1e-6

    @property
    def read_options(self) -> dict[str, Any]:
        """The options of `read_shots`. Raises InputError."""
        from cavirheo.io.shots import check_camera

        max_radius = self.rmax_um and self.rmax_um * 1e-6
        check_camera(self.fps, self.um_per_px)
        liquid = self.liquid
        camera = {"frame_rate_hz": self.fps, "um_per_px": self.um_per_px, "exposure": self.exposure}
        table = {"density": liquid.density, "pressure": liquid.pressure, "max_radius": max_radius}
        return table | camera | {"group": self.group, "shots": self.shots, "unusual": self.trust_input}

    @property
    def analysis_options(self) -> dict[str, Any]:
        """The settings of `analysis`. Raises InputError."""
        from cavirheo.inference.analysis import Analysis

        options = {"bubble": self.full_bubble, "medium": self.liquid, "discrepancy": not self.exact_law}
        return shared_values(self, Analysis) | options

    @property
    def analysis(self) -> "Analysis":
        """The analysis of each curve. Raises InputError: settings that are impossible, alone or together."""
        from cavirheo.inference.analysis import Analysis

        return Analysis(**self.analysis_options)


@dataclass(frozen=True, kw_only=True)
class InferOptions(Settings):
    """Settings of `infer`."""

    material: Annotated[str | None, option(_LAW)] = None
    model: Annotated[str, option(_MODEL, INTERVAL)] = "posterior"
    exact_law: ExactLaw = False


def checked(kind: type[Settings], name: str, value: Any) -> Any:
    """The value of a field, which may be typed as a text if it is a number. Raises InputError, which names it."""
    for declaration in get_type_hints(kind, include_extras=True)[name].__metadata__:
        if isinstance(declaration.parser, Number):
            return declaration.parser.read(value, name)
    return value
