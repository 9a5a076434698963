"""Common parts of all documents that cavirheo writes: JSON records, their head, and CSV files; and safe writing: each
file is written completely or not at all, and no file of the user or of another run is replaced.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import logging
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from itertools import chain
from math import inf, isfinite
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_serializer, model_validator
from pydantic_core import to_json

from cavirheo.errors import InputError, as_cell, printable, read_object, sha256
from cavirheo.parameters import Bound
from cavirheo.writing import digits

try:
    import fcntl
except ModuleNotFoundError:  # Windows, where folders are not locked
    fcntl = None  # type: ignore[assignment]

_log = logging.getLogger(__name__)
MAX_BYTES = 500_000_000  # most bytes of a document that is read
MAX_NAME_BYTES = 120  # most bytes of a name, to which an ending and a number can be added
_MAX_PART = 60  # most letters of a name after ".part-": 240 bytes
LIST_FILE = ".cavirheo"  # list of the files that cavirheo wrote into an output folder
LOCK_FILE = ".cavirheo.lock"  # in a folder while a run uses it
_FIRST_KEYS = {"kind": 0, "name": 1}  # order of the keys of a record
Kind = TypeVar("Kind", bound="Document")
Picture = TypeVar("Picture")


def finite(value: float | None) -> float | None:
    """The number; None for NaN and infinity, which JSON does not have. Raises ValueError: no number."""
    if isinstance(value, str | bytes | list | dict):
        raise ValueError("no number")
    return float(value) if value is not None and isfinite(value) else None


Finite = Annotated[float | None, BeforeValidator(finite)]


class Record(BaseModel):
    """A record whose numbers are finite or null; a later version may add fields. A field that is a record may be given
    as any object with attributes of its names. `_omitted_if_empty`: fields that are not written where they are empty.
    """

    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="allow", allow_inf_nan=False, populate_by_name=True, from_attributes=True
    )
    _omitted_if_empty: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _without_empty(self, whole: Callable[[Record], dict[str, Any]]) -> dict[str, Any]:
        ordered = sorted(whole(self).items(), key=lambda item: _FIRST_KEYS.get(item[0], 2))
        return {key: value for key, value in ordered if value or key not in self._omitted_if_empty}


class Document(Record):
    """The head of a document."""

    kind: str
    """Kind of the document, which is also the usual name of its file: "result", "laws", ..."""
    schema_version: Literal[1] = Field(default=1, validation_alias="schema", serialization_alias="schema")
    """Number of the schema; its key in the file is `schema`."""
    version: str = Field(default_factory=lambda: version("cavirheo"))
    """Version of cavirheo that wrote the document."""
    command: str
    """Command that was run."""
    date: str | None = None
    """Date and time of the run, with the time zone; null where they are not known."""
    notes: list[str] = []
    """Remarks on the run as a whole, such as pictures that could not be drawn."""


class Quantity(Record):
    """A value with its interval, in the unit of its field."""

    median: float | None = None
    """Median of the posterior, or the value of a point answer; null for a bound, and where there is none."""
    q05: float | None = None
    """Lower end of the central 90 % interval; null for a point answer."""
    q95: float | None = None
    """Upper end of the central 90 % interval; null for a point answer."""
    bound: Bound | None = None
    """What is known of the value if its interval reaches an end of the range of the prior or the search. "upper": it is
    below q95 (95 %); "lower": it is above q05 (95 %); "undetermined": nothing is known. "wide": the interval of G or of
    a viscosity lies inside the range, but its ends are a factor of more than 10 apart, or the shots of a group scatter
    too much for one value. Null for a value, and for a point answer."""

    @classmethod
    def from_interval(
        cls, low: float | None, median: float, high: float | None, bound: Bound | None = None
    ) -> Quantity:
        """The quantity with this interval (5 %, 50 %, 95 %)."""
        return cls(median=median, q05=low, q95=high, bound=bound)

    @model_validator(mode="after")
    def _bound_without_median(self) -> Self:
        if self.bound is not None:
            self.median = None
        return self

    @property
    def known(self) -> bool:
        """Whether there is a value or a bound."""
        return self.median is not None or self.bound is not None

    @property
    def largest(self) -> float | None:
        """The median, or the end of a bound, by which a unit is chosen; None where there is none."""
        return self.median if self.bound is None else self.q05 if self.bound == "lower" else self.q95

    @property
    def is_zero(self) -> bool:
        """Whether the value is 0: the bound of a modulus of a liquid."""
        return self.q95 == 0.0

    @property
    def limits(self) -> tuple[float, float]:
        """The ends between which the value lies: 0 and infinity where there is no limit; twice a point answer."""
        low = None if self.bound in ("upper", "undetermined") else self.q05 or self.median
        high = None if self.bound in ("lower", "undetermined") else self.median if self.q95 is None else self.q95
        return low or 0.0, inf if high is None else high

    @property
    def width(self) -> float:
        """Difference of these ends."""
        low, high = self.limits
        return high - low


class Spread(Record):
    """Statistics of several values, in the unit of their field; null where there is no value."""

    mean: Finite = None
    """Mean of the values."""
    std: Finite = None
    """Standard deviation of n values, with the divisor n - 1; null for n < 2, and where it is not known."""


def spread_of(values: list[float | None]) -> Spread:
    """The spread of the values that are not None."""
    numbers = [value for value in values if value is not None]
    with np.errstate(over="ignore", invalid="ignore"):  # overflow gives infinity or NaN, and then null
        mean = float(np.mean(numbers)) if numbers else None
        return Spread(mean=mean, std=float(np.std(numbers, ddof=1)) if len(numbers) > 1 else None)


@contextmanager
def writable_folder(folder: str | Path) -> Iterator[Path]:
    """Context for writing into a folder, which is made if it is missing. Raises InputError for an OSError within."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        yield Path(folder)
    except OSError as error:
        why = "it is not a folder" if error.errno == errno.EEXIST else error.strerror or error
        raise InputError(f"cannot write into {folder}: {why}", "document.folder") from None


