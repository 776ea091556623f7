"""Patches the strip file, and the cell's effects, when a verdict is accepted."""

from collections.abc import Mapping
from typing import Any

from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS

DIGITS = 6  # significant digits of a fitted number


def patch_file(
    strip: StripFile, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]],
    source: str,
) -> tuple[dict[str, object], dict[str, object] | None]:  # fmt: skip
    """Content of the strip file with refitted values and named effects, and the cell's effects."""
    content: dict[str, Any] = strip.model_dump(mode="json", by_alias=True)
    notes = list(content.pop("provenance"))
    known = {name: dict(values) for name, values in content["effects"].items()}
    for name, value in base.items():
        if "." in name:
            effect, key = name.split(".")
            notes.append(_note(f"effects.{effect}.{key}", known[effect].get(key), source))
            known[effect][key] = round_off(value)
        elif name in content:
            notes.append(_note(name, content[name], source))
            content[name] = round_off(value)
    of_cell: dict[str, object] = {}
    law = dict(content.pop("law", {}))
    for name, values in effects.items():
        if name in LAW_TERMS:
            before = f"was {law[name]:.9g}" if name in law else "was absent"
            law[name] = round_off(law.get(name, 0.0) + values["amount"])
            notes.append({"key": f"law.{name}", "source": source,
                          "note": f"{before}; a description, no cause"})  # fmt: skip
            continue
        entry = {key: round_off(value) for key, value in values.items()}
        if registry()[name].of == "cell":
            of_cell[name] = entry
            continue
        notes.append({"key": f"effects.{name}", "source": source, "note": "was absent"})
        known[name] = entry
    content |= {"effects": known, **({"law": law} if law else {}), "provenance": notes}
    return content, {"schema": 1, "effects": of_cell} if of_cell else None


def round_off(value: float) -> float:
    """Round `value` to the digits that a fit can determine."""
    return float(f"{value:.{DIGITS}g}")


def _note(key: str, old: float | None, source: str) -> dict[str, str]:
    was = "was absent" if old is None else f"was {old:.9g}"
    return {"key": key, "source": source, "note": was}
