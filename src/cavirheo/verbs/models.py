"""`cavirheo models`: the shipped networks, from their cards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cavirheo.writing.digits import printable


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.model import card, shipped

    for name, path in shipped().items():
        describe(name, path, card(path))


def describe(name: str, path: Path, about: dict[str, Any]) -> None:
    """Print what the card of a model says. Raises KeyError, TypeError, ValueError: it lacks something."""
    if about["kind"] == "posterior":
        from cavirheo.inference.card import PosteriorCard
        from cavirheo.inference.posterior_model import describe as known

        lines = known(PosteriorCard.model_validate(about))
        print(printable("\n".join([f"{name}: draws of the parameters, for any camera", *lines])))
        return
    lines = [f"{name}: {about['material']}, one value each without an interval"]
    for output in about["outputs"]:
        low, high = about["problem"]["prior"][output["name"]]
        if output["scale"] == "log10":
            low, high = 10**low, 10**high
        score = about["metrics"][output["name"]]["r2"]
        what = f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"
        lines.append(f"  {what:40s} R2 {score:.4f} ({output['scale']} scale, {about['data']['test']} test curves)")
    lines.append(f"  trained on {about['data']['train']} curves, {about['date']}; card: {path.with_suffix('.json')}")
    print(printable("\n".join(lines)))
