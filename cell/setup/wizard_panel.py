"""Terminal interface of the calibration wizard: live panel, keys as answers, and
Ctrl-C.
"""

import os
import select
import sys
import termios
import tty
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Self, TextIO

import cv2
import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from calibration.wizard.coverage import Gate, Sketch
from calibration.wizard.progress import Observer, Progress
from calibration.wizard.session import read_rows
from calibration.wizard.verdict import Level, Line
from cell.base.config.cell import CellFile
from cell.base.devices.devices import Devices
from cell.orchestrator.operator import (
    Answer,
    Interrupt,
    Interrupted,
    Operator,
    Question,
    Unattended,
)
from cell.report.words import plural
from cell.setup.wizard import Wizard
from drivers.base.files import lock_folders, writing

MARKS = {  # with their styles
    Level.GOOD: ("+", "green"),
    Level.FAIR: ("~", "yellow"),
    Level.BAD: ("!", "bold red"),
    Level.PLAIN: (" ", ""),
}
BAR = 6  # characters
SKETCH = (32, 9)  # characters of the board's picture, 16:9 like an image
# of a braille character
DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
BRAILLE = 0x2800
SKETCH_STYLES = ("dim", "dim", "bold yellow", "green")  # nothing, frame, wanted, seen
RECENT = 4  # answers that stay in sight
POINT_STYLES = {"o": "green", "h": "blue", "x": "yellow", ">": "bold cyan", ".": "dim"}
MARK_LEGEND = "o fitted   h held out   x twice touched   > wanted   . to come"
FAR_OUTSIDE = 999  # dots, to which corners outside the sketch are clipped
# Ctrl-D, which a terminal that sends single keys passes on as a character
CTRL_D = "\x04"
ENTER = "\n"
KEY_HELP = "Enter go on | s leave out | r the last one again | a go on alone"
POLL_INTERVAL = 0.1  # s between looks at Ctrl-C
ALONE = "a"
ANSWERS = {ENTER: Answer.GO, ALONE: Answer.GO, "s": Answer.SKIP, "r": Answer.AGAIN}


class WizardPanel:
    """Live view of a calibration in a terminal; where the output is no terminal, one
    line is printed for each result.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = (
            Live(console=console, auto_refresh=False) if console.is_terminal else None
        )
        self._answers: list[str] = []
        self._question = ""
        self._news: Progress | None = None

    def __enter__(self) -> Self:
        """Start the live view in the terminal, and return this panel."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the live view, whose last state stays visible but for the question."""
        if self._live is not None:
            self.ask("")
            self._live.stop()

    def __call__(self, progress: Progress) -> None:
        """Show the message `progress` of the calibration wizard."""
        answer = "" if progress.result is None else progress.result.answer
        self._news = progress
        if answer:
            # an answer replaces an earlier one of this text
            text = answer.partition(": ")[2]
            others = [line for line in self._answers if line.partition(": ")[2] != text]
            self._answers = [*others[1 - RECENT :], answer]
        self._show(answer)

    def ask(self, words: str) -> None:
        """Show the question `words` until another one replaces it or an empty text
        removes it.
        """
        self._question = words
        self._show(words)

    def _show(self, line: str) -> None:
        """Draw the live view again or, where the output is no terminal, print `line`
        unless it is empty.
        """
        if self._live is not None:
            view = Text(line) if self._news is None else self.draw(self._news)
            self._live.update(view, refresh=True)
        elif line:
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def draw(self, progress: Progress) -> RenderableType:
        """Panel that shows the message `progress`, no higher than the terminal, which
        could not redraw a higher one.
        """
        body = _points_map(progress.plan) if progress.plan else _views_table(progress)
        rows = (("next", progress.request, "bold"), ("why ", progress.why, ""))
        head = [
            Text(f"{word}  {text}", style=style)
            for word, text, style in rows
            if text not in self._question
        ]
        if self._question:
            head = [Text(self._question, style="bold reverse"), *head]
        for first in range(len(self._answers) + 1):  # the oldest answers give way
            recent = [Text(line, style="dim") for line in self._answers[first:]]
            panel = Panel(Group(*head, Text(), body, *recent), title=progress.title)
            if len(self._console.render_lines(panel, pad=False)) < self._console.height:
                break
        return panel


