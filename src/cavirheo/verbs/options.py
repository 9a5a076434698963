"""The options that verbs share, each written once; those of a kind become one argument: `liquid`, `run`, ..."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from cavirheo.errors import InputError, require
from cavirheo.verbs.run import Reading, Run

if TYPE_CHECKING:
    from cavirheo.physics.media import Medium as Liquid
    from cavirheo.posterior import BubbleModel as Bubble
else:
    Liquid = Bubble = Any

Curves = Annotated[
    list[Path],
    Argument(
        readable=False,
        help="measured R(t): .mat, .csv, .h5, .xlsx; or recordings: .mp4, .tif, .cine, ...; a folder, or - for stdin",
    ),
]
ModelName = Annotated[str, Option("--model", help="shipped model (see `cavirheo models`) or a path to an .onnx file")]
Out = Annotated[Path, Option("-o", "--out", help="folder for the results")]
Verify = Annotated[str, Option(help="map: the posterior's maximum; full: draws weighted by full simulations; none")]
_AUTO = (
    "auto: draws weighted by simulations, as few as can be trusted; full: by more; map: the posterior's maximum; none"
)
VerifyAuto = Annotated[str, Option(help=_AUTO)]
ExactLaw = Annotated[
    bool, Option("--exact-law", help="--verify: no discrepancy between law and bubble, narrower intervals")
]
Seed = Annotated[int, Option(help="of the draws behind the intervals", min=0, max=2**64 - 1)]
Pictures = Annotated[bool, Option("--pictures/--no-pictures", help="draw the curves; without, it is faster")]
_PAPER = "paper: each curve and group also as PDF, SVG and PNG (300 dpi), 84 and 174 mm wide"
Figures = Annotated[str | None, Option(help=_PAPER)]
Quiet = Annotated[bool, Option("--quiet", help="no table and no progress: errors alone")]
_TRUST = "I have checked scale, frame rate and constants: doubts are said, the verdict stays"
TrustInput = Annotated[bool, Option("--trust-input", help=_TRUST)]
Exclude = Annotated[str | None, Option(help="frames of a recording to leave out, '12,40-45': from 1")]
UmPerPx = Annotated[float | None, Option(help="micrometres per pixel of a recording")]
_BLUR = "of a frame, us, centred on its time: --verify blurs the simulation as the camera"
_GROUP = "shots of one material: file, folder, name (soft_1, soft_2), none, or auto: a file, or single-shot files"
Group = Annotated[str, Option(help=_GROUP)]
Contents = Annotated[
    str, Option(help="of the bubble: equilibrium (the field's model), or kinetic (vapour condenses at a finite rate)")
]
Material = Annotated[str | None, Option(help="a law of `cavirheo laws`, or auto  [default: nhkv]")]
KnownStretch = Annotated[float | None, Option(help="R_max/R_0 if known; inferred otherwise")]
ReadWindow = Annotated[int | None, Option(help="collapses that are read and compared  [default: 3]", min=1)]
EitherContents = Annotated[
    str, Option(help="of the bubble: equilibrium (the field's model), kinetic, or auto: both, the evidence chooses")
]
WallDistanceUm = Annotated[float | None, Option(help="of one rigid wall, instead of --wall-inertia")]
Shots = Annotated[str | None, Option(help="of every file, '1,4-7': from 1 in its order  [default: all]")]
_WANTED = "half of the 90 % interval that is wanted, of the value"
WantedPercent = Annotated[float, Option(help=_WANTED, min=0.1, max=99.0)]
_COLUMN = "table of shots, files or groups and one number each (a concentration, ...): the material's slope over it"
Column = Annotated[Path | None, Option(help=_COLUMN, readable=False)]
_SCHEDULER = "dask: tcp://HOST:PORT, or slurm:FILE.toml  [default: the cores of this machine]"
Scheduler = Annotated[str | None, Option(help=_SCHEDULER)]
FROM_OPTIONS: Any = None  # default of an argument of a verb that is made of the options of its kind
_Number = float | None
_KINDS: dict[str, dict[str, tuple[Any, Any]]] = {  # argument: its options, each with type and default
    "liquid": {
        "medium": (Annotated[str, Option(help="named constants: water, bu2026, estrada2018, ...")], "water"),
        "density": (Annotated[_Number, Option(help="of the liquid or gel, kg/m3")], None),
        "sound_speed": (Annotated[_Number, Option(help="m/s")], None),
        "surface_tension": (Annotated[_Number, Option(help="N/m")], None),
        "pressure": (Annotated[_Number, Option(help="far from the bubble, Pa")], None),
        "temperature": (Annotated[_Number, Option(help="far from the bubble, K")], None),
        "trust_input": (TrustInput, False),
    },
    "reading": {
        "rmax_um": (Annotated[_Number, Option(help="true R_max of the shots, um: rescales the radii")], None),
        "shots": (Shots, None),
        "frame_rate_hz": (
            Annotated[_Number, Option(help="1/s, of recordings and of files that number their frames")],
            None,
        ),
        "um_per_px": (UmPerPx, None),
        "exclude": (Exclude, None),
        "exposure_us": (Annotated[_Number, Option(help=_BLUR)], None),
        "group": (Group, "auto"),
        "trust_input": (TrustInput, False),
    },
    "bubble": {
        "contents": (EitherContents, "equilibrium"),
        "accommodation": (Annotated[str | None, Option(help="of kinetic contents, up to 10  [default: free]")], None),
        "damage": (
            Annotated[str, Option(help="none, first-rebound or strain: what gives the law another modulus and R_0")],
            "none",
        ),
        "wall_inertia": (Annotated[str, Option(help="R_max sum(s/d) over image bubbles; or free")], "0"),
        "wall_distance_um": (WallDistanceUm, None),
        "vapour_excess": (Annotated[str, Option(help="vapour at R_max above saturation, Pa; or free")], "0"),
        "wall_radiation": (Annotated[str, Option(help="2 pi (R_max^2/A) c/U_c of a tube around; or free")], "0"),
    },
    "run": {
        "json": (Annotated[bool, Option("--json", help="the document on stdout instead of the table")], False),
        "quiet": (Quiet, False),
    },
}


def with_kinds(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb whose arguments `liquid`, `reading`, `bubble` and `run`, if it has them, are given by their options.

    Numbers that are not finite are refused for every verb alike.
    """
    takes = inspect.signature(verb, eval_str=True).parameters
    kinds = {kind: _KINDS[kind] for kind in takes if kind in _KINDS}
    parameters: dict[str, inspect.Parameter] = {}
    for parameter in takes.values():
        for name, (annotation, default) in kinds.get(parameter.name, {}).items():
            parameters[name] = parameter.replace(name=name, annotation=annotation, default=default)
        if parameter.name not in kinds:
            parameters[parameter.name] = parameter

    @functools.wraps(verb)
    def run(**given: Any) -> None:
        for name, value in given.items():
            for one in value if isinstance(value, tuple) else (value,):
                fine = not isinstance(one, float) or math.isfinite(one)
                require(fine, f"--{name.replace('_', '-')} must be a finite number, got {one}", "option.finite")
        own = {name: value for name, value in given.items() if name in takes}
        verb(**own, **{kind: _made(kind, {name: given[name] for name in names}) for kind, names in kinds.items()})

    run.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: parameter.annotation for name, parameter in parameters.items()}
    return run


