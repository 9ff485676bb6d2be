"""The page of a report: one HTML file that holds its style and its pictures, in the manner of the project's site."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping

from flexmbd.report.contents import Cell, Content, Listing, Paragraph, Report, ReportPicture, ReportTable, number_text

# Fonts, widths and colours of the site's theme (docs/conf.py), and what docs/_static/site.css adds.
_STYLE = """\
:root { color-scheme: light dark; --ink: #000; --paper: #fff; --soft: #f8f9fb; --line: #eeebee; --quiet: #5a5c63;
  --link: #2757dd; --good: #1e7b34; --bad: #b3261e; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #cfd0d0; --paper: #131416; --soft: #1a1c1e; --line: #303335; --quiet: #9ca0a5; --link: #5ca5ff;
    --good: #6cc07f; --bad: #ff8a80; }
  figure img { background: #fff; border-radius: .3rem; }
}
body { margin: 0; background: var(--paper); color: var(--ink); line-height: 1.5;
  font-family: -apple-system, BlinkMacSystemFont, "Segoe UI", Helvetica, Arial, sans-serif; }
main { max-width: 58rem; margin: 0 auto; padding: 1rem 1.5rem 4rem; }
h1 { font-size: 2.2em; line-height: 1.25; margin: 1.5rem 0 .6rem; }
h2 { font-size: 1.6em; margin: 2.4rem 0 .6rem; }
a { color: var(--link); }
figure { margin: 1.4rem 0; overflow-x: auto; }
figcaption { color: var(--quiet); font-size: .9em; margin: .4rem 0; }
img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .9em; }
th, td { padding: .25rem .6rem; border: 1px solid var(--line); text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th { background: var(--soft); }
pre { background: var(--soft); padding: .7rem 1rem; overflow-x: auto; font-size: .85em; border-radius: .2rem; }
.verdict { font-weight: 700; }
.good { color: var(--good); }
.bad { color: var(--bad); }
footer { margin-top: 3rem; border-top: 1px solid var(--line); color: var(--quiet); font-size: .85em;
  overflow-wrap: anywhere; }
"""
_LONG = 30  # rows of a table that is shown when a reader asks for it
_GOOD, _BAD = ("PASS",), ("FAIL", "STOPPED")


def page(report: Report, *, pictures: Mapping[str, bytes], digest: Mapping[str, Mapping[str, str]]) -> str:
    """The page as text.

    Args:
        report: what it tells.
        pictures: by name, as SVG.
        digest: what stands at its end.
    """
    title = html.escape(report.title)
    lines = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title>",
        f"<style>\n{_STYLE}</style></head>",
        f"<body><main>\n<h1>{title}</h1>",
    ]
    if report.verdict:
        lines.append(f'<p class="verdict{_tone(report.verdict)}">{html.escape(report.verdict)}</p>')
    lines.append(f"<p>{html.escape(report.summary)}</p>")
    for section in report.sections:
        lines.append(f"<section><h2>{html.escape(section.title)}</h2>")
        lines.extend(_content(one, pictures) for one in section.contents)
        lines.append("</section>")
    lines.append("<footer><h2>Versions and digest</h2>")
    for name, values in digest.items():
        listed = "".join(f"<li>{html.escape(key)}: {html.escape(value)}</li>" for key, value in values.items())
        lines.append(f"<p>{html.escape(name)}</p><ul>{listed}</ul>")
    lines.append("</footer></main></body></html>\n")
    return "\n".join(lines)


def _content(content: Content, pictures: Mapping[str, bytes]) -> str:
    match content:
        case Paragraph(text):
            return f"<p>{html.escape(text)}</p>"
        case Listing(text):
            return f"<pre>{html.escape(text)}</pre>"
        case ReportTable():
            return _table(content)
        case ReportPicture(name, caption):
            data = base64.b64encode(pictures[name]).decode()
            files = _files("figures", name, ("svg", "pdf"))
            alt = html.escape(caption, quote=True)
            picture = f'<img alt="{alt}" src="data:image/svg+xml;base64,{data}">'
            return f"<figure>{picture}<figcaption>{html.escape(caption)}. {files}</figcaption></figure>"


def _table(table: ReportTable) -> str:
    head = "".join(f"<th>{html.escape(text)}</th>" for text in table.headings)
    rows = "\n".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in table.rows)
    files = _files("tables", table.name, ("csv", "tex"))
    caption = f"<figcaption>{html.escape(table.caption)}. {files}</figcaption>"
    whole = f"<table><thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table>"
    if len(table.rows) > _LONG:
        whole = f"<details><summary>{len(table.rows)} rows</summary>{whole}</details>"
    return f"<figure>{caption}{whole}</figure>"


def _cell(cell: Cell) -> str:
    if isinstance(cell, str):
        return f'<td class="{_tone(cell).strip()}">{html.escape(cell)}</td>' if _tone(cell) else (
            f"<td>{html.escape(cell)}</td>"
        )  # fmt: skip
    infinite = isinstance(cell, float) and math.isinf(cell)
    text = ("&infin;" if cell > 0 else "-&infin;") if infinite else number_text(cell)
    return f'<td class="number">{text}</td>'


def _files(folder: str, name: str, kinds: tuple[str, ...]) -> str:
    return " ".join(f'<a href="{folder}/{name}.{kind}">.{kind}</a>' for kind in kinds)


def _tone(word: str) -> str:
    first = word.split(maxsplit=1)[0] if word.strip() else ""
    return " good" if first in _GOOD else " bad" if first in _BAD else ""
