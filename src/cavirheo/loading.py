"""What cavirheo wrote, read back: documents and training sets, told apart by what they hold."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from cavirheo.errors import InputError, as_path, expect, require
from cavirheo.files import read_object
from cavirheo.writing.document import LARGEST, Document, read_json

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.training.dataset import Dataset

Wanted = TypeVar("Wanted", bound="Document | Dataset")

_KINDS = {  # a key that no other document has, and the class of the document
    "measured_with": ("video.document", "Measured"),
    "tolerance": ("companions.rheometer.document", "Rheometry"),
    "wanted_percent": ("companions.design_document", "Design"),
    "worst": ("companions.network_design", "NetworkDesign"),
    "medium": ("companions.collapse_times", "CollapseTimes"),
    "laws": ("reporting.laws", "Laws"),
    "curves": ("reporting.record", "Result"),
}
_NAMES = (
    "result.json",
    "laws.json",
    "rheometer.json",
    "collapse-time.json",
    "measure.json",
    "design.json",
    "network-design.json",
)


@overload
def load(path: str | Path) -> Result | Any: ...  # so that a name which no Result has is noticed, and others may come


@overload
def load(path: str | Path, kind: type[Wanted]) -> Wanted: ...


def load(path: str | Path, kind: type[Any] | None = None) -> Any:
    """A document (`Result`, `Laws`, `Measured`, `Rheometry`, `CollapseTimes`) or a training set.

    Args:
        path: a file of any name, a folder with one, or a folder of `cavirheo generate`.
        kind: the class that is wanted, and no other; default: whichever is there, and a `Result` to type checkers.

    Returns:
        The object that was written. Numbers are SI, as in the file.

    Raises:
        InputError: nothing there, nothing that cavirheo wrote, or another kind.
    """
    expect(object if kind is None else kind, type, "a class such as Result, of cavirheo.reporting.record")
    found = _load(path)
    if kind is not None and not isinstance(found, kind):
        message = f"{path} is a {type(found).__name__}, not a {kind.__name__}: give another file, or leave out the kind"
        raise InputError(message, "loading.kind")
    return found


def _load(path: str | Path) -> Document | Dataset:
    path = as_path(path)
    if path.is_dir():
        if any(path.glob("shard-*.h5")):
            from cavirheo.training import dataset

            return dataset.load(path)
        found = [path / name for name in _NAMES if (path / name).is_file()]
        held = ", ".join(one.name for one in found) or f"none of {', '.join(_NAMES)}, and no training set"
        require(len(found) == 1, f"{path} holds {held}: name the file", "loading.folder")
        (path,) = found
    try:
        content = read_object(path, LARGEST)
    except InputError as error:
        if error.code != "files.json":
            raise
        content = {}
    keys = set(content)
    if isinstance(content.get("curves"), list):
        keys |= {"laws"} & {key for row in content["curves"] if isinstance(row, dict) for key in row}
    for key, (module, kind) in _KINDS.items():
        if key in keys:
            return read_json(path, getattr(import_module(f"cavirheo.{module}"), kind))
    message = f"{path}: a comparison of an earlier version; `cavirheo compare` writes result.json: run it again"
    require("reference_methods" not in keys, message, "document.other")
    raise InputError(f"{path}: no document of cavirheo ({', '.join(_NAMES)})", "document.other")
