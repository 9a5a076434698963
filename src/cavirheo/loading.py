"""Load what cavirheo wrote: documents, recognised by the kind that they state."""

from __future__ import annotations

from os.path import isdir, isfile  # these two also work for names that no file can have
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar, overload

from cavirheo.errors import InputError, as_path, expect
from cavirheo.writing.document import Document, read_json

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result

Loaded = TypeVar("Loaded", bound=Document)
# by `kind` (the usual file name is KIND.json): the class of the document, and the function that prints its table
KINDS = {
    "result": ("cavirheo.reporting.record.Result", "cavirheo.reporting.screen.print_all"),
    "rheometer": ("cavirheo.companions.rheometer.Rheometry", "cavirheo.companions.rheometer.print_rheometry"),
    "collapse-time": (
        "cavirheo.companions.collapse_times.CollapseTimes",
        "cavirheo.companions.collapse_times.print_table",
    ),
    "measure": ("cavirheo.reporting.measured.Measured", "cavirheo.reporting.measured.print_table"),
    "design": ("cavirheo.companions.design.Design", "cavirheo.companions.design.print_table"),
}
NAMES = tuple(f"{kind}.json" for kind in KINDS)


@overload
def load(path: str | Path) -> Result | Any: ...  # type checkers then report a wrong name of a Result


@overload
def load(path: str | Path, kind: type[Loaded]) -> Loaded: ...


def load(path: str | Path, kind: type[Any] | None = None) -> Any:
    """Load a document (`Result`, `Measured`, ...: docs/file-formats.md); values are SI.

    Args:
        path: a document with any file name, or a folder with one document.
        kind: the class that the file must hold; default: any (type checkers see a `Result`).

    Raises:
        InputError: no such file, not a file of cavirheo, or another kind.
    """
    kind = object if kind is None else kind
    expect(kind, type, "a class such as Result, of cavirheo.reporting.record")
    path = as_path(path)
    if (document := document_of(path)) and not isdir(path) and document != path:
        raise InputError(f"{path} is written from {document}: give that file", "loading.copy")
    if path.is_dir():
        documents = documents_in(path)
        if len(documents) != 1:
            held = ", ".join(file.name for file in documents) or f"none of {', '.join(NAMES)}"
            raise InputError(f"{path} holds {held}: name the file", "loading.folder")
        (path,) = documents

    def kind_of(name: str) -> type[Document]:
        if name not in KINDS:
            message = f"{path}: no document of cavirheo ({', '.join(NAMES)}); curves are not read from JSON: save a CSV"
            raise InputError(message, "document.other")
        return resolve_name(KINDS[name][0])

    loaded = read_json(path, kind_of)
    if not isinstance(loaded, kind):
        wanted = kind.model_fields["kind"].default if issubclass(kind, Document) else kind.__name__
        raise InputError(f"{path} is a {loaded.kind}, not a {wanted}: give another file", "loading.kind")
    return loaded


def documents_in(folder: Path) -> list[Path]:
    """The documents of a folder that have their usual names."""
    return [folder / name for name in NAMES if (folder / name).is_file()]


def document_of(path: Path) -> Path | None:
    """The document that a path is, holds or is made of (a table or report); None of other files."""
    if isdir(path):
        return next(iter(documents_in(path)), None)
    made = path.name == "result.csv" or path.suffix.lower() in (".html", ".htm")
    document = path.with_name("result.json") if made else path
    return document if document.name in NAMES and isfile(document) else None


def print_table(document: Document, folder: Path = Path()) -> None:
    """Print the table of a document of this folder, as its verb and `cavirheo show` do."""
    how = {"out": folder} if document.kind == "result" else {}
    resolve_name(KINDS[document.kind][1])(document, **how)
