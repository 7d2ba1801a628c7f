"""Self-contained HTML pages: a title, tables, pictures."""

import base64
import csv
import html
import io
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from vsx_ros.evaluation.paired import Interval


class Section(NamedTuple):
    """A part of a page. body: HTML."""

    title: str
    body: str


def page(title: str, facts: str, sections: Iterable[Section]) -> str:
    """The page. facts: the basis of its results, in words. A section with the page's title gets no heading."""
    heads = ((f"<h2>{html.escape(s.title)}</h2>" if s.title != title else "", s.body) for s in sections)
    body = "".join(f"<section>{head}{content}</section>" for head, content in heads)
    return document(title, f"<h1>{html.escape(title)}</h1>{paragraph(facts)}{body}", _FIGURES)


def document(title: str, body: str, style: str) -> str:
    """A whole page. title: text. body: HTML. style: CSS in addition to the style of all pages."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}{style}</style></head>'
        f"<body><main>{body}</main></body></html>\n"
    )


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{html.escape(text)}</p>"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table. Cells are plain text; the first of each row is its name. Empty if there are no rows."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in header)
    lines = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{lines}</table>" if lines else ""


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """The table as CSV for spreadsheets; floats with six digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row])
    return text.getvalue()


def figures(pictures: Iterable[tuple[str, str]]) -> str:
    """(caption, svg or img) side by side if there is room."""
    shown = (f"<figure>{picture}<figcaption>{html.escape(name)}</figcaption></figure>" for name, picture in pictures)
    return f'<div class="figures">{"".join(shown)}</div>'


def png_figure(caption: str, png: bytes) -> str:
    """A picture with its caption; empty without a picture."""
    image = base64.b64encode(png).decode()
    picture = f'<img alt="{html.escape(caption)}" src="data:image/png;base64,{image}">'
    return f'<figure class="seen">{picture}<figcaption>{html.escape(caption)}</figcaption></figure>' if png else ""


def interval(value: Interval | None, form: str = ".2f") -> str:
    """A value with its interval, as text."""
    if value is None:
        return "unknown"
    low, high = ("unknown" if end is None else f"{end:{form}}" for end in value[1:])
    return f"{value.value:{form}} [{low}, {high}]"


_STYLE = """
:root{color-scheme:light dark;--ink:#1d2329;--soft:#5f6b76;--line:#d9dee3;--paper:#fff;--tile:#f3f5f7;--blue:#1f6fd6;
--green:#1d9a6c;--red:#c83232}
@media(prefers-color-scheme:dark){:root{--ink:#e8ebee;--soft:#9aa6b2;--line:#3a434c;--paper:#15191d;--tile:#20262c;
--blue:#6aa8ff;--green:#4fd1a0;--red:#ff7b7b}}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
main{max-width:1080px;margin:0 auto;padding:24px 20px 60px}
h1{font-size:26px;margin:0 0 6px}h2{font-size:18px;margin:36px 0 10px}
table{border-collapse:collapse;font-size:13.5px;font-variant-numeric:tabular-nums;margin:8px 0 16px}
td,th{text-align:left;padding:4px 14px 4px 0;border-bottom:1px solid var(--line);vertical-align:top}
svg{display:block;width:100%;height:auto;border-radius:6px}svg text{fill:var(--soft);font:12px system-ui,sans-serif}
svg.map{--blue:#1f6fd6;--green:#12855a;--red:#c83232;--soft:#4d5964;--ink:#1d2329;background:#c4c9ce;margin:0 auto}
.grid{stroke:var(--line)}polyline{fill:none;stroke-width:2}.bar{stroke:var(--ink);stroke-width:3}
pre{overflow:auto;background:var(--tile);padding:10px 12px;border-radius:6px;font-size:13px}
"""
_FIGURES = """
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(400px,100%),1fr));gap:16px}
figure{margin:0;min-width:0}figure svg.plot{background:var(--tile)}figure img{max-width:100%;height:auto}
figure svg,figure img{border:1px solid var(--line);box-sizing:border-box}
figcaption{color:var(--soft);font-size:13px}
.planned,.first{stroke:var(--blue)}.second{stroke:var(--red)}.estimate{stroke:var(--green);stroke-width:2.5}
.driven{stroke:var(--soft);stroke-dasharray:4 4}.view{stroke:var(--blue);stroke-width:1;opacity:.6}
.dots{stroke:var(--blue);stroke-width:4;stroke-linecap:round;opacity:.5}
circle.broke{fill:#8b2fc9}circle.start{fill:var(--ink)}circle.goal{fill:none;stroke:var(--ink);stroke-width:2}
"""
