"""Pieces of a page: tables, charts, maps of φ and ψ, as HTML that loads nothing, and tables as Markdown."""

from __future__ import annotations

import re
import textwrap
from html import escape

import numpy as np

from .statistics import BINS

#: Name → points (x, y).
Series = dict[str, list[tuple[float, float]]]


#: Columns of paragraphs in Markdown.
WIDTH = 150

#: Of lines, in turn.
COLORS = ("#1d6fb8", "#c2410c", "#15803d", "#7c3aed", "#0e7490", "#a16207", "#be185d")

STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#1c2126;background:#fff}table{border-collapse:collapse}"
    "td,th{padding:.2em .8em;text-align:right;border-bottom:1px solid #d5dbe1}td:first-child,th:first-child{text-align:left}"
    "text{font:13px sans-serif;fill:#1c2126}.g{stroke:#d5dbe1;fill:none}polyline{fill:none;stroke-width:2}figure{display:inline-block;margin:1em}"
    + "".join(f".c{k}{{stroke:{color}}}" for k, color in enumerate(COLORS))
    + "text[class]{stroke:none}"
    + "".join(f"text.c{k}{{fill:{color}}}" for k, color in enumerate(COLORS))
    + ".map rect{fill:#1d6fb8}.map .frame{fill:none;stroke:#7f97b0}"
)


def table(header: list[str], rows: list[list[str]]) -> str:
    """An HTML table."""
    line = lambda cells, tag: "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"  # noqa: E731
    return f"<table>{line(header, 'th')}{''.join(line(row, 'td') for row in rows)}</table>"


def chart(series: Series, x_label: str, y_label: str = "energy noise, kJ/mol") -> str:
    """Lines through points, both axes logarithmic, as SVG."""
    width, height, left, bottom = 640, 360, 70, 50
    points = [(name, x, y) for name, own in series.items() for x, y in own if np.isfinite(y) and y > 0]
    if not points:
        return ""
    xs, ys = (np.log10([p[k] for p in points]) for k in (1, 2))
    (x0, x1), (y0, y1) = ((np.floor(2 * v.min() - 0.1) / 2, np.ceil(2 * v.max() + 0.1) / 2) for v in (xs, ys))
    place_x = lambda v: left + (v - x0) / (x1 - x0) * (width - left - 20)  # noqa: E731
    place_y = lambda v: height - bottom - (v - y0) / (y1 - y0) * (height - bottom - 20)  # noqa: E731
    parts = [f'<svg viewBox="0 0 {width} {height}" width="{width}" role="img">']
    for v in range(int(np.ceil(x0)), int(np.floor(x1)) + 1):
        parts.append(f'<path class="g" d="M{place_x(v):.1f} 20V{height - bottom}"/>')
        parts.append(f'<text x="{place_x(v):.1f}" y="{height - bottom + 18}" text-anchor="middle">{10.0**v:g}</text>')
    for v in range(int(np.ceil(y0)), int(np.floor(y1)) + 1):
        parts.append(f'<path class="g" d="M{left} {place_y(v):.1f}H{width - 20}"/>')
        parts.append(f'<text x="{left - 6}" y="{place_y(v) + 4:.1f}" text-anchor="end">{10.0**v:g}</text>')
    for k, program in enumerate(dict.fromkeys(p[0] for p in points)):
        own = [(place_x(a), place_y(b)) for (p, *_), a, b in zip(points, xs, ys) if p == program]
        parts.append(f'<polyline class="c{k}" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in own)}"/>')
        parts += [f'<circle class="c{k}" cx="{a:.1f}" cy="{b:.1f}" r="3"/>' for a, b in own]
        parts.append(f'<text class="c{k}" x="{left + 10}" y="{36 + 17 * k}">{escape(program)}</text>')
    parts.append(f'<text x="{width / 2}" y="{height - 10}" text-anchor="middle">{escape(x_label)}</text>')
    parts.append(f'<text x="14" y="{height / 2}" transform="rotate(-90 14 {height / 2})" text-anchor="middle">{escape(y_label)}</text></svg>')
    return "".join(parts)


def ramachandran(name: str, density: np.ndarray) -> str:
    """A map of φ (to the right) and ψ (up)."""
    size, top = 9, np.sqrt(density.max()) or 1.0
    cells = [
        f'<rect x="{size * i}" y="{size * (BINS - 1 - j)}" width="{size}" height="{size}" fill-opacity="{np.sqrt(density[i, j]) / top:.2f}"/>'
        for i in range(BINS)
        for j in range(BINS)
        if density[i, j] > 0
    ]
    side = size * BINS
    return (
        f'<figure><svg viewBox="0 0 {side} {side}" width="{side}" class="map"><rect class="frame" width="{side}" height="{side}"/>'
        f"{''.join(cells)}</svg><figcaption>{escape(name)}</figcaption></figure>"
    )


def start(title: str) -> str:
    """The beginning of a page."""
    return f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style><h1>{escape(title)}</h1>"


class Page:
    """A page that is written as HTML and as Markdown: what is added in turn; charts and maps are in HTML alone."""

    def __init__(self, title: str) -> None:
        self.html, self.markdown = [start(title)], [f"# {title}\n"]

    def heading(self, text: str) -> None:
        self.html.append(f"<h2>{escape(text)}</h2>")
        self.markdown.append(f"## {text}\n")

    def text(self, text: str) -> None:
        """A paragraph, with code between backquotes."""
        self.html.append("<p>" + re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text)) + "</p>")
        self.markdown.append(textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + "\n")

    def table(self, header: list[str], rows: list[list[str]], is_long: bool = False) -> None:
        """A table; a long one is in HTML alone."""
        self.html.append(table(header, rows))
        if is_long:
            return
        lines = [header, ["---"] * len(header), *rows]
        self.markdown.append("\n".join("| " + " | ".join(c.replace("|", "\\|") for c in line) + " |" for line in lines) + "\n")

    def figure(self, html: str) -> None:
        self.html.append(html)
