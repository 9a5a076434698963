"""The options that verbs share, each written once; those of a kind become one argument: `liquid`, `run`, ..."""

from __future__ import annotations

import functools
import inspect
import math
import os
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option

from cavirheo.errors import InputError, require
from cavirheo.physics.bubble import CONTENTS, DAMAGES
from cavirheo.verbs.run import Reading, Run, command_line
from cavirheo.writing.claim import Claim, claimed

if TYPE_CHECKING:
    from cavirheo.physics.bubble import Bubble
    from cavirheo.physics.media import Medium as Liquid

    Bubbles = tuple[Bubble, ...] | None
else:
    Liquid = Bubble = Bubbles = Any

# options that change no answer
_SHOWING = ("out", "replace", "json", "quiet", "pictures", "figures", "scheduler", "once", "patience")
_LEVELS = ("auto", "full", "map", "none")  # of verification
_BUBBLES = ("real", "field", "auto")


def values(*words: str, commas: bool = False) -> Callable[[str], list[str]]:
    """What the shell offers for an option with these values; for several of them after each comma."""
    return lambda incomplete: _begun(incomplete, words, "," if commas else "")


def law_names(incomplete: str) -> list[str]:
    """Those that can be fitted, also as the next part of a sum, and auto."""
    return [*sum_names(incomplete), *_begun(incomplete, ["auto"])]


def sum_names(incomplete: str) -> list[str]:
    """Those that can be fitted, also as the next part of a sum."""
    return _begun(incomplete, _laws(), "+")


def many_law_names(incomplete: str) -> list[str]:
    """Those that can be fitted, after each comma."""
    return _begun(incomplete, _laws(), "+,")


def any_law_names(incomplete: str) -> list[str]:
    """All laws, also as the next part of a sum."""
    from cavirheo.physics.laws import LAWS

    return _begun(incomplete, LAWS, "+")


def model_names(incomplete: str) -> list[str]:
    """The shipped models, by their files: to read their cards takes longer than a key should."""
    return _begun(incomplete, sorted(path.stem for path in (Path(__file__).parents[1] / "models").glob("*.onnx")))


def medium_names(incomplete: str) -> list[str]:
    """The named sets of constants."""
    from cavirheo.physics.media import MEDIA

    return _begun(incomplete, MEDIA)


def _laws() -> list[str]:
    """`ABLE` of inference/law, which takes a second to import: those whose parameters have a range or a default."""
    from cavirheo.parameters import PARAMETERS, inferred_as
    from cavirheo.physics.laws import LAWS

    takes = {name: inspect.signature(law).parameters.values() for name, law in LAWS.items()}
    return [
        name
        for name, given in takes.items()
        if all(PARAMETERS[inferred_as(one.name)].searched or one.default is not one.empty for one in given)
    ]


def _begun(incomplete: str, words: Iterable[str], between: str = "") -> list[str]:
    """The words that go on from what is typed; where several may be given, from what follows the last separator."""
    done = max((incomplete.rfind(one) for one in between), default=-1) + 1
    kept, typed = incomplete[:done], incomplete[done:]
    kept += typed[: len(typed) - len(typed.lstrip())]
    used = kept.replace(",", " ").split() if "," in between else []
    return [kept + word for word in words if word.startswith(typed.strip()) and word not in used]


Curves = Annotated[
    list[Path],
    Argument(
        readable=False,
        help="measured R(t): .mat, .csv, .h5, .xlsx; or recordings: .mp4, .tif, .cine, ...; a folder, or - for stdin",
    ),
]
_MODEL = "shipped model (see `cavirheo models`) or a path to an .onnx file"
ModelName = Annotated[str, Option("--model", help=_MODEL, autocompletion=model_names)]


def _folder(text: object) -> Path:
    """Raises a mistake of usage: no name."""
    if not str(text).strip():
        raise BadParameter("a folder must have a name; leave the option out for the usual one", param_hint="-o")
    return Path(str(text))


