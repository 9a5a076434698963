"""Options that verbs share besides the settings of an analysis, as dataclasses that the verbs inherit."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import BadParameter

from cavirheo.errors import InputError
from cavirheo.settings import CLUSTER, INTERVAL, OUTPUT, Exclude, Settings, argument, option

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.population import CommonErrors
    from cavirheo.io.shots import CurveSet
    from cavirheo.verbs.run import Run


def _named_folder(text: object) -> Path:
    if not str(text).strip():
        raise BadParameter("a folder must have a name; leave the option out for the usual one")
    return Path(str(text))


def folder(help: str) -> Any:
    return option(help, None, "-o", "--out", parser=_named_folder, metavar="FOLDER")


def numbers(name: str, text: str | None, kind: type[Any], mark: str, expected: str, count: int = 0) -> Any:
    """The `count` numbers of an option, a tuple; None if it is not given. Raises InputError, which says what is
    expected."""
    if text is None:
        return None
    try:
        values = tuple(map(kind, text.split(mark)))
    except ValueError:
        values = ()
    if not values or len(values) != (count or len(values)):
        raise InputError(f"{name} must be {expected}, got {text!r}", f"option.{name[2:]}")
    return values


Out = Annotated[Path, folder("folder for the results")]  # for documents: a run locks it; --replace belongs to it
ResumableOut = Annotated[Path, folder("folder, which may hold a part")]  # for work that a later call continues
Quiet = Annotated[bool, option("print errors only, no table and no progress", None, "--quiet")]
REFERENCES = "CSV of published values, or sweeps of a rheometer, beside the answers; may be repeated"
WantedPercent = Annotated[float, option("wanted half-width of the 90 % interval, % of the value", min=0.1, max=99.0)]
_SCHEDULER = "of a dask cluster: tcp://HOST:PORT  [default: the cores of this machine]"
Scheduler = Annotated[str | None, option(_SCHEDULER, CLUSTER)]
Slurm = Annotated[int | None, option("ask SLURM for so many jobs, as dask-jobqueue is set", CLUSTER, min=1)]
_FILES = "measured R(t): .mat, .csv, .h5, .xlsx; or videos: .mp4, .tif, .cine, ...; or a folder"
_SCALE_ERROR = "error of the radius scale that all shots of a group share, as a standard deviation, %"
_PICTURES = "draw pictures; --no-pictures is faster"


@dataclass(frozen=True, kw_only=True)
class Verb:
    """A command that writes documents into a folder, which it locks. Its fields are the values of its arguments and
    options; those of the last base class come first."""

    out: Out = Path("cavirheo-result")
    replace: Annotated[bool, option("write over the answers of another run in that folder", None, "--replace")] = False
    quiet: Quiet = False

    def __call__(self, run: "Run") -> None:
        """Run the command. Raises InputError, and typer.Exit with the exit status."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class AnsweringVerb(Verb, Settings):
    """Options of all verbs that answer measured curves: errors that all shots of a group share, and the output."""

    scale_error: Annotated[float, option(_SCALE_ERROR, INTERVAL, min=0.0, max=20.0)] = 1.0
    rate_error: Annotated[float, option("the same of the frame rate, %", INTERVAL, min=0.0, max=20.0)] = 0.1
    density_error: Annotated[float, option("the same of the density, %", INTERVAL, min=0.0, max=20.0)] = 1.0
    pressure_error: Annotated[float, option("the same of the pressure, %", INTERVAL, min=0.0, max=20.0)] = 1.0
    every_shot: Annotated[bool, option("print a row for each shot, not for exceptions alone", OUTPUT, "--all")] = False
    pictures: Annotated[bool, option(_PICTURES, OUTPUT, "--pictures/--no-pictures")] = True

    @property
    def errors(self) -> "CommonErrors":
        """The errors as fractions."""
        from cavirheo.inference.population import CommonErrors

        per_cent = self.scale_error, self.rate_error, self.density_error, self.pressure_error
        return CommonErrors(*(0.01 * error for error in per_cent))

    def read_recordings(self, files: list[Path], exclude: str | None = None) -> "CurveSet":
        """Read the files by `read_shots` with these options. Raises InputError."""
        from cavirheo.io.shots import read_shots

        if exclude is not None and len(files) > 1:
            message = f"--exclude is of one recording, {len(files)} files were given"
            raise InputError(f"{message}: `cavirheo measure` each with its own", "option.exclude")
        return read_shots(files, exclude=exclude, **self.read_options)


@dataclass(frozen=True, kw_only=True)
class MeasuredFiles(AnsweringVerb):
    """Options of verbs that answer given files: files, excluded frames, and the scheduler."""

    files: Annotated[list[Path], argument("FILE...", _FILES, readable=False)]
    exclude: Exclude = None
    scheduler: Scheduler = None
    slurm: Slurm = None

    def read_curves(self, run: "Run", files: list[Path]) -> "list[RadiusCurve]":
        """Return all curves of the files, and load the solver. Raises InputError: no curve."""
        from cavirheo.physics.simulate import load_solver

        curves, problems, remarks = self.read_recordings(files, self.exclude)
        run.note_unreadable(problems)
        run.notes += remarks
        run.require_any(curves, "curve")
        load_solver()
        return curves
