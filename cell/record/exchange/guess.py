"""Proposal of a mapping of folds from the tables of one: by names, ranges and rates of columns.

What cannot be told stays open, a null, which the import refuses by its name.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cell.record.exchange.import_runs import sources_in
from cell.record.exchange.mapping import (
    FACTORS,
    LENGTHS,
    MEASURES,
    TIMES,
    Source,
    Table,
    numbers_of,
    seconds_of,
)  # fmt: skip
from drivers.errors import ConfigurationError
from drivers.strip.file import StripFile
from drivers.types import Array

WORD = re.compile(r"[A-Z]+(?![^\W\d_A-Z])\d*|[^\W\d_][^\W\d_A-Z]*\d*|°")
WORDS = {  # of a column's name, by what it holds; the first say that it is none of these
    "": "v vel velocity speed acc torque std error raw cmd command target desired action rotation",
    "pitch": "pitch angle tilt winkel neigung",
    "f_": "f force kraft fx fz",
    "x": "x along horizontal",
    "z": "z y height up vertical hoehe höhe",
    "t": "t time stamp timestamp zeit clock elapsed sec seconds",
    "i": "i point",
}
SECOND = {"log", "y"}  # words of columns that are taken where there is no other
UNITS = {unit.lower(): unit for unit in FACTORS} | {"sec": "s", "seconds": "s", "°": "deg"}
TYPICAL = {"t": 5e-3, "pitch": np.pi / 2, "x": 0.8, "z": 0.3, "f_x": 0.1, "f_z": 0.1}
"""Step [s], turn [rad], ways [lengths of the strip] and forces [N] of a gripper."""
STRIP = 0.5  # m, typically
MISTAKEN = 10.0  # factor from what is typical, beyond which no unit fits; of times its square
NEAR, NEAR_TURN, CLOSE = 0.03, 0.3, 0.05  # m, rad, m from where something must be
TURNED = 1.0  # rad that the gripper turns at least in the lift of a strip that lies flat
BY_NAME, BY_CLOCK = "its name", "the clock of the gripper"
Keys = dict[str, Any]  # of a column in the mapping
Told = dict[str, tuple[Keys, str]]  # by what a column holds: its keys, and why


class Columns(NamedTuple):
    """Columns (n,) of numbers of the table `file`, by what they hold; `names` are theirs there."""

    file: str
    names: dict[str, str]
    of: dict[str, Array]

    def increases(self) -> bool:
        """Whether its times increase from row to row."""
        return len(self.of["t"]) > 1 and bool((np.diff(self.of["t"]) > 0).all())

    def scaled(self, role: str, keys: Keys) -> Array:
        """Values (n,) [SI] of a column by the `keys` of a mapping; NaN where one is open."""
        if None in keys.values():
            return np.full(len(self.of[role]), np.nan)
        sign, zero = -1.0 if keys.get("reversed") else 1.0, keys.get("offset", 0.0)
        return np.asarray(sign * (self.of[role] * FACTORS[keys["unit"]] - zero))


def guess_mapping(places: Sequence[Path], strip: StripFile | None) -> str:
    """Text of a mapping for folds of `strip` as the first in `places`, with remarks.

    Without a strip its name and the zero of x stay open. Raises ConfigurationError where no table
    holds the gripper's path over time.
    """
    source = next(each for place in places for each in sources_in(place))
    tables = [_columns(source, name) for name in source.names]
    full = [each for each in tables if {"t", "x", "z"} <= each.of.keys()]
    ticks = max(filter(Columns.increases, full), key=lambda each: len(each.of), default=None)
    if ticks is None:
        raise ConfigurationError(
            f"{source.path}: no table holds time, x and z of the gripper by names such as t, x, z "
            "in rows whose times increase; name its columns so, or write the mapping"
        )
    told = _ticks(ticks, strip)
    sections = {"ticks": (ticks, told)}
    profile = next((each for each in full if not each.increases()), None)
    if profile is not None:
        path = {role: ticks.scaled(role, keys) for role, (keys, _) in told.items()}
        sections["profile"] = profile, _profile(profile, told, path)
    turn = float(np.ptp(ticks.scaled("pitch", told["pitch"][0]))) if "pitch" in told else np.inf
    start = "hanging" if turn < TURNED else "flat"
    lines = ["schema: 1", f"strip: {json.dumps(strip and strip.name)}", f"start: {start}", "sigma:"]
    errors = ["gripper", *(["force"] if {"f_x", "f_z"} & told.keys() else []), *[*sections][1:]]
    lines += [f"  {name}: null  # open: one sigma of its error [m, N]" for name in errors]
    rest = {each.file for each in tables} - {table.file for table, _ in sections.values()}
    return "\n".join(
        [*lines, *_lines(sections), f"# not taken: {', '.join(sorted(rest)) or 'no table'}", ""]
    )


def _lines(sections: Mapping[str, tuple[Columns, Told]]) -> Iterator[str]:
    """Lines of the tables, with how sure each column is."""
    for section, (table, told) in sections.items():
        yield from (f"{section}:", f"  file: {json.dumps(table.file)}", "  columns:")
        for role, (keys, why) in told.items():
            stated = {"column": table.names[role], **keys}.items()
            shown = ", ".join(f"{key}: {json.dumps(v, ensure_ascii=False)}" for key, v in stated)
            remark = f"{'' if why in {BY_NAME, BY_CLOCK} else 'likely, '}by {why}"
            if None in keys.values():
                units = ", ".join(MEASURES.get(role, LENGTHS))
                what = units if keys["unit"] is None else "your value [m] of the cell's zero"
                remark = f"open, not told by {why}: {what}"
            yield f"    {role}: {{{shown}}}  # {remark}"


def _columns(source: Source, file: str) -> Columns:
    """Columns of numbers of the table `file` that their names say; times in words are seconds."""
    content, made = source.table(file, Table[str](file=file, columns={})), Columns(file, {}, {})
    names = [name for name in content.column_names if content.column_names.count(name) == 1]
    for name in sorted(names, key=lambda n: (not SECOND.isdisjoint(_words(n)), len(_words(n)))):
        values = numbers_of(content[name])
        values = seconds_of(content[name]) if values is None else values
        if values is not None and np.isfinite(values).any() and (role := _role({*_words(name)})):
            made.names.setdefault(role, name)
            made.of.setdefault(role, values)
    return made


def _words(name: str) -> list[str]:
    return [word.lower() for word in WORD.findall(name)]


def _role(words: set[str]) -> str:
    """What a column holds by the `words` of its name; empty where they do not say."""
    role = next((role for role, known in WORDS.items() if words & {*known.split()}), "")
    if role != "f_":
        return role
    return next((f"f_{axis}" for axis in "xz" if words & {axis, f"f{axis}"}), "")


def _unit(table: Columns, role: str, size: float, typical: float) -> tuple[Keys, str]:
    """Unit by its name, or by its `size` as written where `typical` [SI] is; null for none."""
    known = MEASURES.get(role, LENGTHS)
    hints = [u for word in _words(table.names[role]) if (u := UNITS.get(word, "")) in known]
    off = {unit: abs(np.log(max(size * known[unit], 1e-12) / typical)) for unit in known}
    unit = min(hints or known, key=off.__getitem__)
    fits = off[unit] < np.log(MISTAKEN) * (2 if known is TIMES else 1)
    return {"unit": unit if fits else None}, BY_NAME if hints else "its range"


def _ticks(table: Columns, strip: StripFile | None) -> Told:
    """What the gripper's columns hold: the strip lies flat or hangs at first, and is lifted."""
    length, hangs, told = STRIP if strip is None else strip.length, False, Told()
    for role in (role for role in TYPICAL if role in table.of):
        values = table.of[role]
        moves = values - values[0] if role in "xz" else np.diff(values) if role == "t" else values
        size = float(np.median(moves) if role == "t" else np.nanmax(np.abs(moves)))
        keys, why = _unit(table, role, size, TYPICAL[role] * (length if role in "xz" else 1.0))
        if keys["unit"] is not None and role in {"pitch", "x", "z"}:
            si = values * FACTORS[keys["unit"]]
            hangs = abs(_largest_move(si)) < TURNED if role == "pitch" else hangs
            zero = _zero(role, si, strip, hangs=hangs)
            keys, why = keys | zero, f"{why}, zero by the start" if "offset" in zero else why
        told[role] = keys, why
    return told


