"""Window of an image: the part that is redrawn in a frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array, Image

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Window:
    """Columns `left` to `right` and rows `top` to `bottom` of an image of `size` (width, height).

    `margin` [px] at its sides serves the blur alone and is not put back.
    """

    left: int
    top: int
    right: int
    bottom: int
    size: tuple[int, int]
    margin: int

    @classmethod
    def around(
        cls, extents: Sequence[tuple[Array, Array]], size: tuple[int, int], margin: int
    ) -> Self | None:
        """Window around points (u, v) [px] and twice the margin; None where it misses the image."""
        shown = [extent for extent in extents if len(extent[0])]
        if not shown:
            return None
        left, top = (int(min(pair[j].min() for pair in shown)) - 2 * margin for j in range(2))
        right, bottom = (
            int(max(pair[j].max() for pair in shown)) + 2 * margin + 1 for j in range(2)
        )
        window = cls(
            max(left, 0), max(top, 0), min(right, size[0]), min(bottom, size[1]), size, margin
        )
        return window if window.left < window.right and window.top < window.bottom else None

    @property
    def origin(self) -> tuple[int, int]:
        """First pixel (u, v) of the window."""
        return self.left, self.top

    def of(self, image: NDArray[T]) -> NDArray[T]:
        """View of the window's part of `image`."""
        return image[self.top : self.bottom, self.left : self.right]

    def put(self, part: Image, image: Image) -> None:
        """Copy `part` into `image`, without the margin at sides that lie inside the image."""
        above, left = (self.margin if side > 0 else 0 for side in (self.top, self.left))
        right = self.right - (self.margin if self.right < self.size[0] else 0)
        bottom = self.bottom - (self.margin if self.bottom < self.size[1] else 0)
        rows = slice(self.top + above, max(bottom, self.top + above))
        columns = slice(self.left + left, max(right, self.left + left))
        image[rows, columns] = part[
            above : above + rows.stop - rows.start, left : left + columns.stop - columns.start
        ]
