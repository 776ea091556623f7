"""Files that a person writes: read safely, checked strictly, refused in one line."""

import json
import re
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from drivers.errors import ConfigurationError

SCHEMA = 1


class Settings(BaseModel):
    """Base of all configuration: frozen, no unknown key, no silent conversion from text."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


S = TypeVar("S", bound=BaseModel)


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file; a missing, broken or non-mapping file is a ConfigurationError."""
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _StrictLoader)  # noqa: S506
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigurationError(f"{path}: is not UTF-8 text; save it as UTF-8") from None
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {_yaml_place(error)}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"{path}: must be a mapping of keys to values")
    return content


class _StrictLoader(yaml.SafeLoader):
    """The safe loader, which also refuses a key that is given twice and reads 1e-3 as a number."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Hashable] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                problem = "a key must be a word"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            if key.value in seen:
                problem = f"key {key.value!r} is given twice; keep one"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


# YAML 1.1, which the loader speaks, wants a dot where nobody writes one. The sign stays needed:
# without it an id of digits and an e would be a number.
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+[eE][-+]\d+$"), list("-+0123456789")
)


def parse(content: object, model: type[S], origin: str) -> S:
    """`content` as `model`; ConfigurationError names every problem as `origin: key: reason`.

    Nothing is converted: text and truth values are no numbers. Read as JSON, because there a
    list is what tuples are given as.
    """
    if not isinstance(content, Mapping):
        raise ConfigurationError(f"{origin}: must be a mapping of keys to values")
    schema = content.get("schema", SCHEMA)
    if isinstance(schema, int) and schema > SCHEMA:
        raise ConfigurationError(
            f"{origin}: schema: is {schema}, this version reads {SCHEMA}; update the cell"
        )
    try:
        return model.model_validate_json(json.dumps(content, default=str), strict=True)
    except ValidationError as error:
        lines = [_problem(origin, model, dict(item)) for item in error.errors()]
        raise ConfigurationError("\n".join(lines)) from None


def load(path: Path, model: type[S]) -> S:
    """The file at `path` read and checked as `model`."""
    return parse(read_yaml(path), model, str(path))


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
