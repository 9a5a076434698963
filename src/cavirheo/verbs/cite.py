"""`cavirheo cite`: the paragraph of a paper's methods section for a result, and the references as BibTeX."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError, require
from cavirheo.verbs.options import argument


def cite(result: Annotated[Path, argument("RESULT", "a result.json, or the folder that holds one")]) -> None:
    """What a paper must say about a result: models, window, priors, method, versions; and the references as BibTeX."""
    from cavirheo.loading import load
    from cavirheo.reporting.citation import methods
    from cavirheo.reporting.record import Result

    found = load(result)
    if not isinstance(found, Result):
        kind = type(found).__name__.lower()
        message = f"{result} is a document of another kind ({kind}): give the result.json of infer or fit"
        raise InputError(message, "cite.kind")
    paragraph, sources = methods(found)
    require(bool(paragraph), "no curve of this result has an answer: there is nothing to cite", "cite.nothing")
    print("\n\n".join([paragraph, *(source.bibtex for source in sources)]))