_OUT: Any = Option("-o", "--out", help="folder for the results", parser=_folder, metavar="FOLDER")
Out = Annotated[Path, _OUT]  # of documents: a run holds it, and --replace goes with it
_GROWING: Any = Option("-o", "--out", help="folder, which may hold a part", parser=_folder, metavar="FOLDER")
Growing = Annotated[Path, _GROWING]  # of work that another call goes on with
Replace = Annotated[bool, Option("--replace", help="write over the answers of another run in that folder")]
_AUTO = "auto: weighted draws from few simulations; full: from many; map: maximum of the posterior; none: network alone"
VerifyAuto = Annotated[str, Option(help=_AUTO, autocompletion=values(*_LEVELS))]
ExactLaw = Annotated[
    bool,
    Option("--exact-law", help="with --verify: the bubble follows the law exactly (narrower intervals)"),
]
Seed = Annotated[int, Option(help="seed of the random draws of the intervals", min=0, max=2**64 - 1)]
Pictures = Annotated[bool, Option("--pictures/--no-pictures", help="draw pictures; --no-pictures is faster")]
FIGURES = ("png", "svg", "pdf", "paper")
_FIGURES = "files of each curve and group: png, svg, pdf, or paper (all three, 84 and 174 mm wide), such as 'png,paper'"
Figures = Annotated[str | None, Option(help=_FIGURES)]
Quiet = Annotated[bool, Option("--quiet", help="print errors only, no table and no progress")]
_TRUST = "I checked scale, frame rate and constants: report doubts, but keep the verdict"
TrustInput = Annotated[bool, Option("--trust-input", help=_TRUST)]
Exclude = Annotated[str | None, Option(help="frames of a recording to leave out, such as '12,40-45' (the first is 1)")]
UmPerPx = Annotated[float | None, Option(help="micrometres per pixel of a recording")]
_BLUR = "exposure time of a frame, us, centred on its time: the simulation is blurred alike"
_GROUP = "shots of one material: file, folder, name (soft_1, soft_2), none, or auto: a file, or single-shot files"
Group = Annotated[str, Option(help=_GROUP)]
_KINETIC = "model of the vapour: equilibrium (the field's model) or kinetic (condenses at a finite rate)"
Contents = Annotated[str, Option(help=_KINETIC, autocompletion=values(*CONTENTS))]
_LAW = "a law of `cavirheo laws`, or auto  [default: nhkv]"
Material = Annotated[str | None, Option(help=_LAW, autocompletion=law_names)]
_STRETCH = "R_max/R_0 if it is known; free: without the prior that a file states  [default: with it]"
KnownStretch = Annotated[str | None, Option(help=_STRETCH, autocompletion=values("free"))]
ReadWindow = Annotated[int | None, Option(help="number of collapses to compare  [default: 3]", min=1)]
ManyLaws = Annotated[str, Option(help="two or more laws, with commas", autocompletion=many_law_names)]
WallDistanceUm = Annotated[float | None, Option(help="um to one rigid wall, instead of --confinement-inertia")]
Shots = Annotated[str | None, Option(help="shots of every file, such as '1,4-7' (the first is 1)  [default: all]")]
_WANTED = "wanted half-width of the 90 % interval, % of the value"
WantedPercent = Annotated[float, Option(help=_WANTED, min=0.1, max=99.0)]
_COLUMN = "table with a number (a concentration, ...) for each shot, file or group, or R_max: slope of the material"
Column = Annotated[Path | None, Option(help=_COLUMN, readable=False)]
_SCHEDULER = "dask: tcp://HOST:PORT, or slurm:FILE.toml  [default: the cores of this machine]"
Scheduler = Annotated[str | None, Option(help=_SCHEDULER)]
_MEDIUM = "named constants: water, bu2026, estrada2018, ..."
FROM_OPTIONS: Any = None  # default of an argument of a verb that is made of the options of its kind
_Number = float | None
_BUBBLE = "real (vapour condenses at a finite rate, damped by its surroundings), field (equilibrium, unbounded) or auto"
_BUBBLE_HELP = f"{_BUBBLE}: the evidence chooses"
_MANY_BUBBLES = f"{_BUBBLE.removesuffix(' or auto')}, or both with a comma"
_DAMAGE = "softening of the gel: none, first-rebound or strain"
_HURT = "softening of the gel: none, first-rebound, strain, with commas"
_RATE = "accommodation coefficient of kinetic contents, up to 10; or free"
_INERTIA = "R_max sum(s/d) over image bubbles; or free"
_EXCESS = "vapour at R_max above saturation, Pa; or free"
_DAMPING = "2 pi (R_max^2/A) c/U_c of a tube around it; or free"
_Word = str | None
_OVERRIDES: dict[str, tuple[Any, Any]] = {
    "contents": (
        Annotated[_Word, Option(help=_KINETIC, autocompletion=values(*CONTENTS))], None,
    ),
    "accommodation": (Annotated[_Word, Option(help=_RATE)], None),
    "confinement_damping": (Annotated[_Word, Option(help=_DAMPING)], None),
    "confinement_inertia": (Annotated[_Word, Option(help=_INERTIA)], None),
    "wall_distance_um": (WallDistanceUm, None),
    "vapour_excess": (Annotated[_Word, Option(help=_EXCESS)], None),
}  # fmt: skip
_KINDS: dict[str, dict[str, tuple[Any, Any]]] = {  # argument: its options, each with type and default
    "liquid": {
        "medium": (Annotated[str, Option(help=_MEDIUM, autocompletion=medium_names)], "water"),
        "density": (Annotated[_Number, Option(help="density of the liquid or gel, kg/m3")], None),
        "sound_speed": (Annotated[_Number, Option(help="m/s")], None),
        "surface_tension": (Annotated[_Number, Option(help="N/m")], None),
        "pressure": (Annotated[_Number, Option(help="pressure far from the bubble, Pa")], None),
        "temperature": (Annotated[_Number, Option(help="temperature far from the bubble, K")], None),
        "trust_input": (TrustInput, False),
    },
    "reading": {
        "rmax_um": (Annotated[_Number, Option(help="true R_max of the shots, um: rescales the radii")], None),
        "shots": (Shots, None),
        "fps": (
            Annotated[_Number, Option(help="frames per second, for recordings and files that number their frames")],
            None,
        ),
        "um_per_px": (UmPerPx, None),
        "exclude": (Exclude, None),
        "exposure_us": (Annotated[_Number, Option(help=_BLUR)], None),
        "group": (Group, "auto"),
        "trust_input": (TrustInput, False),
    },
    "bubbles": {
        "bubble": (Annotated[_Word, Option(help=_BUBBLE_HELP, autocompletion=values(*_BUBBLES))], None),
        **_OVERRIDES,
        "damage": (
            Annotated[str, Option(help=_DAMAGE, autocompletion=values(*DAMAGES))],
            "none",
        ),
    },
    "many_bubbles": {
        "bubble": (
            Annotated[str, Option(help=_MANY_BUBBLES, autocompletion=values(*_BUBBLES[:2], commas=True))],
            "real",
        ),
        **_OVERRIDES,
        "damage": (
            Annotated[
                str,
                Option(help=_HURT, autocompletion=values(*DAMAGES, commas=True)),
            ],
            "none",
        ),
    },
    "run": {
        "json": (Annotated[bool, Option("--json", help="print the JSON document instead of the table")], False),
        "quiet": (Quiet, False),
    },
}


