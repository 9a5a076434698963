"""The recipe of a posterior network: laws and bubbles, sizes, and what is shown at a step."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, PositiveFloat, PositiveInt

from cavirheo.errors import require
from cavirheo.inference.latent import BUBBLE_NAMES, CAMERA, COORDINATES, used
from cavirheo.inference.law import Family
from cavirheo.parameters import PARAMETERS
from cavirheo.training.recipe import DataTable, ExportTable, Section, Seed


class OftenTable(Section):
    """A share of the curves is drawn from these ranges alone, SI."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")
    share: Annotated[float, Field(gt=0, lt=1)]

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        return {name: (float(low), float(high)) for name, (low, high) in (self.model_extra or {}).items()}


class PosteriorTable(Section):
    """What the curves of a posterior network are drawn from.

    laws, bubbles: shares of the curves by name. max_radius_um: ends of its range. more: where a share of the curves is
    drawn from.
    """

    laws: dict[str, PositiveFloat] = Field(min_length=1)
    bubbles: dict[Literal["field", "real"], PositiveFloat] = Field({"field": 0.35, "real": 0.65}, min_length=1)
    max_radius_um: Annotated[tuple[PositiveFloat, PositiveFloat], Field(strict=False)] = (25.0, 650.0)
    more: OftenTable | None = None

    @property
    def kinds(self) -> list[tuple[str, str, float]]:
        """(law, bubble, share) in the network's order."""
        laws, bubbles = self.laws.items(), self.bubbles.items()
        return [(law, bubble, share * of_bubble) for law, share in laws for bubble, of_bubble in bubbles]

    def check(self) -> None:
        """Raises InputError: a range without width or beyond the prior's, or a law that the coordinates cannot hold."""
        low, high = self.max_radius_um
        require(low < high, f"max_radius_um must be [low, high] with low < high, got {low:g}, {high:g}", "recipe.value")
        ranges = {"max_radius": (1e-6 * low, 1e-6 * high)}
        for law, bubble, _ in self.kinds:
            try:
                names = {*Family(law).parameters, "stretch", *BUBBLE_NAMES[bubble], *CAMERA}
                fits = len({*used(law, bubble)}) == len(names)
            except ValueError:
                fits = False
            message = f"the law {law!r} has parameters that share a slot or have none (slots: {', '.join(COORDINATES)})"
            require(fits, message, "recipe.value")
            for name in sampled_parameters(law, bubble):
                low, high = PARAMETERS[name].searched or (0.0, 0.0)
                ranges[name] = 10.0**low, 10.0**high
        for name, pair in ((self.more.model_extra or {}) if self.more else {}).items():
            numbers = isinstance(pair, list) and len(pair) == 2 and all(isinstance(end, int | float) for end in pair)
            fine = name in ranges and numbers
            slack = 1.0 + 1e-5
            fine = fine and ranges[name][0] / slack <= pair[0] < pair[1] <= ranges[name][1] * slack
            message = f"more.{name} must be one of {', '.join(ranges)}, with [low, high] in its range, got {pair}"
            require(fine, message, "recipe.value")


class PosteriorNetworkTable(Section):
    width: Annotated[int, Field(ge=8, le=4096)] = 384
    depth: Annotated[int, Field(ge=1, le=100)] = 5
    hidden: Annotated[int, Field(ge=4, le=1024)] = 64
    parts: Annotated[int, Field(ge=1, le=100)] = 8


class PosteriorTrainingTable(Section):
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


class PosteriorRecipe(Section):
    posterior: PosteriorTable
    data: DataTable
    network: PosteriorNetworkTable = PosteriorNetworkTable()
    training: PosteriorTrainingTable
    export: ExportTable

    @property
    def problem(self) -> PosteriorTable:
        """What the curves are drawn from."""
        return self.posterior

    def settings(self) -> dict[str, Any]:
        """All that decides the trained weights, apart from the number of curves and of steps."""
        return self.posterior.model_dump(mode="json", exclude_none=True) | self.network.model_dump()

    def check(self) -> None:
        """Raises InputError as `PosteriorTable.check`."""
        self.posterior.check()


def sampled_parameters(law: str, bubble: str) -> tuple[str, ...]:
    """What is drawn uniformly in log10 for a curve of this law and bubble, R_max apart."""
    return (*Family(law).parameters, "stretch", *(["accommodation"] if "accommodation" in BUBBLE_NAMES[bubble] else []))
