"""A training in the terminal: a bar while it runs, a table at its end."""

from collections import deque
from collections.abc import Sequence
from statistics import median

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table

from cell.campaign.progress import clock
from cell.train.evaluation import Engine, Evaluation
from policies.train.search import Progress

RECENT = 30  # generations from which the time left is text
LINES = 20  # text of a whole training where there is no screen
ENGINE_NAMES = {Engine.ROD: "rod (the model)", Engine.CHAIN: "chain (the plant)"}


class Meter:
    """Progress of a training of `generations`, of which `known` were done before."""

    def __init__(self, console: Console, generations: int, known: int) -> None:
        self._console = console
        self._generations = generations
        self._took: deque[float] = deque(maxlen=RECENT)
        self._validated = ""
        self._bar = Bar(
            BarColumn(bar_width=28),
            TextColumn("{task.description}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._bar.add_task("begins", total=generations, completed=known)
        if known:
            console.print(f"goes on after {known} of {generations} generations", highlight=False)
        self._bar.start()

    def show_generation(self, step: Progress) -> None:
        """One generation is done."""
        self._took.append(step.seconds)
        if step.validated is not None:
            self._validated = f"  validated {1e3 * step.validated:.1f} mm rms"
        done = step.generation + 1
        left = (self._generations - done) * median(self._took)
        text = (
            f"generation {done} of {self._generations}  |d| best {1e3 * step.best:.1f} "
            f"mean {1e3 * step.mean:.1f} mm{self._validated}  {clock(left)} left"
        )
        self._bar.update(self._task, completed=done, description=text)
        if self._is_printed(done):
            self._console.print(text, highlight=False, soft_wrap=True)

    def show_evaluation(self, done: int, pieces: int) -> None:
        """`done` of `pieces` of the final evaluation."""
        text = f"folds strips that training never folded: {done} of {pieces} pieces"
        self._bar.update(self._task, total=pieces, completed=done, description=text)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.stop()

    def _is_printed(self, done: int) -> bool:
        if self._console.is_terminal:
            return False
        every = max(1, self._generations // LINES)
        return done % every == 0 or done == self._generations


def show(evaluations: Sequence[Evaluation], console: Console) -> None:
    """Print the table of the final evaluation."""
    side = len(evaluations[0].displacement)
    table = Table(title=f"|d| over {side} x {side} strips of the paper's range")
    table.add_column("folded on")
    for name in ("mean mm", "95 % mm", "worst mm", "without a touch"):
        table.add_column(name, justify="right")
    for each in evaluations:
        numbers = [f"{1e3 * value:.1f}" for value in (each.mean, each.most, each.worst)]
        table.add_row(ENGINE_NAMES[each.engine], *numbers, str(each.untouched))
    console.print(table)
