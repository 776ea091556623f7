"""Figure of a measurement: photograph, midline and fitted strip, and their
residuals.
"""

from typing import Any

import cv2

from cell.report.drawing import BLUE, MUTED, ORANGE, as_png, canvas
from cell.setup.strips.cantilever_fit import Fit, RestCurvature
from drivers.base.errors import in_mm
from drivers.strip.cantilever import hinges

PICTURE_HEIGHT = 1600  # px of the photograph in the picture
DPI = 150
BEND = 1.5  # bending lengths beside and below the ledge, shown larger
SEEN_COLOUR, FITTED_COLOUR, STRAIGHT_COLOUR = "#19c8c8", ORANGE, BLUE


def fit_figure(fitted: Fit, straight: Fit) -> bytes:
    """Figure, as the content of a PNG file, of the photograph with its midline and the
    fitted strips, and of the distances between them.
    """
    with canvas(10.5, 8.0) as figure:
        left, right = figure.subfigures(1, 2, width_ratios=(1.2, 1.0))
        overview, bend = left.subplots(1, 2)
        _draw_photograph(overview, fitted, straight)
        _draw_photograph(bend, fitted, straight)
        _zoom_to_ledge(bend, fitted)
        if fitted.prior.kind is RestCurvature.STRAIGHT:
            _draw_residuals(right.subplots(), fitted, straight)
        else:
            upper, lower = right.subplots(2, 1, sharex=True)
            _draw_residuals(upper, fitted, straight)
            _draw_rest_curvature(lower, fitted)

        figure.suptitle(_title(fitted, straight), fontsize=9.5)
        return as_png(figure, DPI)


def _title(fitted: Fit, straight: Fit) -> str:
    """Title of the figure: the photograph, the fitted bending length, and the one for a
    strip that is straight without load.
    """
    photograph = fitted.photograph
    text = (
        f"{photograph.path.name}, overhang {1e3 * photograph.overhang:.4g} mm: bending"
        f" length {in_mm(fitted.bending_length, 1)}, sigma"
        f" {100 * fitted.sigma:.1f} %"
    )
    if fitted.prior.kind is RestCurvature.STRAIGHT:
        return text
    return f"{text} (taken as born straight: {in_mm(straight.bending_length, 1)})"


def _draw_photograph(axes: Any, fitted: Fit, straight: Fit) -> None:
    """Draw the photograph into `axes`, with the midline, the fitted strip, and the
    fitted one that is straight without load.
    """
    photograph = fitted.photograph
    image = photograph.image
    height, width = image.shape[:2]
    scale = min(1.0, PICTURE_HEIGHT / height)
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    axes.imshow(small[..., ::-1], extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    midline = photograph.points / photograph.pixel * (1, -1)
    axes.plot(*midline.T, color=SEEN_COLOUR, lw=1.6, label="midline")
    if straight is not fitted:
        axes.plot(
            *straight.curve().T,
            color=STRAIGHT_COLOUR,
            lw=0.9,
            ls="--",
            label="born straight",
        )

    axes.plot(*fitted.curve().T, color=FITTED_COLOUR, lw=0.9, label="fit")
    axes.grid(visible=False)
    axes.set(xticks=(), yticks=(), xlim=(-0.06 * height, width))
    axes.spines[:].set_visible(False)


def _zoom_to_ledge(axes: Any, fitted: Fit) -> None:
    """Limit `axes` to the first stretch of the strip behind the ledge, where it bends
    most.
    """
    photograph = fitted.photograph
    reach = min(BEND * fitted.bending_length, photograph.overhang) / photograph.pixel
    u, v = photograph.points[0] / photograph.pixel * (1, -1)
    axes.set(xlim=(u - 0.2 * reach, u + 0.8 * reach), ylim=(v + reach, v - 0.3 * reach))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02))


def _draw_residuals(axes: Any, fitted: Fit, straight: Fit) -> None:
    """Draw the distances of the photographed midline from both fitted strips into
    `axes`, over the arc length.
    """
    arc = 1e3 * fitted.photograph.arc
    if straight is not fitted:
        axes.plot(
            arc,
            1e3 * straight.misses,
            color=STRAIGHT_COLOUR,
            ls="--",
            label="born straight",
        )
    axes.plot(arc, 1e3 * fitted.misses, color=FITTED_COLOUR, label="fit")
    axes.axhline(0, color=MUTED, lw=0.6)
    axes.set(xlabel="along the strip  [mm]", ylabel="midline beside the fit  [mm]")
    axes.legend(loc="best")


def _draw_rest_curvature(axes: Any, fitted: Fit) -> None:
    arc = 1e3 * hinges(fitted.photograph.overhang)
    axes.plot(arc, fitted.rest_curvature, color=FITTED_COLOUR)
    axes.axhline(0, color=MUTED, lw=0.6)
    axes.set(
        xlabel="along the strip  [mm]", ylabel="curvature of the strip unloaded  [1/m]"
    )
