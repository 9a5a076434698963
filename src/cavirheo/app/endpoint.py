"""What comes from outside: uploaded files, mistakes, and the documented endpoint `/infer` (docs/how-to/app.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import gradio as gr
from gradio.components.api_component import Api
from gradio.utils import get_upload_folder

from cavirheo.app import steps, words
from cavirheo.app.session import PageSettings, Session, Visitors
from cavirheo.errors import InputError, SolverError, require
from cavirheo.inference import DEFAULT


@contextmanager
def uploaded(files: Sequence[str]) -> Iterator[list[Path]]:
    """What the browser sent, and no other file of this machine: what is not taken over is removed."""
    folder = Path(get_upload_folder()).resolve()
    paths = [Path(file).resolve() for file in files]
    if not all(path.is_relative_to(folder) and path.is_file() for path in paths):
        raise InputError("only uploaded files are read", "app.not_uploaded")
    try:
        yield paths
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


class Served(gr.Blocks):
    """A page whose programs need not give what has a default."""

    def validate_inputs(self, block_fn: Any, inputs: list[Any]) -> None:
        inputs += [one.value for one in block_fn.inputs[len(inputs) :] if isinstance(one, Api)]
        super().validate_inputs(block_fn, inputs)


def public(visitors: Visitors) -> Callable[..., Any]:
    """The function that programs may call; nothing of a call is kept."""

    def infer(
        files: list[gr.FileData], model: str = DEFAULT, medium: str = "water", density: float | None = None,
        rmax_um: float | None = None, stretch: float | str | None = None, window: int | None = None,
        verify: str = "auto", material: str = "nhkv", bubble: str = "real", trust_input: bool = False,
    ) -> dict:  # fmt: skip
        """Measured radius histories in, the content of result.json out; options as those of `cavirheo infer`."""
        given: dict[str, Any] = {**locals()}
        options = {one.name: given[one.name] for one in fields(PageSettings) if given.get(one.name) is not None}
        session = Session(visitors.limits, visitors.reader, store=visitors.store)
        try:
            with uploaded([str(dict(file)["path"]) for file in files or []]) as paths:
                session.add(paths, PageSettings(**options))
                require(not session.waiting, f"{session.waiting}: send measured.csv of `cavirheo measure`", "app.film")
                problem = "; ".join(session.problems) or "no curve could be read"
                require(bool(session.curves), problem, "app.no_curve")
                document = steps.infer(session, [curve.name for curve in session.curves]).document
                document.notes.extend(session.problems)
                return document.model_dump(by_alias=True, mode="json")
        except (InputError, SolverError) as error:
            raise gr.Error(words.told(error), title="Not done", print_exception=False) from None
        finally:
            visitors.end(session)

    return infer
