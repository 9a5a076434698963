"""The options that verbs share, each written once; those of the surroundings become one argument, the medium."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from cavirheo.errors import InputError

Curves = Annotated[list[Path], typer.Argument(help="measured R(t): .mat, .csv, .h5, .xlsx; one or many curves each")]
ModelName = Annotated[
    str, typer.Option("--model", help="shipped model (see `cavirheo models`) or a path to an .onnx file")
]
Out = Annotated[Path, typer.Option("-o", "--out", help="folder for the results")]
TrueRadius = Annotated[float | None, typer.Option(help="true R_max of the shots, um: rescales the radii")]
Verify = Annotated[
    str,
    typer.Option(help="map: the posterior's maximum; full: draws weighted by full simulations; none"),
]
ExposureUs = Annotated[
    float | None, typer.Option(help="of a frame, us, centred on its time: --verify blurs the simulation as the camera")
]
ExactLaw = Annotated[
    bool, typer.Option("--exact-law", help="--verify: no discrepancy between law and bubble, narrower intervals")
]
FROM_OPTIONS: Any = None  # default of the argument `liquid` of a verb: it is made of the options below
_SURROUNDINGS: dict[str, tuple[Any, Any]] = {  # options of every verb that takes a `liquid`, and their defaults
    "medium": (
        Annotated[str, typer.Option(help="named constants: water, bu2026, estrada2018, ...")],
        "water",
    ),
    "density": (Annotated[float | None, typer.Option(help="of the liquid or gel, kg/m3")], None),
    "sound_speed": (Annotated[float | None, typer.Option(help="m/s")], None),
    "surface_tension": (Annotated[float | None, typer.Option(help="N/m")], None),
    "pressure": (Annotated[float | None, typer.Option(help="far from the bubble, Pa")], None),
    "temperature": (Annotated[float | None, typer.Option(help="far from the bubble, K")], None),
}


def with_surroundings(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb whose argument `liquid` (a Medium) is given by the options of the surroundings, where `liquid` stands."""

    @functools.wraps(verb)
    def run(**given: Any) -> None:
        from cavirheo.physics.media import medium

        name, *constants = _SURROUNDINGS
        liquid = medium(given.pop(name), **{key: given.pop(key) for key in constants})
        verb(**given, liquid=liquid)

    hints = get_type_hints(verb, localns={"Medium": Any}, include_extras=True)
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(verb).parameters.values():
        if parameter.name == "liquid":
            parameters += [parameter.replace(name=n, annotation=a, default=d) for n, (a, d) in _SURROUNDINGS.items()]
        else:
            parameters.append(parameter.replace(annotation=hints[parameter.name]))
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def number_or(text: str | None, word: str, option: str, kind: type[Any]) -> Any:
    """`text` as a number of this kind, unless it is the word or None."""
    if text is None or text == word:
        return text
    try:
        return kind(text)
    except ValueError:
        raise InputError(f"{option} must be a number or {word!r}, got {text!r}") from None


def check_verify(level: str, exposure_us: float | None, exact_law: bool) -> None:
    """Raises InputError for an unknown level, or for an option that only --verify would use, before hours are spent."""
    from cavirheo.inference import check_level

    check_level(level)
    idle = {"--exposure-us": exposure_us is not None, "--exact-law": exact_law}
    if level == "none" and (given := [option for option, is_given in idle.items() if is_given]):
        raise InputError(f"{' and '.join(given)} would change nothing without --verify map or full: give that too")
