"""Tables and lists for a terminal of any width: no line is longer, and none ends inside a word.

Where columns have no room, titles are folded, and a last column of texts; what has none even then
stands below its row, with its title. A text of the last column that is longer than what is left
goes on below itself. In a pipe or a file there is room for all.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf

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
    titles = [Text.from_markup(str(column.header), style="bold", emoji=False) for column in columns]
    cells = [[Text.from_markup(cell, emoji=False) for cell in row] for row in rows]
    room = console.width if console.is_terminal else inf
    gap, widths, beside, folded = _layout(columns, titles, cells, room)
    for row in (titles, *cells):
        parts = {
            i: row[i].wrap(console, widths[i]) if row is titles or i in folded else [row[i]]
            for i in beside
        }
        high = max(map(len, parts.values()))
        for number in range(high):
            line = Text()
            for i, part in parts.items():
                # The lines of a title stand on the row below it; those of a cell hang from its top.
                at = number - (high - len(part) if row is titles else 0)
                shown = part[at] if 0 <= at < len(part) else Text()
                shown.rstrip()  # of the blank that a fold ends with
                line.append_text(_aligned(shown, widths[i], columns[i].justify == "right"))
                line.append(" " * gap)
            line.rstrip()
            console.print(line, soft_wrap=not console.is_terminal)
        below = [i for i in range(len(columns)) if i not in beside and row[i].plain]
        if row is not titles and below:
            texts = [Text.assemble(titles[i].plain, ": " * bool(titles[i]), row[i]) for i in below]
            _print_below(console, Text("; ").join(texts), GAP)


def _layout(
    columns: Sequence[Column],
    titles: Sequence[Text],
    cells: Sequence[Sequence[Text]],
    room: float,
) -> tuple[int, list[int], Sequence[int], Sequence[int]]:
    """Return the blanks between columns, their widths, which stand in a row, which are folded.

    All do, if need be with folded titles, fewer blanks between them, and a last column of texts
    that is folded to no less than half. Else they are the first, and the next that have room.
    """

    def widths_of(folded: bool) -> list[int]:
        least = [max(map(len, title.plain.split()), default=0) for title in titles]
        heads = least if folded else [title.cell_len for title in titles]
        return [
            min(max([head, *(row[i].cell_len for row in cells)]), LONGEST)
            for i, head in enumerate(heads)
        ]

    texts = columns[-1].justify != "right"
    for part in (0.0, 0.5) if texts else (0.0,):
        for gap, folded in ((GAP, False), (GAP, True), (1, True)):
            widths = widths_of(folded)
            over = sum(widths) + gap * (len(widths) - 1) - room
            if over <= part * widths[-1]:
                longest = max((row[-1].cell_len for row in cells), default=0)
                left = max(widths[-1] - over, 0)
                folds = texts and longest > left
                widths[-1] = int(left) if folds else widths[-1]
                everything = range(len(widths))
                return gap, widths, everything, everything[-1:] if folds else ()
    widths = widths_of(False)
    return GAP, widths, _beside(widths, room), ()


def findings_table(
    console: Console, rows: Iterable[tuple[str, str, str]], widths: tuple[int, int]
) -> None:
    """Show a line for each finding: its name, a marked-up word for what it is, and its text."""
    for name, mark, text in rows:
        head = Text(f"{'':{GAP}}{name:<{widths[0]}}")
        head.append_text(_aligned(Text.from_markup(mark, emoji=False), widths[1], right=False))
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


def _beside(widths: Sequence[int], room: float) -> list[int]:
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
