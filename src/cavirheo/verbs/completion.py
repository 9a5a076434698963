"""What a shell offers for the value of an option; nothing here imports a compiler, a network or the solver."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path

_MODELS = Path(__file__).parents[1] / "models"  # their files: to read their cards takes longer than a key should


def _completing(words: Callable[[], Iterable[str]], between: str = "") -> Callable[[str], list[str]]:
    """The words that continue what is typed; where several may be given, from what follows the last separator."""

    def complete(incomplete: str) -> list[str]:
        start = max((incomplete.rfind(mark) for mark in between), default=-1) + 1
        prefix, beginning = incomplete[:start], incomplete[start:]
        prefix += beginning[: len(beginning) - len(beginning.lstrip())]
        used = prefix.replace(",", " ").split() if "," in between else []
        return [prefix + word for word in words() if word.startswith(beginning.strip()) and word not in used]

    return complete


def _laws() -> Iterable[str]:
    from cavirheo.physics.materials import LAWS

    return LAWS


def _fitted() -> list[str]:
    """`ABLE` of inference/law, which takes a second to import: parameters have a range or a default."""
    from cavirheo.parameters import PARAMETERS, inferred_as
    from cavirheo.physics.materials import LAWS

    def able(name: str) -> bool:
        parameters = inspect.signature(LAWS[name]).parameters.values()
        return all(PARAMETERS[inferred_as(p.name)].searched or p.default is not p.empty for p in parameters)

    return [name for name in LAWS if able(name)]


def _media() -> Iterable[str]:
    from cavirheo.physics.media import MEDIA

    return MEDIA


bubble_names = _completing(lambda: ("real", "field"), ",")
damage_names = _completing(lambda: ("none", "first-rebound", "strain"), ",")
figure_names = _completing(lambda: ("png", "svg", "pdf"), ",")
model_names = _completing(lambda: sorted(path.stem for path in _MODELS.glob("*.onnx")))
medium_names = _completing(_media)
any_law_names = _completing(_laws, "+")
sum_names = _completing(_fitted, "+")
many_law_names = _completing(_fitted, "+,")


def law_names(incomplete: str) -> list[str]:
    """Laws that can be fitted, also as the next part of a sum, and auto."""
    return [*sum_names(incomplete), *_completing(lambda: ["auto"])(incomplete)]
