"""Base of all settings, and reading of YAML and JSON files with errors in one line."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from drivers.errors import ConfigurationError
from drivers.files import TEXT, read_text
from drivers.yaml_loader import BoundedLoader

SCHEMA = 1


class Settings(BaseModel):
    """Base of all configuration: frozen, unknown keys forbidden, no conversion from text."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


S = TypeVar("S", bound=BaseModel)


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file; a missing, broken or non-mapping file is a ConfigurationError."""
    text = read_text(path)
    try:
        content = yaml.load(text, BoundedLoader)  # noqa: S506  a safe loader, bounded besides
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {_yaml_place(error)}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {error}") from None
    except (AttributeError, LookupError, TypeError, ArithmeticError):
        # what the loader's own constructors raise for `!!timestamp x`, `!!int ""`, `!!bool x`
        raise ConfigurationError(
            f"{path}: is not valid YAML: a value is not what its !! tag says; leave tags out"
        ) from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"{path}: must be a mapping of keys to values")
    return content


def read_json(path: Path, most: int = TEXT) -> dict[str, Any]:
    """Mapping in a JSON file; a missing, broken or non-mapping file is a ConfigurationError."""
    text = read_text(path, most)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"{path}: must be a mapping of keys to values")
    return content


def parse(content: object, model: type[S], origin: str) -> S:
    """`content` validated as `model`; ConfigurationError lists every problem as `origin: key:
    reason`.

    Nothing is converted: text and booleans are not numbers. Validated as JSON, where tuples are
    given as lists.
    """
    if not isinstance(content, Mapping):
        raise ConfigurationError(f"{origin}: must be a mapping of keys to values")
    schema = content.get("schema", SCHEMA)
    if isinstance(schema, int) and schema > SCHEMA:
        raise ConfigurationError(
            f"{origin}: schema: is {schema}, this version reads {SCHEMA}; update the cell"
        )
    try:
        return model.model_validate_json(_json(content, origin), strict=True)
    except ValidationError as error:
        lines = [_problem(origin, model, dict(item)) for item in error.errors()]
        raise ConfigurationError("\n".join(lines)) from None


def load(path: Path, model: type[S], *, bare: bool = False) -> S:
    """The file at `path`, read and validated as `model`; must state its `schema` unless `bare`.

    Raises ConfigurationError, one line for each problem.
    """
    content = read_yaml(path)
    if not bare and "schema" not in content and "schema_" in model.model_fields:
        raise ConfigurationError(
            f"{path}: schema: is missing; add it: this version reads schema: {SCHEMA}"
        )
    return parse(content, model, str(path))


def _json(content: Mapping[str, Any], origin: str) -> str:
    try:
        return json.dumps(content, default=str)
    except (ValueError, TypeError, RecursionError) as error:
        raise ConfigurationError(f"{origin}: cannot be read: {error}") from None


def _problem(origin: str, model: type[BaseModel], item: dict[str, Any]) -> str:
    key = ".".join(str(part) for part in item["loc"]) or "file"
    if item["type"] == "extra_forbidden":
        allowed = ", ".join(_keys(model, item["loc"][:-1]))
        return f"{origin}: {key}: unknown key; allowed here: {allowed or 'none'}"
    if item["type"] == "missing":
        return f"{origin}: {key}: is missing; add it"
    reason = str(item["msg"]).removeprefix("Value error, ")
    return f"{origin}: {key}: {reason[:1].lower()}{reason[1:]} (found {item['input']!r:.60})"


def _keys(model: type[BaseModel], place: tuple[Any, ...]) -> list[str]:
    current: Any = model
    for part in place:
        field = getattr(current, "model_fields", {}).get(part)
        current = field.annotation if field is not None else None
    fields = getattr(current, "model_fields", {})
    return sorted(field.alias or name for name, field in fields.items())


def _yaml_place(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or "cannot be parsed"
    return f"line {mark.line + 1}: {problem}" if mark is not None else str(problem)
