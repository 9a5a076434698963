"""Files of a run: tensors in safetensors with a JSON note (never pickle), written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from cavirheo.errors import InputError

NOTE = "cavirheo"


def write_tensors(path: Path, tensors: Mapping[str, Tensor], note: Mapping[str, Any]) -> None:
    """Put tensors and what is to be known about them into one file."""
    temporary = path.with_suffix(".tmp")
    content = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    save_file(content, temporary, metadata={NOTE: json.dumps(note)})
    os.replace(temporary, path)


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors and the note of `write_tensors`. Raises InputError if the file is not one of ours."""
    try:
        with safe_open(path, framework="pt") as file:
            note: dict[str, Any] = json.loads(file.metadata()[NOTE])
            return {name: file.get_tensor(name) for name in list(file.keys())}, note
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is not a checkpoint of cavirheo: {error!r}") from error


def write_text(path: Path, text: str) -> None:
    """Put text into a file that is never seen half-written."""
    temporary = path.with_suffix(".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """The first entry in which two nested settings differ, in words; empty if none does."""
    for key in new:
        before, after = old.get(key), new[key]
        if isinstance(before, dict) and isinstance(after, dict):
            if inner := difference(before, after):
                return f"{key}.{inner}"
        elif before != after:
            return f"{key} = {before!r}, where {after!r} is asked now"
    return ""
