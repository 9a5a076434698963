"""Recipe: one TOML file that states how a model is made, from the problem to the name of the export.

A recipe with the section [emulator] is for an emulator (`EmulatorRecipe`), any other for a network that gives one value
for each parameter (`PointRecipe`); its sections are the fields. [prior] holds one [low, high] for each parameter of the
material and for the stretch. `medium` is a name, or a table with a `name` and the values that replace those of this
medium (`unusual = true` accepts values that no liquid or gel has). [network] may be left out.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from reprlib import repr as short
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveFloat, PositiveInt, ValidationError

from cavirheo.errors import InputError, read_bytes, validation_message
from cavirheo.inference.network_files import Size, TrainingProblem
from cavirheo.physics.media import Medium, medium
from cavirheo.prior import Prior
from cavirheo.training.trajectories import DOMAIN

LARGEST = 50_000  # bytes of a recipe
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class Section(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class ProblemTable(Section):
    material: str
    medium: str | dict[str, Any] = "water"
    reference_max_radius_um: PositiveFloat = 245.0
    frame_interval_us: PositiveFloat = 1.0
    frames: PositiveInt = 100


class DataTable(Section):
    n: PositiveInt
    seed: Seed = 0


class NetworkTable(Section):
    """Sizes of the Bubble Dynamics Transformer; one choice that its description leaves open is marked."""

    position: Size = 64  # width of the learned embedding of a sample's place in the curve
    width: Size = 64
    heads: Size = 8
    head_width: Size = 8  # left open: 64 shared by 8 heads; the alternative is 64 per head
    feed_forward: Size = 128
    activation: Literal["relu", "softplus"] = "relu"  # of the feed-forward layers; the paper: softplus
    layers: Annotated[int, Field(gt=0, le=100)] = 2
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.1
    norm_epsilon: PositiveFloat = 1e-6


class TrainingTable(Section):
    epochs: Annotated[int, Field(gt=0, le=1_000_000)] = 100  # each shows all curves of the training part once
    batch: Annotated[int, Field(gt=0, le=1_000_000)] = 32
    lr: PositiveFloat = 1e-3  # learning rate after `warmup_steps`, to which it rises linearly
    constant: Annotated[float, Field(ge=0, lt=1)] = 0.0  # share of the steps before it falls to 0 as half a cosine
    seed: Seed = 0
    warmup_steps: NonNegativeInt = 0

    def learning_rate(self, step: int, steps: int) -> float:
        """Learning rate at `step` (from 0) of `steps`."""
        falling = max(step / steps - self.constant, 0.0) / (1.0 - self.constant)
        rate = self.lr * min(1.0, (step + 1) / max(1, self.warmup_steps))
        return rate * (0.5 * (1.0 + math.cos(math.pi * falling)))


class PointTrainingTable(TrainingTable):
    dropout_epochs: PositiveInt | None = None  # with dropout; None: all, which gives answers 3 to 7 % off scale


class ExportTable(Section):
    name: str = Field(pattern=r"^[a-z0-9][a-z0-9.-]*$", max_length=100)


class _Recipe(Section):
    data: DataTable
    export: ExportTable

    def settings(self) -> dict[str, Any]:
        """All settings that decide the trained weights, apart from the data, in types that JSON can hold."""
        return self.model_dump(mode="json", exclude_none=True, include={"network", "training"})


class PointRecipe(_Recipe):
    """Of a network that gives one value for each parameter."""

    problem_table: ProblemTable = Field(alias="problem")
    prior: dict[str, Annotated[tuple[float, float], Field(strict=False)]]  # [low, high] in the file
    network: NetworkTable = NetworkTable()
    training: PointTrainingTable = PointTrainingTable()

    @cached_property
    def problem(self) -> TrainingProblem:
        """The training problem. Raises InputError: the physics does not accept the values."""
        table = self.problem_table
        constants = {"name": table.medium} if isinstance(table.medium, str) else {"name": "water"} | table.medium
        names = [*(field.name for field in fields(Medium)), "unusual"]
        if unknown := ", ".join(constants.keys() - {*names}):
            raise InputError(f"[problem] medium: no constants {unknown}; there are {', '.join(names)}", "recipe.medium")
        liquid = medium(**constants)
        interval, reference = table.frame_interval_us / 1e6, table.reference_max_radius_um / 1e6
        return TrainingProblem(table.material, Prior.uniform(self.prior), liquid, interval, table.frames, reference)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the network's outputs in their order: all of the prior but the stretch."""
        return tuple(name for name in self.prior if name != "stretch")

    def settings(self) -> dict[str, Any]:
        return {"problem": self.problem.to_dict(), "outputs": list(self.outputs), **super().settings()}


class EmulatorNetworkTable(Section):
    """width: of the residual blocks, of which there are `depth`. components: principal ones of the trajectories."""

    width: Annotated[int, Field(ge=8, le=1024)] = 256
    depth: Annotated[int, Field(ge=1, le=100)] = 4
    components: Annotated[int, Field(ge=1, le=400)] = 128


class EmulatorRecipe(_Recipe):
    problem: ClassVar[Mapping[str, Any]] = DOMAIN  # what the bubbles are drawn from
    domain: Section = Field(alias="emulator")  # without keys: what bubbles are drawn from are constants
    network: EmulatorNetworkTable = EmulatorNetworkTable()
    training: TrainingTable = TrainingTable()

    def settings(self) -> dict[str, Any]:
        return {"domain": self.problem, **super().settings()}


Recipe = PointRecipe | EmulatorRecipe


def read_recipe(path: str | Path) -> Recipe:
    """Read the recipe in a TOML file.

    Raises InputError: the file is not readable or not TOML, has an unknown key, or a value is missing or not accepted.
    """
    content = read_bytes(path, LARGEST)
    kind: type[Recipe] = PointRecipe
    try:
        sections = tomllib.loads(content.decode())
        kind = EmulatorRecipe if "emulator" in sections else PointRecipe
        recipe = kind.model_validate(sections)
        _ = recipe.problem  # the physics may refuse its values
        return recipe
    except ValidationError as error:
        raise InputError(f"{path} cannot be used: {validation_message(error)}", "recipe.value") from error
    except InputError as error:
        raise error.within(f"{path} cannot be used") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8: save it as UTF-8 text ({error.reason})", "recipe.syntax") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {error}", "recipe.syntax") from error


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Text on the first entry of `new` that differs from `old`, both nested; empty if none differs."""
    for key in new:
        before, after = old.get(key), new[key]
        if isinstance(before, dict) and isinstance(after, dict):
            if inner := difference(before, after):
                return f"{key}.{inner}"
        elif before != after:
            return f"{key} = {short(before)}, where {short(after)} is asked now"
    return ""
