"""Load what cavirheo wrote: documents, recognised by the kind that they state, and training sets."""

from __future__ import annotations

from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar, overload

from cavirheo.errors import InputError, as_path, expect, read_object, require
from cavirheo.writing.document import MAX_BYTES, Document, read_json

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.training.dataset import Dataset

Loaded = TypeVar("Loaded", bound="Document | Dataset")
# by `kind` (the usual file name is KIND.json): the class of the document, and the function that prints its table
KINDS = {
    "result": ("cavirheo.reporting.record.Result", "cavirheo.reporting.table.print_all"),
    "laws": ("cavirheo.reporting.laws.Laws", "cavirheo.reporting.laws.print_table"),
    "rheometer": ("cavirheo.companions.rheometer.Rheometry", "cavirheo.companions.rheometer.print_rheometry"),
    "collapse-time": (
        "cavirheo.companions.collapse_times.CollapseTimes",
        "cavirheo.companions.collapse_times.print_table",
    ),
    "measure": ("cavirheo.video.measurement.Measured", "cavirheo.video.measurement.print_table"),
    "design": ("cavirheo.companions.design.Design", "cavirheo.companions.design.print_table"),
    "metrics": ("cavirheo.training.evaluate.Metrics", "cavirheo.training.evaluate.print_metrics"),
    "training": ("cavirheo.training.evaluate.TrainingRun", "cavirheo.training.evaluate.print_run"),
}
NAMES = tuple(f"{kind}.json" for kind in KINDS)


@overload
def load(path: str | Path) -> Result | Any: ...  # type checkers then report a wrong name of a Result


@overload
def load(path: str | Path, kind: type[Loaded]) -> Loaded: ...


def load(path: str | Path, kind: type[Any] | None = None) -> Any:
    """Load a document (`Result`, `Laws`, `Measured`, ...: docs/file-formats.md) or a training set; values are SI.

    Args:
        path: a document with any file name, a folder with one document, or a folder of `cavirheo generate`.
        kind: the class that the file must hold; default: any class (type checkers see a `Result`).

    Raises:
        InputError: no such file, not a file of cavirheo, or another kind.
    """
    expect(object if kind is None else kind, type, "a class such as Result, of cavirheo.reporting.record")
    loaded = _load(path)
    message = f"{path} is a {type(loaded).__name__}, not a {getattr(kind, '__name__', kind)}"
    right = kind is None or isinstance(loaded, kind)
    require(right, f"{message}: give another file, or leave out the kind", "loading.kind")
    return loaded


def _load(path: str | Path) -> Document | Dataset:
    path = as_path(path)
    if path.is_dir():
        if any(path.glob("shard-*.h5")):
            from cavirheo.training import dataset

            return dataset.load(path)
        documents = [path / name for name in NAMES if (path / name).is_file()]
        held = ", ".join(document.name for document in documents) or f"none of {', '.join(NAMES)}, and no training set"
        require(len(documents) == 1, f"{path} holds {held}: name the file", "loading.folder")
        (path,) = documents
    try:
        name = str(read_object(path, MAX_BYTES).get("kind"))
    except InputError as error:
        if error.code != "files.json":
            raise
        name = ""
    require(name in KINDS, f"{path}: no document of cavirheo ({', '.join(NAMES)})", "document.other")
    return read_json(path, resolve_name(KINDS[name][0]))


def print_table(document: Document) -> None:
    """Print the table of a document, as its verb and `cavirheo show` do."""
    resolve_name(KINDS[document.kind][1])(document)
