"""What all documents that cavirheo writes have in common: models that JSON can hold, their head, and files of rows."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field


class Model(BaseModel):
    """Numbers are finite or null; a later version may add fields."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False, populate_by_name=True)


class Document(Model):
    """The head. `notes` concern the run as a whole (pictures that could not be drawn, ...)."""

    schema_version: Literal[1] = Field(default=1, validation_alias="schema", serialization_alias="schema")
    version: str = Field(default_factory=lambda: version("cavirheo"))
    command: str
    date: str | None = None
    notes: list[str] = []


def write_json(path: str | Path, document: Document) -> None:
    """Write it as UTF-8 JSON; what is read back is equal to it."""
    Path(path).write_text(document.model_dump_json(by_alias=True, indent=1) + "\n", encoding="utf-8")


def write_rows(path: str | Path, head: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """CSV: a line per row, of its entries those in `head`; empty where there is none."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, head, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
