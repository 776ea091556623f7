"""Base class of all settings, and validation of files with one line for each error."""

import json
import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    TypeVar,
    get_args,
    get_origin,
)

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.config import ExtraValues
from pydantic.fields import FieldInfo

from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.readers import SCHEMA, read_yaml

BOUND_WORDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
COMPARED = {"ge": operator.ge, "gt": operator.gt, "le": operator.le, "lt": operator.lt}
OUT_OF_RANGE = {"greater_than_equal", "greater_than", "less_than_equal", "less_than"}
SMALLER_UNITS = {"m": "mm", "s": "ms", "m/s": "mm/s", "kg/m^2": "g/m^2"}  # a thousandth


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a settings field, given in `Annotated` and named in errors on its
    bounds.
    """

    name: str


Metres = Annotated[float, Unit("m")]
Seconds = Annotated[float, Unit("s")]
Speed = Annotated[float, Unit("m/s")]
Share = Annotated[float, Field(gt=0, le=1)]
"""Fraction of a whole, more than nothing of it."""


class Settings(BaseModel):
    """Base class of all settings: frozen, unknown keys forbidden, finite numbers
    only.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class VersionedFile(Settings):
    """Base class of the contents of files that state the version of their format."""

    schema_: Literal[1] = Field(1, alias="schema")


class StudyResult(VersionedFile):
    """Base class of the data files that a study of the laboratory fits and writes.

    `source` says from what, `belongs_to` is the place of the file.
    """

    source: str
    belongs_to: str

    @classmethod
    @cache
    def shipped(cls) -> Self:
        """Content of the class's data file (`FILE`) that ships with the package."""
        return load(cls.FILE, cls)

    FILE: ClassVar[Path]


S = TypeVar("S", bound=BaseModel)


def parse(
    content: object, model: type[S], origin: str, extra: ExtraValues | None = None
) -> S:
    """Validate `content` as a `model`; raises ConfigurationError with a line for each
    problem.

    A line reads `origin: key: reason`. Nothing is converted: text and booleans are not
    numbers. Validated as JSON, where tuples are given as lists. `extra` replaces what
    the model does with unknown keys, which a program of another version may have
    written.
    """
    if not isinstance(content, Mapping):
        raise ConfigurationError(f"{origin}: must be a mapping of keys to values")
    schema = content.get("schema", SCHEMA)
    if isinstance(schema, int) and schema > SCHEMA:
        raise ConfigurationError(
            f"{origin}: schema: is {schema}, this version reads {SCHEMA}; update the"
            " cell"
        )
    try:
        return model.model_validate_json(
            _json(content, origin), strict=True, extra=extra
        )
    except ValidationError as error:
        items = [dict(item) for item in error.errors()]
        lines = [
            _problem(origin, model, item)
            for item in items
            if not _is_follow_up(item, items)
        ]
        raise ConfigurationError("\n".join(lines)) from None


def load(path: Path, model: type[S], *, bare: bool = False) -> S:
    """Read the YAML file at `path` as a `model`; unless `bare`, it must state its
    `schema`.

    Raises ConfigurationError with a line for each problem.
    """
    content = read_yaml(path)
    _check_kind(content, model, str(path))
    if not bare and "schema" not in content and "schema_" in model.model_fields:
        raise ConfigurationError(
            f"{path}: schema: is missing; add it: this version reads schema: {SCHEMA}"
        )
    return parse(content, model, str(path))


def _check_kind(
    content: Mapping[str, Any], model: type[BaseModel], origin: str
) -> None:
    """Raise ConfigurationError for `content` with no key, other than `name`, that
    `model` needs.
    """
    fields = model.model_fields.items()
    needed = [field.alias or name for name, field in fields if field.is_required()]
    if len(needed) > 1 and not content.keys() & set(needed) - {"name"}:
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", model.__name__).lower()
        raise ConfigurationError(
            f"{origin}: is no {kind}: it holds none of {', '.join(needed)}; give the"
            " right file"
        )


