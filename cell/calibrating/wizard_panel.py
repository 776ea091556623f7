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
from calibration.wizard.news import News, TouchNews, ViewNews
from calibration.wizard.touches import Touched
from calibration.wizard.verdict import Level, Line

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
        self._question = ""
        self._news: News | None = None

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
        """Stop, leaving the last view visible, without a question."""
        if self._live is not None:
            self.ask("")
            self._live.stop()

    def __call__(self, news: News) -> None:
        """Show the news."""
        answer = news.answer
        self._news = news
        if answer:
            self._answers = [*self._answers[1 - RECENT :], answer]
        if self._live is not None:
            self._live.update(self.draw(news), refresh=True)
        elif answer:
            self._console.print(answer, markup=False, highlight=False, soft_wrap=True)

    def ask(self, words: str) -> None:
        """Show a question in the panel, where it stays until the next; empty: it is answered."""
        self._question = words
        if self._live is not None:
            view = Text(words) if self._news is None else self.draw(self._news)
            self._live.update(view, refresh=True)
        elif words:
            self._console.print(words, markup=False, highlight=False, soft_wrap=True)

    def draw(self, news: News) -> RenderableType:
        """The panel in its present state, no higher than the terminal: a live view that is higher
        leaves its upper lines behind at every change.
        """
        body = gates_table(news.gates) if isinstance(news, ViewNews) else touches_map(news)
        wanted = Text(f"next  {news.request}", style="bold")
        head = [wanted, Text(f"why   {news.why}")]
        if self._question:
            head = [Text(self._question, style="bold reverse"), *head]
        for kept in range(len(self._answers), -1, -1):
            recent = [
                Text(line, style="dim") for line in self._answers[len(self._answers) - kept :]
            ]
            panel = Panel(Group(*head, Text(), body, *recent), title=news.title)
            if self._height(panel) < self._console.height:
                break
        return panel

    def _height(self, panel: Panel) -> int:
        return len(self._console.render_lines(panel, pad=False))


def verdict_text(lines: Iterable[Line]) -> Text:
    """A verdict, coloured, a line a fact."""
    text = Text()
    for line in lines:
        text.append(f"{MARKS[line.level]} {line.text}\n", style=STYLES[line.level])
    return text


def gates_table(gates: Sequence[Gate]) -> Table:
    """What the views cover: a bar for each gate, and what to do where it is not full."""
    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(no_wrap=True, overflow="ellipsis")
    for gate in gates:
        full = round(gate.share * BAR)
        style = "green" if gate.passed else "yellow"
        bar = Text("#" * full, style=style) + Text("-" * (BAR - full), style="dim")
        table.add_row(gate.name, bar, gate.ratio, "" if gate.passed else gate.advice)
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


def _mark(number: int, news: TouchNews, touched: dict[int, Touched]) -> Text:
    if news.wanted is not None and news.plan[number] == news.wanted:
        return Text(">", style="bold cyan")
    point = touched.get(number)
    if point is None:
        return Text(".", style="dim")
    if point.again:
        return Text("x", style="yellow")
    return Text("h", style="blue") if point.held_out else Text("o", style="green")
