"""An error that nobody expected, in one line."""

import traceback
from pathlib import Path

from drivers.errors import CellError


class Unexpected(CellError):
    """A defect of this program: where it was, what it said, what to do."""

    def __init__(self, error: BaseException) -> None:
        place = traceback.extract_tb(error.__traceback__)[-1]
        said = " ".join(str(error).split()) or "no reason given"
        super().__init__(
            f"unexpected {type(error).__name__} in {Path(place.filename).name}, line "
            f"{place.lineno}: {said}; this is a defect of the program, please report it"
        )
