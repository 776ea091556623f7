"""Proposal of a mapping of folds from the tables of one: by names, ranges and rates of
columns.

What cannot be told stays open, a null, which the import refuses by its name.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa

from cell.record.columns import LENGTHS, TIMES
from cell.record.exchange.import_runs import sources_in
from cell.record.exchange.mapping import (
    FACTORS,
    UNITS,
    Table,
    units_of,
)
from cell.record.tables import numbers_of, seconds_of, turn_of
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.file import StripFile

WORD = re.compile(r"[A-Z]+(?![^\W\d_A-Z])\d*|[^\W\d_][^\W\d_A-Z]*\d*|°")
WORDS = read_yaml(Path(__file__).with_name("column_words.yaml"))
# tables of what images show
SEEN = {"contact": ("t", "contact_x"), "result": ("t", "l1", "l2")}
# sigma, where not named as the section
ERRORS = {"contact": "contact_x", "result": "displacement"}
SECOND = {"log", "y"}  # words of columns that are taken where there is no other
TYPICAL = {"t": 5e-3, "pitch": np.pi / 2, "x": 0.8, "z": 0.3, "f_x": 0.1, "f_z": 0.1}
"""Step [s], turn [rad], paths [lengths of the strip] and forces [N] of a gripper."""
STRIP = 0.5  # m, typically
# factor from what is typical, beyond which no unit fits; of times its square
MISTAKEN = 10.0
NEAR, NEAR_TURN, CLOSE = 0.03, 0.3, 0.05  # m, rad, m from where something must be
PLACES = ("x", "z", "contact_x")  # whose path from their start tells the unit
# rad that the gripper turns at least in the lift of a strip that lies flat
TURNED = 1.0
# reasons that leave no doubt
BY_NAME, BY_CLOCK = "its name", "the clock of the gripper"


@dataclass(frozen=True, slots=True)
class Guess:
    """Guess of what a `column` of another program's table holds: its unit and the place
    of its zero, with the `reason` for it.

    A `unit`, a `factor` of it or an `offset` [SI] of None is open: it cannot be told.
    """

    column: str
    values: Array
    unit: str | None = None
    offset: float | None = 0.0
    factor: float | None = 1.0
    reversed: bool = False
    reason: str = BY_NAME

    def si(self) -> Array:
        """Values of the column, of shape (rows,), in SI units and along the axes of the
        cell; NaN where its unit or its zero cannot be told.
        """
        if self.unit is None or self.offset is None or self.factor is None:
            return np.full(len(self.values), np.nan)
        sign = -1.0 if self.reversed else 1.0
        unit = self.factor * FACTORS.get(self.unit, 1.0)
        return sign * (self.values * unit - self.offset)

    def line(self, quantity: str) -> str:
        """Line of a mapping file that says which column holds the named `quantity`,
        with a remark on how sure the guess is.
        """
        reason = self.reason
        stated: dict[str, object] = {"column": self.column, "unit": self.unit}
        stated |= {} if self.factor == 1.0 else {"factor": self.factor}
        stated |= {} if self.offset == 0.0 else {"offset": self.offset}
        stated |= {"reversed": True} if self.reversed else {}
        keys = ", ".join(
            f"{k}: {json.dumps(v, ensure_ascii=False)}" for k, v in stated.items()
        )
        remark = f"{'' if reason in {BY_NAME, BY_CLOCK} else 'likely, '}by {reason}"
        if self.unit is None:
            remark = f"open, not told by {reason}: {', '.join(units_of(quantity))}"
        elif self.factor is None:
            remark = f"open: {self.unit} of one of it; {reason}"
        elif self.offset is None:
            remark = f"open, not told by {reason}: your value [m] of the cell's zero"
        return f"    {quantity}: {{{keys}}}  # {remark}"


Guesses = Mapping[str, Guess]  # of a table's columns, by the quantity that each holds
Section = tuple[str | None, Guesses]  # of a mapping: its table's file and columns


def guess_mapping(paths: Sequence[Path], strip: StripFile | None) -> str:
    """Text of a mapping file for the import of folds of `strip`, guessed from the first
    run in `paths`, with remarks.

    Without a strip its name and the zero of x stay open, and so do columns of the
    gripper that no name tells.
    """
    source = next(each for path in paths for each in sources_in(path))
    read = {f: source.table(Table[str](file=f, columns={})) for f in source.names}
    tables = {file: columns_by_name(content) for file, content in read.items()}

    # times rise along a path; points of an image share theirs
    series, of_points = list[str](), list[str]()
    for file, table in tables.items():
        if not {"t", "x", "z"} <= table.keys():
            continue
        steps = np.diff(table["t"].values)
        if len(steps) and (steps > 0).all():
            series.append(file)
        if (steps == 0).any():
            of_points.append(file)

    # no path: the gripper may stand in a table whose columns no name tells
    files = series or [file for file in read if file not in of_points]
    longest = max(files, key=lambda file: len(read[file]), default=None)
    gripper = {} if longest is None else _guess_gripper(tables[longest], strip)
    sections: dict[str, Section] = {"ticks": (longest, gripper)}

    if of_points:
        points = tables[of_points[0]]
        guesses = _guess_points(points, gripper) if series else _alone(points, strip)
        sections["profile"] = of_points[0], guesses
    if series:
        sections |= _seen_sections(tables, gripper)
    left = _not_taken(read, dict(sections.values()))
    return "\n".join((*_lines(sections, strip), *left, ""))


def _seen_sections(
    tables: Mapping[str, Guesses], gripper: Guesses
) -> dict[str, Section]:
    """Sections of a mapping on what cameras saw of the strip, each from the first of
    `tables` that has all of its columns.
    """
    sections = dict[str, Section]()
    for section, names in SEEN.items():
        for file, table in tables.items():
            if {*names} <= table.keys():
                sections[section] = file, _guess_seen(table, gripper, names)
                break
    return sections


def _lines(sections: Mapping[str, Section], strip: StripFile | None) -> Iterator[str]:
    """Lines of a mapping file for folds of `strip`: a header, then each of `sections`
    with its file and its columns.
    """
    ticks = sections["ticks"][1]
    turn = float(np.ptp(ticks["pitch"].si())) if "pitch" in ticks else np.inf
    yield from ("schema: 1", f"strip: {json.dumps(strip and strip.name)}")
    yield from (f"start: {'hanging' if turn < TURNED else 'flat'}", "sigma:")
    has_force = not {"f_x", "f_z"}.isdisjoint(ticks)
    seen = [ERRORS.get(section, section) for section in [*sections][1:]]
    for name in ("gripper", *(["force"] if has_force else []), *seen):
        yield f"  {name}: null  # open: one sigma of its error [m, N]"
    for section, (file, guesses) in sections.items():
        yield f"{section}:"
        remark = "" if file else "  # open: no table holds the gripper's path"
        yield f"  file: {json.dumps(file, ensure_ascii=False)}{remark}"
        yield "  columns:"
        time = {"t": "t_layer_touch"} if section == "result" else {}
        yield from (guess.line(time.get(name, name)) for name, guess in guesses.items())
        for quantity in [
            name for name in "txz" if section == "ticks" and name not in guesses
        ]:
            yield (
                f"    {quantity}: {{column: null, unit: null}}  # open: no name says so"
            )


def _not_taken(
    read: Mapping[str, pa.Table], taken: Mapping[str | None, Guesses]
) -> Iterator[str]:
    """Yield remarks on the columns of each file that the guessed mapping leaves out."""
    for file, content in read.items():
        stated = [guess.column for guess in taken.get(file, {}).values()]
        used = {name.replace("*", axis) for name in stated for axis in "xyzw"}
        of = zip(content.column_names, content.schema.types, strict=True)
        left = [
            f"{n} (words)" if pa.types.is_string(kind) else n
            for n, kind in of
            if n not in used
        ]
        if left:
            name = json.dumps(file, ensure_ascii=False)
            why = "no numbers, or no name says more"
            if any(
                file not in taken and content.schema == read[other].schema
                for other in filter(None, taken)
            ):
                why = "is it of another run? give the files themselves"
            yield f"# not taken of {name}: {', '.join(left)}; {why}"


def columns_by_name(content: pa.Table) -> dict[str, Guess]:
    """Guesses at what the numeric columns of a table hold, by quantity, for all columns
    whose names tell a quantity.
    """
    found: dict[str, Guess] = {}
    names = [
        name for name in content.column_names if content.column_names.count(name) == 1
    ]
    for stem in [name[:-1] for name in names if name.endswith("w")]:
        parts = {axis: f"{stem}{axis}" for axis in "xyzw"}
        numbers = [
            numbers_of(content[name]) for name in parts.values() if name in names
        ]
        if len(whole := [part for part in numbers if part is not None]) == len(parts):
            names = [name for name in names if name not in parts.values()]
            # or the tool does not turn with the strip
            if np.ptp(turn := turn_of(*whole)) > TURNED:
                found["pitch"] = Guess(f"{stem}*", turn, "quaternion")
    for name in sorted(
        names, key=lambda n: (not SECOND.isdisjoint(words_of(n)), len(words_of(n)))
    ):
        values = numbers_of(content[name])
        values = seconds_of(content[name]) if values is None else values
        if (
            values is not None
            and np.isfinite(values).any()
            and (quantity := _quantity(words_of(name)))
        ):
            found.setdefault(
                quantity, Guess(name, values, "1" if quantity == "i" else None)
            )
    return found


def words_of(name: str) -> list[str]:
    """Words in the `name` of a column, in small letters, with digits at their ends."""
    return [word.lower() for word in WORD.findall(name)]


def told_by(words: Iterable[str], subject: str) -> str | None:
    """What a column of a `subject`, strip or robot, holds by the `words` of its name;
    None where they do not tell it.
    """
    kinds = WORDS[subject].items()
    return next((key for key, known in kinds if {*words} & {*known.split()}), None)


def _quantity(words: Sequence[str]) -> str:
    """Quantity that a column holds, such as `pitch`, by the `words` of its name; empty
    where they do not tell one.
    """
    found = told_by(words, "strip") or ""
    axis = next((axis for axis in "xz" if {*words} & {axis, f"f{axis}"}), "")
    return found if found != "f_" else axis and f"f_{axis}"


def _guess_gripper(columns: Guesses, strip: StripFile | None) -> Guesses:
    """Guesses at the columns of the gripper's motion, with units and zeros such that
    they suit a fold of `strip`.

    The strip lies flat or hangs at first, which the pitch tells, and is lifted.
    """
    length, hangs = _length(strip), False
    found: dict[str, Guess] = {}
    for quantity in [name for name in TYPICAL if name in columns]:
        typical = TYPICAL[quantity] * (length if quantity in "xz" else 1.0)
        guess = columns[quantity]
        guess = guess if guess.unit else with_unit(guess, quantity, typical)
        if guess.unit is not None and quantity in {"pitch", "x", "z"}:
            if quantity == "pitch":
                hangs = abs(_largest_move(guess.si())) < TURNED
            guess = _with_zero(guess, quantity, strip, hangs=hangs)
        found[quantity] = guess
    return found


def with_unit(guess: Guess, quantity: str, typical: float) -> Guess:
    """Copy of `guess` with a unit, by the name of its column or by the size that its
    `quantity` typically has in a fold, `typical` in SI units.

    That is the step of the clock, the path of a place from its start, or the largest
    value.
    """
    known, values = units_of(quantity), guess.values
    if quantity == "t":
        size = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    else:
        size = float(
            np.nanmax(np.abs(values - (values[0] if quantity in PLACES else 0.0)))
        )
    hints = [
        u for word in words_of(guess.column) if (u := UNITS.get(word, "")) in known
    ]
    off = {
        unit: abs(np.log(max(size * known[unit], 1e-12) / typical)) for unit in known
    }
    unit = min(hints or known, key=off.__getitem__)
    fits = off[unit] < np.log(MISTAKEN) * (2 if known is TIMES else 1)
    return replace(
        guess, unit=unit if fits else None, reason=BY_NAME if hints else "its range"
    )


def _with_zero(
    guess: Guess, quantity: str, strip: StripFile | None, *, hangs: bool
) -> Guess:
    """Copy of `guess` for the pitch, x or z of the gripper, with the zero and the sign
    that suit how a fold starts and ends.

    The zero is kept where the column begins as it must, and open where it cannot be
    told.
    """
    length, si = _length(strip), guess.si()
    first, moves_up = float(si[0]), _largest_move(si) > 0
    if quantity == "pitch":
        begin, turned = (np.pi / 2, first < 0) if hangs else (0.0, not moves_up)
    elif quantity == "z":
        begin, turned = 0.0, not moves_up
    else:  # x falls from the strip's length
        begin, turned = length, moves_up
    sign = -1.0 if turned else 1.0
    offset: float | None = round(first - sign * begin, 6)
    if hangs and quantity != "pitch":  # anywhere within reach
        offset = 0.0 if 0.0 < sign * first < length else None
    elif quantity == "x" and strip is None:
        offset = None
    if offset is not None and abs(offset) <= (
        NEAR_TURN if quantity == "pitch" else NEAR
    ):
        return replace(guess, offset=0.0, reversed=turned)
    reason = f"{guess.reason}, zero by the start"
    return replace(guess, offset=offset, reversed=turned, reason=reason)


def _length(strip: StripFile | None) -> float:
    """Length [m] of `strip`, or a typical length where the strip is None."""
    return STRIP if strip is None else strip.length


def _largest_move(values: Array) -> float:
    """Largest change of `values` from the first of them, with its sign."""
    return float((values - values[0])[np.argmax(np.abs(values - values[0]))])


def _on_clock(times: Guess, gripper: Guesses) -> Guess:
    """Copy of the guess `times` with the unit in which these lie within the gripper's
    times; that unit is None where none fits.
    """
    (begin, end), middle = gripper["t"].si()[[0, -1]], np.nanmedian(times.values)
    near = (u for u, factor in TIMES.items() if begin - 1 <= middle * factor <= end + 1)
    return replace(times, unit=next(near, None), reason=BY_CLOCK)


def _guess_seen(columns: Guesses, gripper: Guesses, names: Sequence[str]) -> Guesses:
    """Guesses at the columns, called `names`, of what cameras saw of the desk contact
    or the touch of the layers, on the gripper's clock and zero.

    Their lengths are part of the gripper's way.
    """
    x, found = gripper["x"], {"t": _on_clock(columns["t"], gripper)}
    for name in names[1:]:
        found[name] = with_unit(columns[name], name, float(np.ptp(x.si())) / 2)
    if "contact_x" in found:
        found["contact_x"] = replace(
            found["contact_x"], offset=x.offset, reversed=x.reversed
        )
    return found


def _guess_points(columns: Guesses, gripper: Guesses) -> Guesses:
    """Guesses at the columns of points on the strip, with units and zeros such that the
    grasped end lies at the gripper.

    Their zeros are those of the gripper's columns, or the cell's; a unit that does not
    fit is open.
    """
    points = {name: columns[name] for name in [*"tixz"] if name in columns}
    points["t"] = _on_clock(points["t"], gripper)
    points |= {
        axis: replace(points[axis], reason="what fits the gripper") for axis in "xz"
    }
    choices = []
    for unit, zero in product(LENGTHS, (gripper, points)):
        choice = dict(points)
        for axis in "xz":
            told = {"offset": zero[axis].offset, "reversed": zero[axis].reversed}
            choice[axis] = replace(points[axis], unit=unit, **told)
        choices.append(choice)
    distances = [_grasp_distance(choice, gripper) for choice in choices]
    return choices[int(np.argmin(distances))] if min(distances) < CLOSE else points


def _alone(columns: Guesses, strip: StripFile | None) -> Guesses:
    """Guesses at the columns of points on the strip where no table holds the gripper's
    motion.
    """
    length = _length(strip)
    sizes = {"t": TYPICAL["t"], "x": length, "z": TYPICAL["z"] * length}
    found = {name: with_unit(columns[name], name, sizes[name]) for name in sizes}
    return found | {name: columns[name] for name in "i" if name in columns}


def _grasp_distance(points: Guesses, gripper: Guesses) -> float:
    """Distance [m] from the gripper to the nearest point of the strip, as a median over
    all images; infinity where a unit or zero is open.
    """
    t, clock = points["t"], gripper["t"].si()
    images = np.flatnonzero(np.diff(t.values, prepend=-np.inf))
    apart = [points[a].si() - np.interp(t.si(), clock, gripper[a].si()) for a in "xz"]
    median = np.median(np.minimum.reduceat(np.hypot(*apart), images))
    return float(np.nan_to_num(median, nan=np.inf))
