"""What a shell offers for the value of an option; nothing here imports a compiler, a network or the solver."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path


def _several(*words: str) -> Callable[[str], list[str]]:
    """These words, also after each comma."""
    return lambda incomplete: _continuations(incomplete, words, ",")


bubble_names = _several("real", "field")
damage_names = _several("none", "first-rebound", "strain")
figure_names = _several("png", "svg", "pdf")


def law_names(incomplete: str) -> list[str]:
    """Laws that can be fitted, also as the next part of a sum, and auto."""
    return [*sum_names(incomplete), *_continuations(incomplete, ["auto"])]


def model_names(incomplete: str) -> list[str]:
    """The shipped models, by their files: to read their cards takes longer than a key should."""
    models = (Path(__file__).parents[1] / "models").glob("*.onnx")
    return _continuations(incomplete, sorted(path.stem for path in models))


def medium_names(incomplete: str) -> list[str]:
    """The named sets of constants."""
    from cavirheo.physics.media import MEDIA

    return _continuations(incomplete, MEDIA)


def _laws_after(separators: str, *, fitted: bool = True) -> Callable[[str], list[str]]:
    """Laws, also after each separator. fitted: those that can be."""
    return lambda incomplete: _continuations(incomplete, _laws(fitted), separators)


sum_names = _laws_after("+")
many_law_names = _laws_after("+,")
any_law_names = _laws_after("+", fitted=False)


def _laws(fitted: bool) -> list[str]:
    """All, or `ABLE` of inference/law, which takes a second to import: parameters have a range or a default."""
    from cavirheo.parameters import PARAMETERS, inferred_as
    from cavirheo.physics.materials import LAWS

    def able(name: str) -> bool:
        parameters = inspect.signature(LAWS[name]).parameters.values()
        return all(PARAMETERS[inferred_as(p.name)].searched or p.default is not p.empty for p in parameters)

    return [name for name in LAWS if not fitted or able(name)]


def _continuations(incomplete: str, words: Iterable[str], between: str = "") -> list[str]:
    """The words that continue what is typed; where several may be given, from what follows the last separator."""
    start = max((incomplete.rfind(mark) for mark in between), default=-1) + 1
    prefix, beginning = incomplete[:start], incomplete[start:]
    prefix += beginning[: len(beginning) - len(beginning.lstrip())]
    used = prefix.replace(",", " ").split() if "," in between else []
    return [prefix + word for word in words if word.startswith(beginning.strip()) and word not in used]
