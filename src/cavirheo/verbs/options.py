"""The options that verbs share, each written once; those of the surroundings become one argument, the medium."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from cavirheo.errors import InputError, require

if TYPE_CHECKING:
    from cavirheo.physics.media import Medium as Liquid
else:
    Liquid = Any

Curves = Annotated[
    list[Path], Argument(readable=False, help="measured R(t): .mat, .csv, .h5, .xlsx; one or many curves each")
]
ModelName = Annotated[str, Option("--model", help="shipped model (see `cavirheo models`) or a path to an .onnx file")]
Out = Annotated[Path, Option("-o", "--out", help="folder for the results")]
TrueRadius = Annotated[float | None, Option(help="true R_max of the shots, um: rescales the radii")]
Verify = Annotated[str, Option(help="map: the posterior's maximum; full: draws weighted by full simulations; none")]
ExposureUs = Annotated[
    float | None, Option(help="of a frame, us, centred on its time: --verify blurs the simulation as the camera")
]
ExactLaw = Annotated[
    bool, Option("--exact-law", help="--verify: no discrepancy between law and bubble, narrower intervals")
]
FROM_OPTIONS: Any = None  # default of the argument `liquid` of a verb: it is made of the options below
_CONSTANTS = {  # of the surroundings: None is the named medium's own
    "density": "of the liquid or gel, kg/m3",
    "sound_speed": "m/s",
    "surface_tension": "N/m",
    "pressure": "far from the bubble, Pa",
    "temperature": "far from the bubble, K",
}
Named = Annotated[str, Option(help="named constants: water, bu2026, estrada2018, ...")]


def with_surroundings(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb whose argument `liquid` (a Medium), if it has one, is given by the options of the surroundings."""
    takes = inspect.signature(verb, eval_str=True).parameters
    if "liquid" not in takes:
        return verb

    @functools.wraps(verb)
    def run(medium: str, **given: Any) -> None:
        from cavirheo.physics import media

        liquid = media.medium(medium, **{key: given.pop(key) for key in _CONSTANTS})
        verb(**given, liquid=liquid)

    parameters = list(takes.values())
    at = parameters.index(takes["liquid"])
    instead = [takes["liquid"].replace(name="medium", annotation=Named, default="water")]
    for name, words in _CONSTANTS.items():
        number = Annotated[float | None, Option(help=words)]
        instead.append(instead[0].replace(name=name, annotation=number, default=None))
    parameters[at : at + 1] = instead
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def window_of(text: str | None) -> int | Literal["all"] | None:
    """A number of collapses, or all of them. Raises InputError."""
    return _number_or("all", "--window", text, int)


def stretch_of(text: str | None) -> float | Literal["plateau"] | None:
    """R_max/R_0, or what the late radius says. Raises InputError."""
    return _number_or("plateau", "--stretch", text, float)


def _number_or(word: str, option: str, text: str | None, kind: type) -> Any:
    try:
        return text if text in (None, word) else kind(text)
    except ValueError:
        raise InputError(f"{option} must be a number or {word!r}, got {text!r}") from None


def check_verify(level: str, exposure_us: float | None, exact_law: bool) -> None:
    """Raises InputError for an unknown level, or for an option that only --verify would use, before hours are spent."""
    from cavirheo.inference import check_level

    try:
        check_level(level)
    except InputError as error:
        raise InputError(f"--{error}", error.code) from None
    given = ["--exposure-us"] * (exposure_us is not None) + ["--exact-law"] * exact_law
    idle = level == "none" and given
    require(not idle, f"{' and '.join(given)} would change nothing without --verify map or full: give that too")
