"""A study as a page that needs nothing else: lines, figures in SVG, and tables."""

from collections.abc import Mapping, Sequence
from html import escape

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; margin: 2rem auto; max-width: 70rem;
       padding: 0 1rem; background: #fff; }
h1 { font-size: 1.4rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
svg { width: 100%; height: auto; }
table { border-collapse: collapse; font-size: 13px; }
th, td { text-align: left; padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #e3e6ea;
         vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
code { font-size: 12px; background: #f3f4f6; padding: .1rem .3rem; border-radius: 3px; }
.wide { overflow-x: auto; }
"""
Cell = str | float | int | None
Listing = tuple[Sequence[str], Sequence[Sequence[Cell]]]
"""Columns and rows."""
MOST = 500
"""Rows of a table in the page."""


def study_page(
    title: str,
    lead: Mapping[str, str],
    figures: Sequence[str],
    tables: Mapping[str, Listing],
) -> str:
    """Return the page of a study: lines by name, figures in SVG, tables by heading.

    A cell that begins with `recordings/` is a link, and one that begins with `nrs ` a line to run.
    """
    parts = [
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">',
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "style-src 'unsafe-inline'; img-src data:\">",
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1><table>",
        *(
            f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>"
            for name, text in lead.items()
        ),
        "</table>",
        *(f"<figure>{figure}</figure>" for figure in figures),
        *(_table(heading, *table) for heading, table in tables.items()),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows[:MOST])
    more = f"<p>and {len(rows) - MOST} more</p>" if len(rows) > MOST else ""
    whole = f"<div class=wide><table><tr>{head}</tr>{body}</table></div>"
    return f"<h2>{escape(heading)}</h2>{whole}{more}"


def _cell(value: Cell) -> str:
    if value is None:
        return "<td></td>"
    if isinstance(value, float | int):
        return f"<td class=number>{value:.6g}</td>"
    if value.startswith("recordings/"):
        return f'<td><a href="{escape(value)}">recording</a></td>'
    if value.startswith("nrs "):
        return f"<td><code>{escape(value)}</code></td>"
    return f"<td>{escape(value)}</td>"
