"""Tables and lists for a terminal of any width: no line is longer, and none ends inside a word.

A column that has no room in the terminal stands below its row, with its title. In a pipe or a file
there is room for all.
"""

from collections.abc import Iterable, Mapping, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

GAP = 2
"""Blanks between columns, and before what stands below its row."""
LONGEST = 40
"""A longer cell moves the rest of its line alone."""
READABLE = 36
"""Columns that a longer text needs beside its name; with fewer it stands below."""


def grid(console: Console, lines: Mapping[str, str], width: int = 10) -> None:
    """Show a line of text for each name; `width` is that of a name at least."""
    if not console.is_terminal:
        for name, line in lines.items():
            console.print(Text.assemble((f"{name:<{width}}", "bold"), " ", line))
        return
    table = Table.grid(padding=(0, 1))
    table.add_column(style="bold", min_width=width, no_wrap=True)
    table.add_column(overflow="fold")
    for name, line in lines.items():
        table.add_row(name, Text(line))
    console.print(table, soft_wrap=False)


def table(console: Console, columns: Sequence[Column], rows: Iterable[Sequence[str]]) -> None:
    """Show rows of marked-up cells under the columns' headers, which are bold."""
    titles = [Text.from_markup(str(column.header)) for column in columns]
    cells = [[Text.from_markup(cell) for cell in row] for row in rows]
    widths = [
        min(max(cell.cell_len for cell in column), LONGEST)
        for column in zip(titles, *cells, strict=True)
    ]
    beside = _beside(widths, console.width if console.is_terminal else sum(widths) * 2)
    for row in (titles, *cells):
        line = Text()
        for i in beside:
            line.append_text(_aligned(row[i], widths[i], columns[i].justify == "right"))
            line.append(" " * GAP)
        line.rstrip()
        if row is titles:
            line.stylize("bold")
        console.print(line, soft_wrap=not console.is_terminal)
        below = [i for i in range(len(columns)) if i not in beside and row[i].plain]
        if row is not titles and below:
            parts = [Text.assemble(titles[i], ": " * bool(titles[i]), row[i]) for i in below]
            _print_below(console, Text("; ").join(parts), GAP)


def findings_table(
    console: Console, rows: Iterable[tuple[str, str, str]], widths: tuple[int, int]
) -> None:
    """Show a line for each finding: its name, a marked-up word for what it is, and its text."""
    for name, mark, text in rows:
        head = Text(f"{'':{GAP}}{name:<{widths[0]}}")
        head.append_text(_aligned(Text.from_markup(mark), widths[1], right=False))
        if not console.is_terminal:
            console.print(head.append(text), soft_wrap=True)
        elif (room := console.width - head.cell_len) < READABLE and len(text) > room:
            head.rstrip()
            console.print(head, soft_wrap=False)
            _print_below(console, Text(text), 2 * GAP)
        else:
            line = Table.grid()
            line.add_column(width=head.cell_len, no_wrap=True)
            line.add_column(overflow="fold")
            line.add_row(head, Text(text))
            console.print(line, soft_wrap=False)


def _beside(widths: Sequence[int], room: int) -> list[int]:
    """Return the columns that stand beside one another: the first, and the next that have room."""
    beside, used = [0], widths[0]
    for i, width in enumerate(widths[1:], 1):
        if used + GAP + width <= room:
            beside.append(i)
            used += GAP + width
    return beside


def _aligned(cell: Text, width: int, right: bool) -> Text:
    blanks = Text(" " * (width - cell.cell_len))
    return Text.assemble(blanks, cell) if right else Text.assemble(cell, blanks)


def _print_below(console: Console, text: Text, indent: int) -> None:
    console.print(Padding(text, (0, 0, 0, indent)), soft_wrap=False)
