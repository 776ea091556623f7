"""A process that folds one request after the other."""

import signal
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection

from calibration.calibration import Calibration
from cell.fold import Request, fold
from cell.interrupt import Interrupted
from cell.result import FoldResult
from cell.unexpected import Unexpected
from drivers.errors import CellError, Fault

PATIENCE = 60.0  # s that a fold may take to end its record once it was told to stop
STOP = "stop"

Task = tuple[int, Request, Calibration | None]


class Worker:
    """Folds in a process of its own, deaf to the keyboard: it is told through its pipe to stop.

    The first `stop` asks for a controlled stop of the fold under way, as does the death of the
    process that it works for; a second one stops it at once.
    """

    def __init__(self) -> None:
        """Start the process; nothing is folded yet."""
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.task: int | None = None
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        hearing = signal.signal(signal.SIGINT, signal.SIG_IGN)  # which a new process inherits
        try:
            self._process.start()
        finally:
            signal.signal(signal.SIGINT, hearing)
        theirs.close()

    def begin(self, number: int, request: Request, calibration: Calibration | None) -> None:
        """Let it fold `request`, as task `number`."""
        self.task = number
        with suppress(OSError):  # it has ended by itself, and `result` will say so
            self.pipe.send((number, request, calibration))

    def result(self) -> FoldResult | CellError:
        """What came of its task; waits for it. A process that died is a Fault."""
        try:
            made: FoldResult | CellError = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            made = Fault("process_died", f"the process of a fold ended by itself, code {code}")
        self.task = None
        return made

    def stop(self) -> None:
        """Ask it to stop what it does."""
        if self.task is not None:
            with suppress(OSError):
                self.pipe.send(STOP)

    def release(self) -> None:
        """Ask for nothing more; the fold that is under way stops under control."""
        self.pipe.close()

    def join(self) -> None:
        """Wait for the end of a released process."""
        self._process.join(PATIENCE)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()


class Told:
    """Whether a fold is asked to stop: by word through `pipe`, or because nobody listens."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._words = 0

    def __call__(self) -> bool:
        """True after the first word; from the second on KeyboardInterrupt."""
        while self._pipe.poll():
            try:
                self._pipe.recv()
            except EOFError:
                return True
            self._words += 1
            if self._words > 1:
                raise KeyboardInterrupt
        return self._words > 0


def _work(pipe: Connection) -> None:
    with suppress(OSError):  # nobody waits for the result any more
        while (task := _next(pipe)) is not None:
            pipe.send(_folded(task, Told(pipe)))


def _next(pipe: Connection) -> Task | None:
    """The next task; None when there is none any more. A word that came too late is passed over."""
    while True:
        try:
            word: Task | str = pipe.recv()
        except EOFError:
            return None
        if not isinstance(word, str):
            return word


def _folded(task: Task, told: Told) -> FoldResult | CellError:
    _, request, calibration = task
    try:
        return fold(request, interrupted=told, calibration=calibration)
    except CellError as error:
        return error
    except KeyboardInterrupt:
        return Interrupted("stopped at once from the keyboard")
    except Exception as error:  # noqa: BLE001  an edge: the other folds go on, this one is told
        return Unexpected(error)
