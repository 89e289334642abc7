"""The params of the pipeline (``params.yaml``): typed, bounded, and refused when misspelt."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from isi.errors import InputError

Count = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Positive = Annotated[float, Field(gt=0)]
Option = int | float | bool | str


class Section(BaseModel):
    """A mapping of ``params.yaml``: no unknown keys, no silent conversions."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class AI2Thor(Section):
    recording: str
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Materials(Section):
    source: Literal["suncg", "simulator"]


class GraphParams(Section):
    min_count: Count


class Words(Section):
    source: str
    text: Literal["definition", "phrase"]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None


class Sessions(Section):
    seeds: Count
    sizes: Annotated[list[Count], Field(min_length=1)]
    valid: Fraction
    test: Fraction
    insert_fraction: Annotated[float, Field(gt=0, le=1)]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.valid + self.test >= 1:
            raise ValueError("valid and test together must leave something to train on (below 1)")
        if len(set(self.sizes)) < len(self.sizes):
            raise ValueError("sizes must not repeat")
        return self


class EmbeddingParams(Section):
    dimension: Annotated[int, Field(ge=4, multiple_of=4)]
    init_range: Positive


class Negatives(Section):
    mode: Literal["sampled", "expected"]
    ratio: Count
    head_pool: Literal["unseen", "all"]


class Optimizer(Section):
    batch_size: Count
    learning_rate: Positive
    weight_decay: Annotated[float, Field(ge=0)]
    max_epochs: Count


class Training(Optimizer):
    evaluate_every: Count
    patience: Count


class Convergence(Section):
    margin: Fraction


class Insert(Section):
    initializers: Annotated[list[str], Field(min_length=1)]


class NoOptions(Section):
    """An initializer without options."""


class TopK(Section):
    k: Count


class TopKOf(TopK):
    candidates: Count


class Initializers(BaseModel):
    """Options of each initializer; those of your own may be any scalars that their function takes."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)
    __pydantic_extra__: dict[str, dict[str, Option]] = Field(init=False)

    xavier: NoOptions
    iu: NoOptions
    es: TopK
    rs: TopK
    ers: TopKOf
    mean: NoOptions
    gaussian: NoOptions
    gaussian_centred: NoOptions
    es_permuted: TopK

    def options(self, name: str) -> dict[str, Option]:
        """The options of one initializer, as keyword arguments of its function."""
        options: dict[str, dict[str, Option]] = self.model_dump()
        return options.get(name, {})


class Curves(Section):
    sizes: list[Count]


class Compute(Section):
    workers: Count | Literal["all"]
    stack: Count
    engine: Literal["processes", "dask"] = "processes"
    scheduler: Annotated[str, Field(pattern=r"^tcp://[^/\s]+:[0-9]{1,5}$")] | None = None

    @model_validator(mode="after")
    def _dask_has_a_scheduler(self) -> Self:
        if self.engine == "dask" and self.scheduler is None:
            raise ValueError("engine dask needs the address of its scheduler: compute.scheduler: tcp://host:port")
        return self


class Params(Section):
    """Everything in ``params.yaml``."""

    seed: Annotated[int, Field(ge=0)]
    ai2thor: AI2Thor
    materials: Materials
    graph: GraphParams
    words: Words
    sessions: Sessions
    embedding: EmbeddingParams
    negatives: Negatives
    training: Training
    finetuning: Optimizer
    convergence: Convergence
    insert: Insert
    initializers: Initializers
    curves: Curves
    compute: Compute

    @model_validator(mode="after")
    def _initializers_have_options(self) -> Self:
        listed, given = self.insert.initializers, self.initializers.model_dump()
        unused = set(self.initializers.__pydantic_extra__) - set(listed)
        if unused:
            raise ValueError(f"initializers.{min(unused)}: not in insert.initializers, and none of those that ship")
        without = set(listed) - set(given)
        if without:
            raise ValueError(f"initializers.{min(without)}: expected its options ({{}} where it takes none)")
        if len(set(listed)) < len(listed) or "joint" in listed:
            raise ValueError("insert.initializers: expected names that do not repeat, none of them 'joint'")
        return self

    def pick(self, keys: tuple[str, ...]) -> dict[str, Any]:
        """The values at dotted keys, for example ``("sessions.seeds",)``; absent ones are null."""
        return {key: _at(self.model_dump(), key) for key in keys}


def load(path: Path) -> Params:
    """Read and check ``params.yaml``.

    Raises:
        InputError: where the file is missing, is no YAML, or holds an unknown key, a wrong type
            or a value out of range; the message gives the key's path.
    """
    try:
        raw = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))  # YAML 1.2, as DVC reads it
        return Params.model_validate(raw)
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from error
    except (YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}" if mark else ""
        raise InputError(path, place, f"expected YAML: {getattr(error, 'problem', error)}") from error
    except ValidationError as error:
        first = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")  # a misspelt key is missing, too
        key = ".".join(str(part) for part in first["loc"] if part != "[key]")
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        got = "" if first["type"] in ("missing", "extra_forbidden", "value_error") else f", got {first['input']!r}"
        raise InputError(path, key, first["msg"] + got + more) from error


def _at(values: Any, key: str) -> Any:
    for part in key.split("."):
        values = values.get(part) if isinstance(values, dict) else None
    return values
