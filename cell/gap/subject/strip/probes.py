"""Positions along the strip at which localised effects are screened."""

import numpy as np

from drivers.strip.file import StripFile

PLACE_SPACING = 0.9  # bending lengths between the places at which an effect of one place is tried


def places(strip: StripFile, lifted: float) -> tuple[float, ...]:
    """Positions [m] along the strip to screen, from `lifted` [m] on, where it leaves the desk.

    A bend shows an effect of one place while it passes, so that probes farther apart than about
    a bending length miss what lies between them.
    """
    begin = max(0.0, lifted - PLACE_SPACING * strip.bending_length)
    count = max(2, round((strip.length - begin) / (PLACE_SPACING * strip.bending_length)))
    return tuple(map(float, np.linspace(begin, strip.length, 2 * count + 1)[1::2]))
