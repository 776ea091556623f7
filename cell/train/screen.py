"""Shows a training in the terminal: a bar while it runs, a table at its end."""

from collections.abc import Iterator, Sequence
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from cell.train.evaluation import EffectErrors, Engine, Evaluation

LINES = 20  # printed of a training, and of its evaluation, where there is no terminal
Table = tuple[Sequence[str], Sequence[Sequence[str]], str]
ENGINE_NAMES = {Engine.ROD: "rod (the model)", Engine.CHAIN: "chain (the plant)"}


class Meter:
    """Progress bar of a training of `total` steps, `known` done before; lines off a terminal."""

    def __init__(self, console: Console, total: int, known: int) -> None:
        self._console, self._total = console, total
        self._bar = Bar(
            BarColumn(bar_width=28),
            TextColumn("{task.description}"),
            TimeRemainingColumn(compact=True),
            console=console,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._bar.add_task("begins", total=total, completed=known)
        if known:
            console.print(f"goes on after {known} of {total}", highlight=False)

    def __enter__(self) -> Self:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Remove the bar; after Ctrl-C, print how to resume."""
        self._bar.stop()
        if kind is KeyboardInterrupt:
            self._console.print("interrupted; the same command goes on", highlight=False)

    def show(self, done: int, text: str) -> None:
        """Show the number of steps `done`, and `text` on the last one."""
        self._advance(done, self._total, text)

    def show_evaluation(self, done: int, pieces: int) -> None:
        """Show that `done` of `pieces` of the final evaluation are done."""
        text = f"folds strips that training never folded: {done} of {pieces} pieces"
        self._advance(done, pieces, text)

    def _advance(self, done: int, total: int, text: str) -> None:
        self._bar.update(self._task, total=total, completed=done, description=text)
        due = done % max(1, total // LINES) == 0 or done == total
        if due and not self._console.is_terminal:
            self._console.print(text, highlight=False, soft_wrap=True)


def tables(evaluations: Sequence[Evaluation], errors: Sequence[EffectErrors]) -> Iterator[Table]:
    """Columns, rows and title of the final evaluation, and of the errors by hidden effect."""
    side = len(evaluations[0].displacement)
    rows = [
        (ENGINE_NAMES[e.engine], *(f"{1e3 * v:.1f}" for v in (e.mean, e.most, e.worst)),
         str(e.untouched))
        for e in evaluations
    ]  # fmt: skip
    columns = ("mean mm", "95 % mm", "worst mm", "without a touch")
    yield ("folded on", *columns), rows, f"|d| over {side} x {side} strips of the paper's range"
    rows = [
        (e.effect, *(f"{1e3 * f[key]:.2f}" for key in ("bias", "mean", "p95", "worst")),
         str(f["untouched"]))
        for e in errors for f in (e.facts(),)
    ]  # fmt: skip
    if rows:
        yield ("hidden", "mean d mm", *columns), rows, "d in the rod, by hidden effect"
