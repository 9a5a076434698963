"""File in, result.json out: the documented endpoint `/infer` for programs (docs/app.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cavirheo.app import steps
from cavirheo.app.session import Session, Settings, Visitors


def infer(visitors: Visitors, files: list[Path], settings: Settings) -> dict[str, Any]:
    """The content of result.json for these uploaded files; nothing is kept.

    Raises:
        InputError: no curve in the files, too many, or a setting out of its domain.
    """
    session = Session(visitors.limits, visitors.reader)
    try:
        session.add(files, settings)
        if not session.curves:
            from cavirheo.errors import InputError

            raise InputError("; ".join(session.problems) or "no curve could be read")
        steps.infer(session, [curve.name for curve in session.curves], lambda *_: None)
        assert session.result is not None
        document = session.result
        document.notes.extend(session.problems)
        return document.model_dump(by_alias=True, mode="json")
    finally:
        session.close()
