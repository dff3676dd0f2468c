"""Pages are run as they are read: their files written, their sessions and programs tried, in order.

A block of a page is a file where the line before it ends with the file's name and a colon, as in
"Save it as `row.toml`:". Each `$` line of a console block is run by a shell, and so is each Python
block; what is shown of their output stands below the command, or in the block after the program.
Pictures of a page that its programs draw lie beside it.

A page that says "Each block here is a cell" is a notebook, of one kernel.

python -m docs.pages PAGE…    writes into the pages what their sessions and programs print
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nbclient import NotebookClient
from nbformat.v4 import new_code_cell, new_notebook

ROOT = Path(__file__).parents[1]
NOTEBOOK = "Each block here is a cell"
_ENVIRONMENT = {
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "MPLBACKEND": "agg",
    "NRS_PROGRESS": "off",
}
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"`([\w-]+\.\w+)`:\s*$")
_PICTURE = re.compile(r"^!\[[^]]*\]\(([\w-]+\.png)\)", re.MULTILINE)


@dataclass(frozen=True)
class Part:
    """A file, command or program of a page; what it shows lies at `span` of the page's text."""

    kind: str
    """file, command or program."""
    text: str
    name: str = ""
    shown: str = ""
    span: tuple[int, int] = (0, 0)


def parts(page: str) -> Iterator[Part]:
    """Yield what is to be done of a page, in order."""
    program = None
    for block in _BLOCK.finditer(page):
        language, text = block.groups()
        name = _FILE.search(page, 0, block.start())
        if program is not None and not language:
            yield Part("program", program, "", text, block.span(2))
        elif program is not None:
            yield Part("program", program)
        program = None
        if name:
            yield Part("file", text, name[1])
        elif language == "python":
            program = text
        elif language == "console":
            for command in re.finditer(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
                start, end = command.span(2)
                offset = block.start(2)
                yield Part("command", command[1], "", command[2], (offset + start, offset + end))
    if program is not None:
        yield Part("program", program)


def printed(part: Part, folder: Path) -> str:
    """Return what a command or program prints in a folder, without blanks at ends of lines.

    Raises:
        RuntimeError: It failed, or wrote to standard error.
    """
    call = (
        ["bash", "-c", part.text] if part.kind == "command" else [sys.executable, "-c", part.text]
    )
    done = subprocess.run(
        call, cwd=folder, env={**os.environ, **_ENVIRONMENT}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode or (part.kind == "program" and done.stderr):
        raise RuntimeError(f"{part.text}\nended with {done.returncode}:\n{done.stderr}")
    return "".join(line.rstrip() + "\n" for line in done.stdout.splitlines())


def cells(programs: Sequence[str], folder: Path) -> list[str]:
    """Return what each cell of a notebook prints, in a kernel that runs in a folder."""
    notebook = new_notebook(cells=[new_code_cell(program) for program in programs])
    NotebookClient(notebook, resources={"metadata": {"path": str(folder)}}).execute()
    return ["".join(out.get("text", "") for out in cell.outputs) for cell in notebook.cells]


def tried(page: Path, folder: Path) -> Iterator[tuple[Part, str]]:
    """Do all of a page in a folder that has `scenarios`; yield what shows something, and it."""
    (folder / "scenarios").symlink_to(ROOT / "scenarios")
    text = page.read_text("utf-8")
    if NOTEBOOK in text:
        programs = list(parts(text))
        yield from zip(programs, cells([part.text for part in programs], folder), strict=True)
        return
    for part in parts(text):
        if part.kind == "file":
            (folder / part.name).write_text(part.text, "utf-8")
        else:
            yield part, printed(part, folder)


def pictures(page: Path) -> list[str]:
    """Return the names of the pictures of a page that lie beside it."""
    return _PICTURE.findall(page.read_text("utf-8"))


def main() -> None:
    """Write what pages show anew."""
    for page in map(Path, sys.argv[1:]):
        text = page.read_text("utf-8")
        with tempfile.TemporaryDirectory() as folder:
            done = list(tried(page, Path(folder)))
            for name in pictures(page):
                if (Path(folder) / name).exists():
                    shutil.copy(Path(folder) / name, page.parent / name)
        for part, new in reversed(done):
            if part.span != (0, 0):
                start, end = part.span
                text = text[:start] + new + text[end:]
        page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
