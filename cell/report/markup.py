"""HTML elements of a self-contained page."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import Literal
from urllib.parse import quote

Tone = Literal["good", "fair", "bad"]
JPEG = "data:image/jpeg;base64,"


def page(title: str, body: Sequence[str]) -> str:
    """A whole HTML document of finished elements."""
    style = files("cell.report").joinpath("style.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n"
        "<body>\n<main>\n" + "\n".join(part for part in body if part) + "\n</main>\n"
        "</body>\n</html>\n"
    )


def masthead(kicker: str, name: str) -> str:
    """The line on top: kind of page, and its run."""
    return f"<header><span>{escape(kicker)}</span><code>{escape(name)}</code></header>"


def verdict_box(
    tone: Tone,
    headline: str,
    sentences: Sequence[str],
    figure: str = "",
    error: str = "",
    picture: str = "",
) -> str:
    """The verdict on top: a large number and its error where there is one, headline, sentences, and
    a `picture` (JPEG, base64) of what came of it.
    """
    number = ""
    if figure:
        seen = f'<img alt="the end of the run" src="{JPEG}{picture}">' if picture else ""
        number = (
            f'<div class="figure"><b>{escape(figure)}</b><small>{escape(error)}</small>{seen}</div>'
        )
    text = "".join(f"<p>{_keep_units(escape(sentence))}</p>" for sentence in sentences)
    return (
        f'<section class="verdict {tone}">{number}'
        f'<div class="said"><h1>{_keep_units(escape(headline))}</h1>{text}</div></section>'
    )


def _keep_units(text: str) -> str:
    """`text` in which no line ends between a number and its unit."""
    return re.sub(r"(\d) (?=(?:mm|ms|s|%)\b|%)", "\\1&nbsp;", text)


def section(title: str, *content: str, note: str = "") -> str:
    """A section; empty when it has no content."""
    inside = "".join(content)
    if not inside:
        return ""
    remark = f'<p class="note">{escape(note)}</p>' if note else ""
    return f"<section><h2>{escape(title)}</h2>{remark}{inside}</section>"


def drawing(svg: str, says: str) -> str:
    """A figure; `says` is its alternative text."""
    return f'<figure role="img" aria-label="{escape(says)}">{svg}</figure>'


def film(path: str, begin: float) -> str:
    """The film at `path` from the page; its first image was taken at `begin` [s].

    In the section of a figure with `data-first` and `data-last`, both show the same moment.
    """
    script = files("cell.report").joinpath("film.js").read_text(encoding="utf-8")
    return (
        f'<figure><video controls muted playsinline preload="metadata" data-begin="{begin:.6f}" '
        f'src="{escape(quote(path))}"></video><p class="note" hidden>This browser does not play '
        f"the film; VLC and Chromium do.</p><output></output></figure><script>\n{script}</script>"
    )


def photographs(pictures: Sequence[tuple[str, str, str]]) -> str:
    """JPEGs (base64) with captions, side by side; each leads to its whole picture, a path."""
    if not pictures:
        return ""
    inside = "".join(
        f'<figure><a href="{escape(quote(whole))}"><img src="{JPEG}{jpeg}" '
        f'alt="{escape(caption)}" width="640"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for jpeg, caption, whole in pictures
    )
    return f'<div class="photographs">{inside}</div>'


def definitions(rows: Sequence[tuple[str, str]], kind: str = "") -> str:
    """Names and values."""
    if not rows:
        return ""
    inside = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in rows
    )
    return f'<dl class="{kind}">{inside}</dl>'


@dataclass(frozen=True, slots=True)
class Link:
    """A cell that leads to `href`, a path from the page."""

    text: str
    href: str

    def __str__(self) -> str:
        return f'<a href="{escape(quote(self.href))}">{escape(self.text)}</a>'


def table(head: Sequence[str], rows: Sequence[Sequence[str | Link]]) -> str:
    """A table with a line of headings."""
    if not rows:
        return ""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = "".join(
        "<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    head_and_body = f"<thead><tr>{top}</tr></thead><tbody>{lines}</tbody>"
    return f'<div class="wide"><table>{head_and_body}</table></div>'


def _cell(cell: str | Link) -> str:
    return str(cell) if isinstance(cell, Link) else escape(cell)


def steps(lines: Sequence[str]) -> str:
    """Things to do, in order; `code` between backticks."""
    if not lines:
        return ""
    return "<ol>" + "".join(f"<li>{_with_code(line)}</li>" for line in lines) + "</ol>"


def _with_code(line: str) -> str:
    parts = escape(line).split("`")
    return "".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts))