def with_kinds(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb whose arguments `liquid`, `reading`, `bubbles`, `many_bubbles` and `run`, if it has them, are given by
    their options; one that writes documents into a folder also has `--replace`, and holds that folder.

    Numbers that are not finite are refused for every verb alike.
    """
    takes = inspect.signature(verb, eval_str=True).parameters
    documents = "out" in takes and takes["out"].annotation == Out
    kinds = {kind: _KINDS[kind] for kind in takes if kind in _KINDS}
    parameters: dict[str, inspect.Parameter] = {}
    for parameter in takes.values():
        for name, (annotation, default) in kinds.get(parameter.name, {}).items():
            parameters[name] = parameter.replace(name=name, annotation=annotation, default=default)
        if parameter.name not in kinds:
            parameters[parameter.name] = parameter
        if parameter.name == "out" and documents:
            parameters["replace"] = parameter.replace(name="replace", annotation=Replace, default=False)

    @functools.wraps(verb)
    def run(**given: Any) -> None:
        for name, value in given.items():
            for one in value if isinstance(value, tuple) else (value,):
                fine = not isinstance(one, float) or math.isfinite(one)
                require(fine, f"--{name.replace('_', '-')} must be a finite number, got {one}", "option.finite")
        own = {name: value for name, value in given.items() if name in takes and name not in kinds}
        with claimed(_claim(verb.__name__, given)) if documents else nullcontext():
            verb(**own, **{kind: _made(kind, {name: given[name] for name in names}) for kind, names in kinds.items()})

    run.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: parameter.annotation for name, parameter in parameters.items()}
    return run


def _claim(verb: str, given: dict[str, Any]) -> Claim:
    """The same for two calls that ask for the same answers, from whichever folder."""

    def named(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [named(one) for one in value]
        return os.path.realpath(value) if isinstance(value, Path) else value

    request = {name: named(value) for name, value in given.items() if name not in _SHOWING}
    return Claim(command_line(), {"verb": verb, **request}, given["replace"])


def _made(kind: str, of: dict[str, Any]) -> Any:
    if kind == "liquid":
        from cavirheo.physics.media import medium

        return medium(of.pop("medium"), unusual=of.pop("trust_input"), **of)
    if kind in ("bubbles", "many_bubbles"):
        return _bubbles(several=kind == "many_bubbles", **of)
    return Run(**of) if kind == "run" else Reading(**of)


def _bubbles(
    bubble: str | None, damage: str, contents: str | None, accommodation: str | None, confinement_damping: str | None,
    confinement_inertia: str | None, wall_distance_um: float | None, vapour_excess: str | None, *, several: bool,
) -> tuple[Bubble, ...] | None:  # fmt: skip
    """The bubbles that the options ask for; None where they ask for nothing, so that the network decides. Raises
    InputError: a word that is none, or numbers that cannot be."""
    from dataclasses import replace

    from cavirheo.physics.bubble import bubbles_of

    changes: dict[str, Any] = {"contents": contents}
    numbers = {"accommodation": accommodation, "confinement_damping": confinement_damping}
    numbers |= {"confinement_inertia": confinement_inertia, "vapour_excess": vapour_excess}
    changes |= {name: _number_or("free", f"--{name.replace('_', '-')}", text, float) for name, text in numbers.items()}
    changes["wall_distance"] = None if wall_distance_um is None else wall_distance_um * 1e-6
    given = {name: value for name, value in changes.items() if value is not None}
    message = f"--contents must be {' or '.join(CONTENTS)}, got {contents!r}"
    require(contents in (None, *CONTENTS), message, "option.contents")
    damages = [word.strip() for word in damage.split(",")] if several else [damage]
    message = f"--damage must be {', '.join(DAMAGES)}, got {damage!r}"
    require(set(damages) <= set(DAMAGES), message, "option.damage")
    if bubble is None and not given and damages == [DAMAGES[0]]:
        return None
    words = [word.strip() for word in (bubble or "real").split(",")] if several else [bubble or "real"]
    found = (one for word in words for one in bubbles_of(word))
    return tuple(replace(one, damage=hurt, **given) for one in found for hurt in damages)


def known_stretch(text: str | None) -> float | Literal["free"] | None:
    """R_max/R_0, without a prior, or with that of the file. Raises InputError."""
    return _number_or("free", "--stretch", text, float)


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


def figures_of(words: str | None) -> tuple[str, ...]:
    """The kinds of figures that are asked for as files. Raises InputError: another word, or no matplotlib."""
    from cavirheo.writing.style import available

    kinds = tuple(dict.fromkeys(word.strip() for word in (words or "").split(",") if word.strip()))
    unknown = ", ".join(kind for kind in kinds if kind not in FIGURES)
    require(not unknown, f"--figures must be of {', '.join(FIGURES)}, got {unknown!r}", "option.figures")
    needed = '--figures needs matplotlib: pip install "cavirheo[plot]"'
    require(not kinds or available(), needed, "style.no_matplotlib")
    return kinds


def check_verify(level: str, exposure_us: float | None, exact_law: bool, files: Iterable[Path] = ()) -> None:
    """Raises InputError for an unknown level, or for an option that only --verify would use, before hours are spent.

    Recordings among the files use the exposure, too."""
    from cavirheo.reading.recordings import is_recording

    require(level in _LEVELS, f"--verify must be auto, none, map or full, got {level!r}", "option.verify")
    exposed = exposure_us is not None and not any(map(is_recording, files))
    given = ["--exposure-us"] * exposed + ["--exact-law"] * exact_law
    idle = level == "none" and given
    require(not idle, f"{' and '.join(given)} would change nothing without --verify map or full: give that too")
