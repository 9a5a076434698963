"""What cavirheo wrote, read back: documents and training sets, told apart by what they say of themselves."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, overload

from cavirheo.errors import InputError, as_path, expect, require
from cavirheo.files import read_object
from cavirheo.writing.document import LARGEST, Document, read_json

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.training.dataset import Dataset

Loaded = TypeVar("Loaded", bound="Document | Dataset")


class Kind(NamedTuple):
    """A kind of document: where its class is, and the function that prints its table."""

    module: str
    name: str
    table: str


# by `kind`, which with the ending .json is the usual name of its file
KINDS = {
    "result": Kind("reporting.record", "Result", "reporting.table.print_all"),
    "laws": Kind("reporting.laws", "Laws", "reporting.laws.print_table"),
    "rheometer": Kind("companions.rheometer", "Rheometry", "companions.rheometer.print_rheometry"),
    "collapse-time": Kind("companions.collapse_times", "CollapseTimes", "companions.collapse_times.print_table"),
    "measure": Kind("video.document", "Measured", "video.document.print_table"),
    "design": Kind("companions.design", "Design", "companions.design.print_table"),
    "metrics": Kind("training.evaluate", "Metrics", "training.evaluate.print_metrics"),
    "training": Kind("training.evaluate", "TrainingRun", "training.evaluate.print_run"),
}
NAMES = tuple(f"{kind}.json" for kind in KINDS)


@overload
def load(path: str | Path) -> Result | Any: ...  # so that a name which no Result has is noticed, and others may come


@overload
def load(path: str | Path, kind: type[Loaded]) -> Loaded: ...


def load(path: str | Path, kind: type[Any] | None = None) -> Any:
    """A document (`Result`, `Laws`, `Measured`, ...: docs/file-formats.md) or a training set.

    Args:
        path: a file of any name, a folder with one, or a folder of `cavirheo generate`.
        kind: the class that the file must hold; default: any, and a `Result` to type checkers.

    Returns:
        The object that was written. Numbers are SI, as in the file.

    Raises:
        InputError: nothing there, nothing that cavirheo wrote, or another kind.
    """
    expect(object if kind is None else kind, type, "a class such as Result, of cavirheo.reporting.record")
    loaded = _load(path)
    if kind is not None and not isinstance(loaded, kind):
        message = f"{path} is a {type(loaded).__name__}, not a {kind.__name__}"
        raise InputError(f"{message}: give another file, or leave out the kind", "loading.kind")
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
    name = None
    try:
        name = read_object(path, LARGEST).get("kind")
    except InputError as error:
        if error.code != "files.json":
            raise
    message = f"{path}: no document of cavirheo ({', '.join(NAMES)})"
    require(isinstance(name, str) and name in KINDS, message, "document.other")
    kind = KINDS[str(name)]
    return read_json(path, getattr(import_module(f"cavirheo.{kind.module}"), kind.name))


def print_table(document: Document) -> None:
    """The table of a document, as its verb and `cavirheo show` print it."""
    module, _, name = KINDS[document.kind].table.rpartition(".")
    getattr(import_module(f"cavirheo.{module}"), name)(document)