def short_name(name: str) -> str:
    """The first MAX_NAME_BYTES bytes of a name; file systems allow 143 to 255 bytes for a file name."""
    return name.encode("utf-8", "replace")[:MAX_NAME_BYTES].decode("utf-8", "ignore")


def part_of(path: Path) -> Path:
    """The temporary file beside `path`, while it is written. Its name is hidden, only used by cavirheo, and keeps the
    ending, by which some libraries choose the format."""
    return path.with_name(f".part-{path.name[-_MAX_PART:]}")


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Context with a temporary file beside `path`: it replaces `path` when it is complete, and is removed on an error.
    What had its name, such as a link, is removed before."""
    temporary = part_of(path)
    temporary.unlink(missing_ok=True)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


class Claim(NamedTuple):
    """One run of a command, by which it knows its own answers again.

    Attributes:
        command: the command line.
        request: the verb, its inputs and every option that an answer depends on, as JSON data.
        replace: whether answers of other runs may be replaced.
    """

    command: str
    request: Mapping[str, Any]
    replace: bool = False

    @property
    def key(self) -> str:
        """Identifier of the run; another run of the same command with the same inputs has the same one."""
        text = json.dumps(self.request, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@contextmanager
def locked_folder(folder: str | Path) -> Iterator[None]:
    """Context in which a run holds a folder, which is made, and removed at the end if nothing is in it. The lock ends
    with the process. Raises InputError: the folder cannot be written, or another run holds it."""
    folder = Path(folder)
    new = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    place = folder / LOCK_FILE
    try:
        with writable_folder(folder):
            file = os.fdopen(os.open(place, os.O_RDWR | os.O_CREAT, 0o666))
        with file:
            _lock(file, folder)
            try:
                yield
            finally:
                with suppress(OSError):  # Windows removes no open file
                    place.unlink()
    finally:
        for path in new:
            with suppress(OSError):  # it is not empty
                path.rmdir()


def _lock(file: IO[str], folder: Path) -> None:
    """Lock the file of a folder. Raises InputError: another run has locked it."""
    try:
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not os.fstat(file.fileno()).st_nlink:  # a run that ends at this moment has removed it
                raise BlockingIOError
    except BlockingIOError:
        message = f"{folder} is in use by another run: wait until it ends, or name another folder by -o"
        raise InputError(message, "document.busy") from None
    except OSError:  # this file system has no locks
        pass


class Outputs:
    """The files that one run writes into a folder: each completely or not at all, and no file of the user is replaced.

    The list `.cavirheo` in the folder has a line for every file that cavirheo wrote: its SHA-256, and the run
    (`Claim.key`). The line is written before the file gets its name, so that the next run recognises all files of a run
    that was killed. A file whose SHA-256 is not listed was written or changed by somebody else. Files of another run
    are replaced only if `Claim.replace` is set.

    Raises:
        InputError: at once, and again before each file is written: the folder cannot be written, or one of `names`
            exists and cavirheo did not write it, or it is one of `inputs`. At once: the answers of another run are
            there.
    """

    def __init__(self, claim: Claim, folder: str | Path, *names: str, inputs: Iterable[str | Path] = ()) -> None:
        self.folder: Path = Path(folder)
        self._claim = claim
        self._inputs = {os.path.realpath(path) for path in inputs}
        with writable_folder(self.folder):
            with TemporaryFile(dir=self.folder, buffering=0) as file:  # a test that leaves no file
                file.write(bytes(4096))
            self._listed = _entries(self.folder / LIST_FILE)
            self._check(names)
        for entry in [] if self._claim.replace else self._of_other_runs():
            whose = f" ({entry['command']})" if entry["command"] else ""
            message = f"{self.folder} holds the answers of another run{whose}, which would be lost"
            remedy = "name another folder by -o, or give --replace (replace=True in Python)"
            raise InputError(f"{message}: {remedy}", "document.other_run")

    def _check(self, names: Iterable[str]) -> None:
        """Check these files. Raises InputError: one of them exists and must not be replaced; and OSError."""
        for name in names:
            path, remedy = self.folder / name, "give another place with -o, or move it away"
            if os.path.realpath(path) in self._inputs:
                message = f"{path} is read by this command, and its results would replace it: {remedy}"
                raise InputError(message, "document.input")
            with suppress(FileNotFoundError):
                path.lstat()  # raises OSError for a name that no file can have
                if not self.listed_entry(name):
                    message = f"{path} is there and is not as cavirheo wrote it, so it is not replaced: {remedy}"
                    raise InputError(message, "document.foreign")

    def write(self, name: str, writer: Callable[..., object], *content: Any) -> None:
        """Write the file of this name by `writer(path, *content)`."""
        with writable_folder(self.folder):
            self._check([name])
            with atomic_file(self.folder / name) as temporary:
                writer(temporary, *content)
                about = {"run": self._claim.key, "command": digits.elide(self._claim.command, 100)}
                self._listed.append({"name": name, "sha256": sha256(temporary), **about})
                with atomic_file(self.folder / LIST_FILE) as listing:
                    listing.write_text("\n".join(map(json.dumps, self._listed)), encoding="utf-8")

    def finish(self) -> None:
        """Remove the files of other runs, which this one replaces."""
        with writable_folder(self.folder):
            for entry in self._of_other_runs():
                (self.folder / entry["name"]).unlink()

    def _of_other_runs(self) -> Iterator[dict[str, str]]:
        """The lines of files of other runs that are as these wrote them, and are no input."""
        for name in dict.fromkeys(entry["name"] for entry in self._listed):
            entry = self.listed_entry(name)
            if entry and entry["run"] != self._claim.key and os.path.realpath(self.folder / name) not in self._inputs:
                yield entry

    def listed_entry(self, name: str) -> dict[str, str] | None:
        """The line of this file in the list; None if the file is missing, or is not as cavirheo wrote it."""
        path, entries = self.folder / name, {line["sha256"]: line for line in self._listed if line["name"] == name}
        if not entries or not path.is_file() or path.is_symlink():
            return None
        return entries.get(sha256(path))


def _entries(listing: Path) -> list[dict[str, str]]:
    """The lines of a list; what is no such line, and those of files in other folders, are left out."""
    entries = []
    for line in listing.read_text("utf-8", "replace").splitlines() if listing.is_file() else ():
        with suppress(ValueError, TypeError, KeyError):
            entries.append({key: str(json.loads(line)[key]) for key in ("name", "sha256", "run", "command")})
    return [entry for entry in entries if Path(entry["name"]).name == entry["name"]]


def try_to_draw(name: str, notes: list[str], draw: Callable[..., Picture], *content: Any) -> Picture | str:
    """The result of `draw(*content)`, which makes a picture or writes its file; on an error a sentence, which is added
    to `notes`. Raises InputError as `Outputs`: the folder cannot be written, or a file would be replaced."""
    try:
        with np.errstate(all="ignore"):  # huge numbers may overflow
            return draw(*content)
    except Exception as error:  # a label or a font may raise any exception; the answers must be written
        if isinstance(error, InputError) and error.code.startswith("document."):
            raise
        _log.info("%s could not be drawn", name, exc_info=True)
        notes.append(f"{name} could not be drawn: {type(error).__name__}: {error}")
        return notes[-1]


def write_json(path: str | Path, document: Document) -> None:
    """Write a document as UTF-8 JSON; the document read from it is equal, except for control characters."""
    Path(path).write_bytes(to_json(digits.printable(document.model_dump(by_alias=True)), indent=1) + b"\n")


def read_json(path: str | Path, kind_of: Callable[[str], type[Kind]]) -> Kind:
    """Read a document of the class that `kind_of` gives for the kind that it states. Raises InputError: there is no
    such file, it is no JSON, or not a document of this class; or as `kind_of`."""
    content = read_object(path, MAX_BYTES)
    kind = kind_of(str(content.get("kind")))
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "the document"
        message = f"{path}: not a cavirheo {kind.__name__.lower()} of schema 1; {where}: {first['msg']}"
        message += "; read it with the version of cavirheo that wrote it, or make it again"
        raise InputError(message, "document.other") from None


def write_rows(path: str | Path, head: Sequence[str], rows: Iterable[Mapping[str, Any]], remark: str = "") -> None:
    """Write CSV: a line per row with its entries in `head`; empty where it has none. No text is read as a formula
    (`errors.as_cell`). remark: a first line, after "# ", in a single cell."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {re.sub('[,;]', ' ', printable(remark))}\n" if remark else "")
        writer = csv.writer(file, lineterminator="\n")
        for cells in chain([head], ([row.get(key) for key in head] for row in rows)):
            writer.writerow([as_cell(cell) if isinstance(cell, str) else cell for cell in map(digits.printable, cells)])