def _zero(role: str, si: Array, strip: StripFile | None, *, hangs: bool) -> Keys:
    """Keys `offset` and `reversed` of a pose's column (n,) [SI], by where a fold begins and goes.

    The offset is None where it cannot be told, and absent where the column begins as it must.
    """
    length, first = STRIP if strip is None else strip.length, float(si[0])
    upright = hangs and role == "pitch"
    turned = first < 0 if upright else (_largest_move(si) > 0) == (role == "x")
    begin = length if role == "x" else np.pi / 2 if upright else 0.0
    offset: float | None = round(first + begin if turned else first - begin, 6)
    if hangs and role != "pitch":  # anywhere within reach
        offset = 0.0 if 0.0 < (-first if turned else first) < length else None
    elif role == "x" and strip is None:
        offset = None
    near = offset is not None and abs(offset) <= (NEAR_TURN if role == "pitch" else NEAR)
    return ({} if near else {"offset": offset}) | ({"reversed": True} if turned else {})


def _largest_move(values: Array) -> float:
    """Farthest way, with its sign, of `values` (n,) from the first."""
    return float((values - values[0])[np.argmax(np.abs(values - values[0]))])


def _profile(table: Columns, ticks: Told, path: Mapping[str, Array]) -> Told:
    """What the columns of a table of the strip's points hold: the last one is in the gripper."""
    t, (begin, end) = table.of["t"], path["t"][[0, -1]]
    near = (u for u in TIMES if begin - 1 <= np.median(t) * TIMES[u] <= end + 1)
    told: Told = {"t": ({"unit": next(near, None)}, BY_CLOCK)}
    told |= {"i": ({"unit": "1"}, BY_NAME)} if "i" in table.of else {}
    best, misfit = {"x": {"unit": None}, "z": {"unit": None}}, CLOSE
    images, moment = np.flatnonzero(np.diff(t, prepend=-np.inf)), table.scaled("t", told["t"][0])
    for unit in LENGTHS:
        for zeros in (ticks, Told(x=({}, ""), z=({}, ""))):  # of the gripper, or of the cell
            keys = {axis: {**zeros[axis][0], "unit": unit} for axis in "xz"}
            apart = [table.scaled(axis, keys[axis]) - np.interp(moment, path["t"], path[axis])
                     for axis in "xz"]  # fmt: skip
            nearest = float(np.median(np.minimum.reduceat(np.hypot(*apart), images)))
            misfit, best = (nearest, keys) if nearest < misfit else (misfit, best)
    return told | {axis: (best[axis], "what fits the gripper") for axis in "xz"}
