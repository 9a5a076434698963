"""`cavirheo models`: the shipped networks, from their cards; and all that the card of one says, for `cavirheo show`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
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
        from cavirheo.inference.model import PosteriorCard
        from cavirheo.inference.posterior_network import describe as known

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


def explain(name: str, path: Path, about: dict[str, Any]) -> None:
    """Print all that the card of a model knows, a line each. Raises KeyError, TypeError, ValueError: it lacks something
    that every card has."""
    from cavirheo.verbs.versions import checksum

    known = _of_draws(about) if about["kind"] == "posterior" else _of_values(about)
    what = "draws of the parameters, for any camera" if about["kind"] == "posterior" else "one value each, no interval"
    lines = [f"{name}: {what}"]
    lines += [f"  {title + ':' if title else '':<15}{said}" for title, said in (*known, *_made(about))]
    size = f"{path.stat().st_size / 1e6:.3g} MB" + _counted(about.get("network", {}), "parameters", " weights")
    lines += [f"  {'file:':<15}{path}, {size}", f"  {'':<15}sha256 {checksum(path)}"]
    lines += [f"  {'card:':<15}{path.with_suffix('.json')}"]
    print(printable("\n".join(lines)))


def _of_draws(about: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from cavirheo.inference.law import Family

    losses = dict(zip(map(tuple, about["kinds"]), about.get("loss_by_kind", ()), strict=False))
    laws = dict.fromkeys(law for law, _ in about["kinds"])
    bubbles = {law: " or ".join(bubble for of, bubble in about["kinds"] if of == law) for law in laws}
    yield from _under(
        "answers", [f"{law} ({', '.join(Family(law).parameters)}), bubble {bubbles[law]}" for law in laws]
    )
    names = dict.fromkeys(name for law in laws for name in Family(law).parameters)
    kinetic = ["accommodation"] * any(bubble == "real" for _, bubble in about["kinds"])
    real = "; real bubble: accommodation and confinement damping"
    yield "", "with each: stretch, R_max, clock and scale" + real * bool(kinetic)
    yield from _under("ranges", map(_range, [*names, "stretch", *kinetic]))
    units = {"max_radius_um": ("R_max", "um"), "frame_interval_us": ("time between frames", "us")}
    trained = []
    for name, (low, high) in about["trained"].items():
        what, unit = units.get(name, (name.replace("_", " "), {"density": "kg/m3", "pressure": "Pa"}.get(name, "")))
        trained.append(f"{what.replace(' rmax', ' R_max')} {low:g} to {high:g} {unit}".rstrip())
    yield from _under("trained on", trained)
    how = about["training"]
    yield "", f"{how['samples']} recordings" + _counted(how, "curves", " simulated curves", " of ")
    yield "training", _time(how) + _counted(how, "held_out", " curves held out")
    yield "loss", f"{how['loss']:.4g} (-log density of the truth, curves held out)"
    for law in laws:
        each = ", ".join(f"{bubble} {loss:g}" for (of, bubble), loss in losses.items() if of == law)
        if each:
            yield "", f"{law} {each}"
    coverage = about.get("coverage", {})
    inside = {
        name: ", ".join(f"{value:.1%} in the {level} % interval" for level, value in share.items())
        for name, share in coverage.get("by_slot", {}).items()
    }
    yield from _under("coverage", [f"{name.replace('_', ' ')} {shares}" for name, shares in inside.items()])
    if "recordings" in coverage:
        yield "", f"of the truth of {coverage['recordings']} recordings, without simulations"


def _of_values(about: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    data, how, problem = about["data"], about["training"], about["problem"]
    answers = []
    for output in about["outputs"]:
        low, high = problem["prior"][output["name"]]
        if output["scale"] == "log10":
            low, high = 10**low, 10**high
        score, what = about["metrics"][output["name"]], output["name"].removeprefix("log10_")
        off = f", median error {score['median_relative_error']:.1%}" if "median_relative_error" in score else ""
        said = f"{what} {low:g} to {high:g} {output['unit']}, R2 {score['r2']:.4f} ({output['scale']} scale){off}"
        answers.append(said)
    yield from _under("answers", answers)
    medium, camera = problem["medium"], problem["camera"]
    yield "law", f"{about['material']}, field's bubble"
    inner = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in problem["prior"].items()
                      if not any(name == output["name"] for output in about["outputs"]))  # fmt: skip
    yield "trained on", f"R_max {1e6 * problem['reference_max_radius']:g} um" + (f", {inner}" if inner else "")
    yield "", f"{camera['frames']} frames of {1e6 * camera['frame_interval']:g} us from R_max on"
    yield "", f"{medium.get('name') or 'a medium'}: {medium['density']:g} kg/m3, {medium['pressure']:g} Pa"
    parts = _counted(data, "validation", " to choose the epoch") + f", {data['test']} for the scores"
    yield "", f"{data['train']} simulated curves{parts}"
    passes = f"{how['epochs']} epochs, the best is {how['best_epoch']}" if "epochs" in how else ""
    yield "training", ", ".join(filter(None, [passes, _time(how)]))
    best = how["best_epoch"] - 1
    losses = [f"{part} {values[best]:.4g}" for part, values in about.get("history", {}).items() if len(values) > best]
    if losses:
        yield "loss", f"{', '.join(losses)} (mean square error, best epoch)"


def _under(title: str, lines: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Several lines with one title, which stands before the first."""
    for line in lines:
        yield title, line
        title = ""


def _made(about: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    libraries = about.get("made_with") or about.get("versions") or {}
    made = ", ".join([*([about["date"]] if "date" in about else []), *(f"{a} {b}" for a, b in libraries.items())])
    if made:
        yield "made", made
    if "license" in about:
        yield "license", about["license"]


def _range(name: str) -> str:
    from cavirheo.parameters import about

    known = about(name)
    if known.searched is None:
        return name
    low, high = (10.0**end for end in known.searched)
    return f"{name} {low:.3g} to {high:.3g}{'' if known.unit == '1' else ' ' + known.unit}"


def _counted(of: Mapping[str, Any], key: str, what: str, before: str = ", ") -> str:
    return f"{before}{of[key]}{what}" if key in of else ""


def _time(how: Mapping[str, Any]) -> str:
    """'4400 s (1.2 h) on cpu'."""
    if "seconds" not in how:
        return "time not on the card"
    return f"{how['seconds']:.0f} s ({how['seconds'] / 3600:.2g} h)" + _counted(how, "device", "", " on ")
