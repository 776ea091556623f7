"""Terminal view of a calibration: what to do next, why, and the coverage."""

from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from calibration.wizard.coverage import Gate
from calibration.wizard.news import Stage, TouchNews, ViewNews
from calibration.wizard.touch_fit import Touched
from calibration.wizard.words import Level, Line
from drivers.types import Pose

STYLES = {Level.GOOD: "green", Level.FAIR: "yellow", Level.BAD: "bold red", Level.PLAIN: ""}
MARKS = {Level.GOOD: "+", Level.FAIR: "~", Level.BAD: "!", Level.PLAIN: " "}
BAR = 24  # characters
RECENT = 4  # answers that stay in sight
FOLLOWED = "o fitted   h held out   x twice touched   > wanted   . to come"


class WizardPanel:
    """A live view in a terminal; without one, a plain line for each result."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self._answers: list[str] = []

    def __enter__(self) -> Self:
        """Start the live view."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop, leaving the last view visible."""
        if self._live is not None:
            self._live.stop()

    def __call__(self, news: ViewNews | TouchNews) -> None:
        """Show the news."""
        answer = answer_of(news)
        if answer:
            self._answers = [*self._answers[1 - RECENT :], answer]
        if self._live is not None:
            self._live.update(self.drawn(news), refresh=True)
        elif answer:
            self._console.print(answer, markup=False, highlight=False, soft_wrap=True)

    def ask(self, words: str) -> None:
        """Show a question above the panel."""
        self._console.print(words, markup=False, highlight=False, soft_wrap=True)

    def drawn(self, news: ViewNews | TouchNews) -> RenderableType:
        """The panel in its present state."""
        title, body = _body(news)
        wanted = Text(f"next  {_wanted(news)}", style="bold")
        answers = Text("\n".join(self._answers), style="dim")
        return Panel(
            Group(wanted, Text(f"why   {news.why}"), Text(), body, Text(), answers), title=title
        )


def _body(news: ViewNews | TouchNews) -> tuple[str, RenderableType]:
    """Title and content of the panel."""
    if isinstance(news, ViewNews):
        return "the lens, from a board", gates_table(news.gates)
    return f"the map to the plane: {news.stage}", touches_map(news)


def verdict_text(lines: Iterable[Line]) -> Text:
    """A verdict, coloured, a line a fact."""
    text = Text()
    for line in lines:
        text.append(f"{MARKS[line.level]} {line.text}\n", style=STYLES[line.level])
    return text


def gates_table(gates: Sequence[Gate]) -> Table:
    """What the views cover: a bar for each gate, and what to do where it is not full."""
    table = Table.grid(padding=(0, 2))
    for gate in gates:
        full = round(gate.share * BAR)
        style = "green" if gate.passed else "yellow"
        bar = Text("#" * full, style=style) + Text("-" * (BAR - full), style="dim")
        have, need = (f"{v:.0f}" if gate.unit else f"{v:.2f}" for v in (gate.have, gate.need))
        table.add_row(gate.name, bar, f"{have} of {need}", "" if gate.passed else gate.advice)
    return table


def touches_map(news: TouchNews) -> RenderableType:
    """Map of the planned poses in the plane, one character for each."""
    touched = {point.number: point for point in news.touches}
    heights = sorted({round(pose.z, 3) for pose in news.plan}, reverse=True)
    table = Table.grid(padding=(0, 2))
    for height in heights:
        row = [k for k, pose in enumerate(news.plan) if round(pose.z, 3) == height]
        row.sort(key=lambda k: news.plan[k].x)
        marks = [_mark(k, news, touched) for k in row]
        table.add_row(f"z {1e3 * height:4.0f} mm", *marks)
    return Group(table, Text(FOLLOWED, style="dim"))


def answer_of(news: ViewNews | TouchNews) -> str:
    """Text about the newest image; empty where there is nothing to say."""
    told = news.told
    if told is None or (told.refused is None and told.waits):
        return ""
    if isinstance(news, ViewNews):
        return f"image {told.number}: {told.refused or 'taken'}"
    if told.refused is not None:
        return f"point {told.number}: {told.refused}"
    again = " again" if news.stage is Stage.AGAIN else ""
    return f"point {told.number}: touched{again} at {_place(news.pose)}"


def _mark(number: int, news: TouchNews, touched: dict[int, Touched]) -> Text:
    if news.wanted is not None and news.plan[number] == news.wanted:
        return Text(">", style="bold cyan")
    point = touched.get(number)
    if point is None:
        return Text(".", style="dim")
    if point.again:
        return Text("x", style="yellow")
    return Text("h", style="blue") if point.held_out else Text("o", style="green")


def _wanted(news: ViewNews | TouchNews) -> str:
    if isinstance(news, ViewNews):
        return "nothing: all is covered" if news.wanted is None else f"show the board {news.wanted}"
    return "nothing" if news.wanted is None else f"the arm goes to {_place(news.wanted)}"


def _place(pose: Pose | None) -> str:
    return "" if pose is None else f"x {1e3 * pose.x:.0f}, z {1e3 * pose.z:.0f} mm"
