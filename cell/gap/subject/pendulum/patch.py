"""The pendulum file after acceptance."""

from collections.abc import Mapping
from typing import Any

from cell.gap.subject.pendulum.file import PendulumFile


def patched(
    pendulum: PendulumFile,
    base: Mapping[str, float],
    effects: Mapping[str, Mapping[str, float]],
    source: str,
) -> dict[str, object]:
    """File content with refitted base values and named effects; old values in provenance."""
    content: dict[str, Any] = pendulum.model_dump(mode="json", by_alias=True)
    notes = list(content.pop("provenance"))
    known = dict(content.pop("effects"))
    for name, value in base.items():
        if "." in name:
            effect, key = name.split(".")
            notes.append(_note(f"effects.{effect}.{key}", known[effect][key], source))
            known[effect] = {**known[effect], key: value}
            continue
        key, number = name.rsplit("_", 1)
        link = content["links"][int(number) - 1]
        notes.append(_note(f"links.{int(number) - 1}.{key}", link[key], source))
        link[key] = value
    for effect, values in effects.items():
        notes.append({"key": f"effects.{effect}", "source": source, "note": "was absent"})
        known[effect] = dict(values)
    return {**content, "effects": known, "provenance": notes}


def _note(key: str, old: float, source: str) -> dict[str, str]:
    return {"key": key, "source": source, "note": f"was {old:.9g}"}