def _json(content: Mapping[str, Any], origin: str) -> str:
    try:
        return json.dumps(content, default=str)
    except (ValueError, TypeError, RecursionError) as error:
        raise ConfigurationError(f"{origin}: cannot be read: {error}") from None


def _is_follow_up(item: dict[str, Any], items: list[dict[str, Any]]) -> bool:
    """Whether error `item` is a list too short only because its own items were
    refused.
    """
    location = item["loc"]
    inner = (error["loc"] for error in items if len(error["loc"]) > len(location))
    return item["type"] == "too_short" and any(
        loc[: len(location)] == location for loc in inner
    )


def _problem(origin: str, model: type[BaseModel], item: dict[str, Any]) -> str:
    """Text for one validation error: `origin: key: reason`, with the allowed values."""
    key = ".".join(str(part) for part in item["loc"]) or "file"
    if item["type"] == "extra_forbidden":
        inner = _model_at(model, item["loc"][:-1])
        fields = {} if inner is None else inner.model_fields
        allowed = sorted(field.alias or name for name, field in fields.items())
        hint = suggestion(str(item["loc"][-1]), allowed)
        return (
            f"{origin}: {key}: unknown key{hint}; allowed here:"
            f" {', '.join(allowed) or 'none'}"
        )
    if item["type"] == "missing":
        return f"{origin}: {key}: is missing; add it"
    if item["type"] in OUT_OF_RANGE:
        return f"{origin}: {key}: {_out_of_range(item, _field_at(model, item['loc']))}"
    if item["input"] is None:
        field = _field_at(model, item["loc"])
        missing = "its value" if field is None else field.description or "its value"
        return f"{origin}: {key}: is null, not yet filled in; write {missing}"

    reason = str(item["msg"]).removeprefix("Value error, ")
    return (
        f"{origin}: {key}: {reason[:1].lower()}{reason[1:]} (found"
        f" {item['input']!r:.60})"
    )


def _out_of_range(item: dict[str, Any], field: FieldInfo | None) -> str:
    """Text on a number out of bounds, with the unit probably meant if a thousandth of
    it fits.
    """
    value = item["input"]
    facts = [] if field is None else field.metadata
    unit = next((f" {fact.name}" for fact in facts if isinstance(fact, Unit)), "")
    bounds = {
        name: getattr(fact, name)
        for fact in facts
        for name in BOUND_WORDS
        if hasattr(fact, name)
    }
    if not bounds:
        bounds = {
            name: item["ctx"][name] for name in BOUND_WORDS if name in item["ctx"]
        }

    words = " and ".join(
        f"{BOUND_WORDS[name]} {bound:g}{unit}" for name, bound in bounds.items()
    )
    text = f"is {value:g}{unit}, must be {words}"
    small = SMALLER_UNITS.get(unit.strip())
    if small and all(
        COMPARED[name](value / 1e3, bound) for name, bound in bounds.items()
    ):
        text += f"; if {value:g} is in {small}, write {value / 1e3:g}"

    return text


def _field_at(model: type[BaseModel], location: tuple[Any, ...]) -> FieldInfo | None:
    """Field of `model` at `location`, a path of keys; None for an item of a list or
    mapping.
    """
    inner = _model_at(model, location[:-1])
    return None if inner is None else inner.model_fields.get(location[-1])


def _model_at(
    model: type[BaseModel], location: tuple[Any, ...]
) -> type[BaseModel] | None:
    """Model class at `location`, keys and indices, within `model`; None where there is
    none.
    """
    current: Any = model
    for part in location:
        if not isinstance(part, int):  # the items of a list are of one model
            field = getattr(current, "model_fields", {}).get(part)
            current = None if field is None else _model_in(field.annotation)
    return current if hasattr(current, "model_fields") else None


def _model_in(annotation: Any) -> Any:
    """Only model class in a field's annotation, of the value or its items; None if
    none.
    """
    if hasattr(annotation, "model_fields"):
        return annotation
    origin = get_origin(annotation)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return None  # keys of its own stand between
    models = {*map(_model_in, get_args(annotation))} - {None}
    return models.pop() if len(models) == 1 else None
