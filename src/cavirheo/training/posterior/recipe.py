"""Recipe of a posterior network: one TOML file with the section [posterior], from laws to export."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, ValidationError

from cavirheo.errors import InputError, explained, require
from cavirheo.files import read_bytes
from cavirheo.inference.latent import BUBBLE_SLOTS, CAMERA, SLOTS, used
from cavirheo.inference.law import Family
from cavirheo.parameters import PARAMETERS
from cavirheo.training.recipe import LARGEST, DataTable, ExportTable, Seed


class _Table(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class More(_Table):
    """A share of the curves is drawn from these ranges alone, SI: `cavirheo design --for-training` finds them."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)
    share: Annotated[float, Field(gt=0, lt=1)]

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        return {name: (float(pair[0]), float(pair[1])) for name, pair in (self.model_extra or {}).items()}


class PosteriorTable(_Table):
    """laws, bubbles: shares of the curves by name. max_radius_um: ends of its range. more: where a share of the curves
    is drawn from."""

    laws: dict[str, PositiveFloat] = Field(min_length=1)
    bubbles: dict[Literal["field", "real"], PositiveFloat] = Field({"field": 0.35, "real": 0.65}, min_length=1)
    max_radius_um: tuple[PositiveFloat, PositiveFloat] = (25.0, 650.0)
    more: More | None = None

    @property
    def kinds(self) -> list[tuple[str, str, float]]:
        """(law, bubble, share) in the network's order."""
        laws, bubbles = self.laws.items(), self.bubbles.items()
        return [(law, bubble, share * of_bubble) for law, share in laws for bubble, of_bubble in bubbles]


class Sizes(_Table):
    width: Annotated[int, Field(ge=8, le=4096)] = 384
    depth: Annotated[int, Field(ge=1, le=100)] = 5
    hidden: Annotated[int, Field(ge=4, le=1024)] = 64
    parts: Annotated[int, Field(ge=1, le=100)] = 8


class Schedule(_Table):
    """samples: recordings that are shown in all, `batch` at a step. rate: of AdamW, after `warm_up` steps; it falls to
    nearly nothing in the last part `falling` of them."""

    samples: PositiveInt
    batch: PositiveInt = 256
    rate: PositiveFloat = 7e-4
    warm_up: PositiveInt = 600
    falling: Annotated[float, Field(gt=0, le=1)] = 0.2
    decay: Annotated[float, Field(ge=0)] = 0.01
    seed: Seed = 1

    @property
    def steps(self) -> int:
        return max(self.samples // self.batch, 1)

    def rate_at(self, step: int) -> float:
        left = (self.steps - step) / max(self.falling * self.steps, 1.0)
        return self.rate * min(1.0, (step + 1) / self.warm_up) * min(1.0, max(left, 0.0) + 0.003)


class PosteriorRecipe(_Table):
    posterior: PosteriorTable
    data: DataTable
    network: Sizes = Sizes()
    training: Schedule
    export: ExportTable

    def settings(self) -> dict[str, Any]:
        """All that decides the curves, as plain data."""
        return self.posterior.model_dump(mode="json", exclude_none=True)


def searched(law: str, bubble: str) -> tuple[str, ...]:
    """What is drawn uniformly in log10 for a curve of this law and bubble, R_max apart."""
    return (*Family(law).parameters, "stretch", *(["accommodation"] if "accommodation" in BUBBLE_SLOTS[bubble] else []))


def _check_more(table: PosteriorTable) -> None:
    """Raises InputError: a range of what is not drawn, or beyond that which is."""
    known = {"max_radius": tuple(1e-6 * end for end in table.max_radius_um)}
    for law, bubble, _ in table.kinds:
        names = searched(law, bubble)
        known |= {name: tuple(10.0**end for end in PARAMETERS[name].searched or ()) for name in names}
    for name, pair in ((table.more.model_extra or {}) if table.more else {}).items():
        message = f"more.{name} must be one of {', '.join(known)}, with [low, high] in its range, got {pair}"
        fine = name in known and isinstance(pair, list) and len(pair) == 2
        fine = fine and all(isinstance(end, int | float) for end in pair)
        slack = 1.0 + 1e-5
        require(fine and known[name][0] / slack <= pair[0] < pair[1] <= known[name][1] * slack, message, "recipe.value")


def posterior_recipe(path: str | Path) -> PosteriorRecipe | None:
    """The recipe in a TOML file, None if it is one of another kind (without [posterior]).

    Raises:
        InputError: an unknown key, a value missing or refused, or a law that the network's slots cannot hold.
    """
    try:
        content: Mapping[str, Any] = tomllib.loads(read_bytes(path, LARGEST).decode())
    except (ValueError, RecursionError):
        return None  # the reader of the other kind says what is wrong
    if "posterior" not in content:
        return None
    try:
        recipe = PosteriorRecipe.model_validate(content)
        low, high = recipe.posterior.max_radius_um
        require(low < high, f"max_radius_um must be [low, high] with low < high, got {low:g}, {high:g}", "recipe.value")
        _check_more(recipe.posterior)
        for law, bubble, _ in recipe.posterior.kinds:
            try:
                own = {*Family(law).parameters, "stretch", *BUBBLE_SLOTS[bubble], *CAMERA}
                fits = len({*used(law, bubble)}) == len(own)
            except ValueError:
                fits = False
            message = f"the law {law!r} has parameters that share a slot or have none (slots: {', '.join(SLOTS)})"
            require(fits, message, "recipe.value")
    except ValidationError as error:
        raise InputError(f"{path} cannot be used: {explained(error, PosteriorRecipe)}", "recipe.value") from error
    except InputError as error:
        raise error.within(f"{path} cannot be used") from error
    return recipe
