"""HTML pages from Jinja2 templates, with escaping and with all styles and scripts
inlined.
"""

import base64
import os
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

    from drivers.base.types import Image

Tone = Literal["good", "fair", "bad"]
UNITS = "(?:mm|m|ms|s|min|N|mN|g|kg|mrad|rad|deg|px|%|sigma)"  # regular expression


@dataclass(frozen=True, slots=True)
class Card:
    """Card at the head of a page: `headline` states the outcome, `sentences`
    explain it.

    `figure` and `error` are a number in large print and its error, if any; `tone` is
    its colour.
    """

    tone: Tone
    headline: str
    sentences: tuple[str, ...]
    figure: str = ""
    error: str = ""
    spoilt: bool = False  # the end is not known because result.yaml cannot be read


@dataclass(frozen=True, slots=True)
class Link:
    """Cell of an HTML table that links to `href`, a path relative to the page."""

    text: str
    href: str


def page(template: str, title: str, /, **facts: Any) -> str:
    """Render `template`, a path in the package `cell`, with `facts` as a whole HTML
    document.

    The template has the `title` too. What both hold is escaped. Raises
    jinja2.UndefinedError for a fact that the template uses and that is not there.
    """
    from markupsafe import Markup

    body = _environment().get_template(template).render({"title": title} | facts)
    frame = _environment().get_template("report/templates/base.html")
    charts = re.search(r'<figure class="[^"]*" role="img"', body)
    return frame.render(title=title, body=Markup(body), charts=charts)  # noqa: S704 escaped


def jpeg(image: "Image", width: int, quality: int = 70) -> bytes:
    """Encode `image` (h, w, 3) as a JPEG, `width` [px] wide."""
    import cv2

    size = (width, max(1, round(image.shape[0] * width / image.shape[1])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return bytes(content)


def jpeg_text(image: "Image", width: int = 640, quality: int = 82) -> str:
    """Encode `image` (h, w, 3) as `jpeg`, in base64 text."""
    return base64.b64encode(jpeg(image, width, quality)).decode()


@cache
def _environment() -> "Environment":
    """Jinja2 environment of the pages: the function `file`, the filters keep_units,
    with_code.

    Its filter `urlencode` takes a path's bytes, which Jinja2's own one would replace by
    UTF-8.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cell", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"keep_units": _keep_units, "with_code": _with_code}
    environment.filters["urlencode"] = _address
    environment.globals["file"] = _file
    return environment


def _file(name: str) -> "Markup":
    """Text of the style or script file `name` of this package, not escaped."""
    from markupsafe import Markup

    return Markup(files("cell.report").joinpath(name).read_text(encoding="utf-8"))  # noqa: S704 ours


def _address(path: str) -> str:
    """Percent-encoded URL of the file at `path`, whose name may hold any bytes."""
    return quote(os.fsencode(path))


def _keep_units(text: str) -> "Markup":
    """Mark up `text` so that no line breaks between a number and one of UNITS, or its
    sign.
    """
    from markupsafe import Markup, escape

    signed = str(escape(text)).replace("± ", "±&nbsp;")
    joined = re.sub(rf"(?<=\d) (?={UNITS}(?!\w))", "&nbsp;", signed)
    return Markup(joined)  # noqa: S704 escaped above


def _with_code(line: str) -> "Markup":
    """Mark up the text between backticks in `line` as code."""
    from markupsafe import Markup, escape

    parts = str(escape(line)).split("`")
    coded = (f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts))
    return Markup("".join(coded))  # noqa: S704 escaped above
