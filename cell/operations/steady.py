"""A run without long pauses of the interpreter."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_long_collections() -> Iterator[None]:
    """Within it the collector of garbage looks at no object from before.

    A whole collection looks at some half a million objects of the libraries and takes longer than
    an arm follows a velocity target; what a run itself leaves is looked at in under a millisecond.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
