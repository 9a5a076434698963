"""What all documents that cavirheo writes have in common: records that JSON can hold, their head, and files of rows."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from cavirheo.errors import InputError


def finite(value: float | None) -> float | None:
    """As JSON can hold it: NaN and infinity are null. Raises ValueError: no number."""
    if isinstance(value, str | bytes | list | dict):
        raise ValueError("no number")
    return float(value) if value is not None and isfinite(value) else None


Finite = Annotated[float | None, BeforeValidator(finite)]


class Record(BaseModel):
    """Numbers are finite or null; a later version may add fields."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False, populate_by_name=True)


class Document(Record):
    """The head. `notes` concern the run as a whole (pictures that could not be drawn, ...)."""

    schema_version: Literal[1] = Field(default=1, validation_alias="schema", serialization_alias="schema")
    version: str = Field(default_factory=lambda: version("cavirheo"))
    command: str
    date: str | None = None
    notes: list[str] = []


Kind = TypeVar("Kind", bound=Document)


class Quantity(Record):
    """Posterior median and central 90 % interval; q05 and q95 are null for a point answer."""

    median: float | None = None
    q05: float | None = None
    q95: float | None = None


class Spread(Record):
    """Over several values; std has n - 1 below it and is null for n < 2."""

    mean: float | None = None
    std: float | None = None
    median: float | None = None


def spread_of(values: list[float | None]) -> Spread:
    """Over those that are known."""
    known = [value for value in values if value is not None]
    if not known:
        return Spread()
    std = float(np.std(known, ddof=1)) if len(known) > 1 else None
    return Spread(mean=float(np.mean(known)), std=std, median=float(np.median(known)))


@contextmanager
def into(folder: str | Path) -> Iterator[Path]:
    """A folder to write into, made if it is missing. Raises InputError for whatever cannot be written there."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        yield Path(folder)
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}", "document.folder") from None


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file to write beside `path`, which takes its place when it is complete and is gone if it never is."""
    temporary = path.with_suffix(".tmp")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: str | Path, document: Document) -> None:
    """Write it as UTF-8 JSON; what is read back is equal to it."""
    Path(path).write_text(document.model_dump_json(by_alias=True, indent=1) + "\n", encoding="utf-8")


def read_json(path: str | Path, kind: type[Kind]) -> Kind:
    """A document as it was written. Raises InputError if there is none, or none of this kind."""
    try:
        return kind.model_validate_json(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})", "document.unreadable") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "the document"
        said = f"{path}: not a cavirheo {kind.__name__.lower()} of schema 1; {where}: {first['msg']}"
        raise InputError(said, "document.other") from None


def write_rows(path: str | Path, head: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """CSV: a line per row, of its entries those in `head`; empty where there is none."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, head, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
