"""What can end a training from outside."""

from drivers.errors import CellError


class WorkersLost(CellError):
    """Whoever folded is gone; the journal keeps what was done."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; run the same command again to go on")