def _views_table(progress: Progress) -> Table:
    """Table of the requirements on the views of a board, beside a sketch of the view
    that is asked for.
    """
    table = Table.grid(padding=(0, 2))
    sketch = [] if progress.sketch is None else [_sketch_text(progress.sketch)]
    table.add_row(_gates_table(progress.coverage), *sketch)
    return table


def _sketch_text(sketch: Sketch) -> Text:
    """Sketch of the board in the frame of the image, in characters: yellow as it is
    asked for, green as it is seen.
    """
    columns, rows = SKETCH
    picture = np.zeros((4 * rows, 2 * columns), np.uint8)
    size = np.array([2 * columns, 4 * rows])
    scale = size / sketch.size
    frame = (size - 1) / scale * [(0, 0), (1, 0), (1, 1), (0, 1)]
    for layer, corners in enumerate((frame, sketch.wanted, sketch.seen), start=1):
        if corners is not None:
            dots = np.clip(np.rint(corners * scale), -FAR_OUTSIDE, FAR_OUTSIDE)
            points = dots.astype(np.int32)
            cv2.polylines(picture, [points], isClosed=True, color=layer)

    # a character of braille has 4 x 2 dots
    text = Text(no_wrap=True)
    for row in picture.reshape(rows, 4, columns, 2).swapaxes(1, 2):
        for block in row:
            pattern = int(DOTS[block > 0].sum())
            text.append(chr(BRAILLE + pattern), SKETCH_STYLES[block.max()])
        text.append("\n")
    return text.append("yellow: wanted  green: seen", "dim")


def _gates_table(gates: Sequence[Gate]) -> Table:
    """Table of the requirements on the views of a board, each with its name, a bar, and
    how much of it is reached.
    """
    table = Table.grid(padding=(0, 1))
    for _ in range(3):
        table.add_column(no_wrap=True, overflow="ellipsis")
    for gate in gates:
        full = int(gate.share * BAR)  # full only where all is there
        style = "green" if gate.passed else "yellow"
        bar = Text("#" * full, style=style) + Text("-" * (BAR - full), style="dim")
        table.add_row(gate.name, bar, gate.ratio)
    return table


def _points_map(plan: Sequence[tuple[float, float, str]]) -> RenderableType:
    """Map of the planned poses, each given by x [m], z [m] and its state, which is a
    character that a legend explains.
    """
    table = Table.grid(padding=(0, 2))
    rows = defaultdict(list)
    for x, z, state in plan:
        rows[round(z, 3)].append((x, state))
    for height in sorted(rows, reverse=True):
        row = sorted(rows[height])
        states = [Text(state, style=POINT_STYLES[state]) for _, state in row]
        table.add_row(f"z {1e3 * height:4.0f} mm", *states)
    return Group(table, Text(MARK_LEGEND, style="dim"))


def print_verdict(lines: Iterable[Line]) -> None:
    """Print the `lines` of a verdict, in colour where the terminal supports it."""
    console = Console(highlight=False, soft_wrap=True)
    for line in lines:
        mark, style = MARKS[line.level]
        console.print(Text(f"{mark} {line.text}", style))


class Keys:
    """Reader of the keys that are typed at the terminal `stream`: single keys where it
    is in that mode, else whole lines.
    """

    def __init__(self, stream: TextIO) -> None:
        self._number = _descriptor(stream)
        self._line = b""

    def read(self, seconds: float) -> str | None:
        """Next typed key in lower case, or the constants for Enter and for the end of
        input; None where none is typed within `seconds`.
        """
        number = self._number
        if number is None:
            return CTRL_D
        while select.select([number], [], [], seconds)[0]:
            byte = os.read(number, 1)
            self._line += byte
            single = (
                os.isatty(number) and not termios.tcgetattr(number)[3] & termios.ICANON
            )
            if single or byte in {b"", b"\n"}:
                typed = self._line.decode(errors="replace")
                self._line = b""
                return (
                    CTRL_D if typed in {"", CTRL_D} else typed.strip().lower() or ENTER
                )
        return None


@contextmanager
def single_keys(stream: TextIO) -> Iterator[None]:
    """Context in which the terminal `stream` passes on each key as soon as it is typed,
    not only whole lines.
    """
    number = _descriptor(stream)
    if number is None or not os.isatty(number):
        yield
        return
    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number, termios.TCSANOW)
        yield
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _descriptor(stream: TextIO) -> int | None:
    """Number of the file descriptor of `stream`; None for a stream in memory, which has
    none.
    """
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None


