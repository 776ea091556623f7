"""HTML elements of a self-contained page."""

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Literal

Tone = Literal["good", "fair", "bad"]


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
    tone: Tone, headline: str, sentences: Sequence[str], figure: str = "", error: str = ""
) -> str:
    """The verdict on top: a large number and its error where there is one, headline, sentences."""
    number = ""
    if figure:
        number = f'<div class="figure"><b>{escape(figure)}</b><small>{escape(error)}</small></div>'
    text = "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)
    return (
        f'<section class="verdict {tone}">{number}'
        f'<div class="said"><h1>{escape(headline)}</h1>{text}</div></section>'
    )


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


def photographs(pictures: Sequence[tuple[str, str]]) -> str:
    """JPEGs (base64) with captions, side by side."""
    if not pictures:
        return ""
    inside = "".join(
        f'<figure><img src="data:image/jpeg;base64,{jpeg}" alt="{escape(caption)}" '
        f'width="640"><figcaption>{escape(caption)}</figcaption></figure>'
        for jpeg, caption in pictures
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


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a line of headings."""
    if not rows:
        return ""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    head_and_body = f"<thead><tr>{top}</tr></thead><tbody>{lines}</tbody>"
    return f'<div class="wide"><table>{head_and_body}</table></div>'


def steps(lines: Sequence[str]) -> str:
    """Things to do, in order; `code` between backticks."""
    if not lines:
        return ""
    return "<ol>" + "".join(f"<li>{_with_code(line)}</li>" for line in lines) + "</ol>"


def _with_code(line: str) -> str:
    parts = escape(line).split("`")
    return "".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts))