def _made(kind: str, of: dict[str, Any]) -> Any:
    if kind == "liquid":
        from cavirheo.physics.media import medium

        return medium(of.pop("medium"), unusual=of.pop("trust_input"), **of)
    if kind == "bubble":
        from cavirheo.posterior import BubbleModel

        distance = of.pop("wall_distance_um")
        of["accommodation"] = of["accommodation"] or "free"
        for name in ("accommodation", "wall_inertia", "vapour_excess", "wall_radiation"):
            of[name] = _number_or("free", f"--{name.replace('_', '-')}", of[name], float)
        return BubbleModel(**of, wall_distance=None if distance is None else distance * 1e-6)
    return Run(**of) if kind == "run" else Reading(**of)


def wall_inertia_of(text: str) -> float | str:
    """Of the bubble's surroundings, or that it is to be found. Raises InputError."""
    return _number_or("free", "--wall-inertia", text, float) or 0.0


def window_of(text: str | None) -> int | Literal["all"] | None:
    """A number of collapses, or all of them. Raises InputError."""
    return _number_or("all", "--window", text, int)


def stretch_of(text: str | None) -> float | Literal["plateau", "free"] | None:
    """R_max/R_0, what the late radius says, or nothing. Raises InputError."""
    return "free" if text == "free" else _number_or("plateau", "--stretch", text, float)


def _number_or(word: str, option: str, text: str | None, kind: type) -> Any:
    try:
        return text if text in (None, word) else kind(text)
    except ValueError:
        raise InputError(f"{option} must be a number or {word!r}, got {text!r}") from None


def for_paper(figures: str | None) -> bool:
    """Whether figures for a paper are wanted. Raises InputError: another word, or no matplotlib."""
    from cavirheo.writing.style import available

    require(figures in (None, "paper"), f"--figures must be 'paper', got {figures!r}", "option.figures")
    needed = '--figures needs matplotlib: pip install "cavirheo[plot]"'
    require(figures is None or available(), needed, "style.no_matplotlib")
    return figures is not None


def check_verify(level: str, exposure_us: float | None, exact_law: bool, files: Iterable[Path] = ()) -> None:
    """Raises InputError for an unknown level, or for an option that only --verify would use, before hours are spent.

    Recordings among the files use the exposure, too."""
    from cavirheo.inference import check_level
    from cavirheo.reading.recordings import is_recording

    try:
        check_level(level)
    except InputError as error:
        raise InputError(f"--{error}", error.code) from None
    exposed = exposure_us is not None and not any(map(is_recording, files))
    given = ["--exposure-us"] * exposed + ["--exact-law"] * exact_law
    idle = level == "none" and given
    require(not idle, f"{' and '.join(given)} would change nothing without --verify map or full: give that too")