class Keyboard:
    """Operator at a terminal who answers by keys: Enter continues, s skips, r repeats,
    and a continues without further questions.

    Questions on the pointer are asked even then: only a person knows that no hand is in
    the way. On the twin, whose time stands still, it `waits` for a key until
    `interrupted`; on hardware it polls, and the arm stays monitored.
    """

    def __init__(
        self,
        keys: Keys,
        prompt: Callable[[str], None],
        *,
        waits: bool,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self._keys = keys
        self._prompt = prompt
        self._waits = waits
        self._interrupted = interrupted
        self._asked: Question | None = None
        self._alone = False

    def answer(self, question: Question) -> Answer | None:
        """Answer to `question` by the key that the operator types, None where none was
        typed yet; raises Interrupted at the end of the input.
        """
        if self._alone and not question.reaches:
            return Answer.GO
        if question != self._asked:
            self._asked = question
            self._prompt(f"{question.words}  [{KEY_HELP}]")
        while not self._interrupted():
            key = self._keys.read(POLL_INTERVAL if self._waits else 0.0)
            if key is None and not self._waits:
                return None
            if key == CTRL_D:
                raise Interrupted("the input has ended: nobody answers at the cell")
            if key in ANSWERS:
                self._asked = None
                self._alone = self._alone or key == ALONE
                self._prompt("")
                return ANSWERS[key]
            if key is not None:
                self._prompt(f"{question.words}  [{key!r} is no key here; {KEY_HELP}]")
        return None


@contextmanager
def wizard_at_terminal(
    settings: CellFile,
    devices: Devices,
    *,
    interactive: bool,
    session: tuple[Path, str] | None = None,
    viz: str = "off",
) -> Iterator[Wizard]:
    """Context with a calibration wizard for `devices` that is shown and answered at
    this terminal, and that Ctrl-C stops.

    On the twin its operator is asked only if `interactive`. The folder of its
    `session`, which is of that kind, is locked against another wizard, and holds
    wizard.rrd unless `viz` is off. Raises Interrupted with what is in the folder, after
    one Ctrl-C as after two.
    """
    panel = WizardPanel(Console(stderr=True))
    observers: list[Observer] = [panel]
    try:
        with ExitStack() as stack:
            if session is not None:
                observers += _recordings(stack, session[0], viz)
            interrupted = stack.enter_context(Interrupt())
            stack.enter_context(single_keys(sys.stdin))
            stack.enter_context(panel)
            on_twin = devices.aids is not None
            operator: Operator = Unattended()
            if interactive or not on_twin:
                operator = Keyboard(
                    Keys(sys.stdin), panel.ask, waits=on_twin, interrupted=interrupted
                )
            yield Wizard(
                settings=settings,
                devices=devices,
                operator=operator,
                watch=partial(_tell, observers),
                interrupted=interrupted,
            )
    except (Interrupted, KeyboardInterrupt):
        if session is None:
            raise
        raise Interrupted(_resume_hint(*session)) from None


def _recordings(stack: ExitStack, folder: Path, viz: str) -> list[Observer]:
    """Lock the `folder` of a session and, unless `viz` is "off", open its recording for
    Rerun; returns the observers that write it.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    stack.enter_context(lock_folders([folder]))
    if viz == "off":
        return []
    from cell.report.viz.wizard import wizard_screen  # Rerun takes a second to import

    return [stack.enter_context(wizard_screen(folder, live=viz == "live"))]


def _tell(observers: Iterable[Observer], progress: Progress) -> None:
    """Pass the message `progress` of the calibration wizard on to all `observers`."""
    for observer in observers:
        observer(progress)


def _resume_hint(folder: Path, kind: str) -> str:
    """Text on an interrupted session: how many images `folder` keeps, and the command
    that goes on with it.
    """
    taken = sum(row.image is not None for row in read_rows(folder))
    if taken == 0:
        return f"interrupted; nothing was taken yet; {folder} may be deleted"
    return (
        f"interrupted; {plural(taken, 'image')} kept in {folder}: `cell calibrate"
        f" {kind} --resume {folder}` goes on, `cell calibrate {kind} --from {folder}`"
        " solves them"
    )
