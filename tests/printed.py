"""What commands print, as it is kept in `snapshots`: prose is asserted there, and nowhere else.

What a machine or a moment decides is masked. After a change of the wording `make snapshots` writes
the files anew, and `git diff` shows every sentence that is another now; what a test is about, a
number or a status, it asserts on JSON.
"""

import re
from pathlib import Path

from tests.command import nrs

SNAPSHOTS = Path(__file__).with_name("snapshots")


def masked(text: str) -> str:
    """Mask what a machine decides: times, speeds, digests, rounding; and trailing blanks."""
    text = re.sub(r"in [\d.]+ s, [\d.e+]+ x real time", "in … s", text)
    text = re.sub(r"\d+ %", "… %", text)
    text = re.sub(r"(\d\.\d{5})\d{5,}", r"\1…", text)
    text = re.sub(r"\b\d(\.\d+)?e-(0[6-9]|[1-9]\d)\b", "<tiny>", text)
    text = re.sub(r"\b[0-9a-f]{64}\b", "<digest>", text)
    return re.sub(r"[ \t]+$", "", text, flags=re.MULTILINE)


def session(folder: Path, *lines: str) -> str:
    """Return the session of commands in a folder: each with what it printed and its status."""
    shown = []
    for line in lines:
        done = nrs(*line.split(), cwd=folder)
        status = f"(exits with {done.returncode})\n" if done.returncode else ""
        shown.append(f"$ nrs {line}\n{done.stdout}{done.stderr}{status}")
    text = "\n".join(shown).replace(f"{folder}/", "").replace(str(folder), "<folder>")
    return masked(text)
