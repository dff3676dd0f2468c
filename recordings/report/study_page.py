"""A study as a page that needs nothing else: lines, figures in SVG, and tables."""

from collections.abc import Mapping, Sequence
from html import escape

_STYLE = """
:root { color-scheme: light dark; --page: #fff; --ink: #1b1f24; --line: #e3e6ea; --code: #f3f4f6;
        --link: #1f5fbf; }
@media (prefers-color-scheme: dark) {
  :root { --page: #101317; --ink: #eceff3; --line: #2d343d; --code: #22272e; --link: #7fb0ff; }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--page);
       margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
h1 { font-size: 1.4rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
a { color: var(--link); }
figure { margin: 1rem 0; padding: .4rem; overflow-x: auto; background: #fff; border-radius: 6px; }
svg { display: block; width: 100%; min-width: 44rem; height: auto; }
table { border-collapse: collapse; font-size: 13px; }
th, td { text-align: left; padding: .2rem .7rem .2rem 0; border-bottom: 1px solid var(--line);
         vertical-align: top; }
th, code { white-space: nowrap; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
.long { min-width: 20rem; }
code { font-size: 12px; background: var(--code); padding: .1rem .3rem; border-radius: 3px; }
.wide { overflow-x: auto; }
"""
Cell = str | float | int | None
Listing = tuple[Sequence[str], Sequence[Sequence[Cell]]]
"""Columns and rows."""
MOST = 500
"""Rows of a table in the page."""
_LONG = 40
"""Characters of a text that has lines of some length, however narrow the page."""


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
    of_numbers = [
        any(isinstance(row[at], float | int) for row in rows[:MOST]) for at in range(len(columns))
    ]
    head = "".join(
        f"<th{' class=number' * numbers}>{escape(column)}</th>"
        for column, numbers in zip(columns, of_numbers, strict=True)
    )
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
    return f"<td{' class=long' * (len(value) > _LONG)}>{escape(value)}</td>"
