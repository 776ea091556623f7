"""Positions along the strip at which localised effects are screened."""

import numpy as np

from drivers.strip.file import StripFile

PLACE_SPACING = 0.9  # bending lengths between the places at which a local effect is screened


def places(strip: StripFile, lifted: float) -> tuple[float, ...]:
    """Positions [m] along the strip at which to screen, from its lift-off at `lifted` [m] on.

    A bend shows a local effect while it passes, so that probes farther apart than about a bending
    length miss what lies between them.
    """
    begin = max(0.0, lifted - PLACE_SPACING * strip.bending_length)
    count = max(2, round((strip.length - begin) / (PLACE_SPACING * strip.bending_length)))
    return tuple(map(float, np.linspace(begin, strip.length, 2 * count + 1)[1::2]))
