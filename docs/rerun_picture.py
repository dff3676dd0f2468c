"""Take a picture of a bag in Rerun: `python -m docs.rerun_picture BAG.mcap PICTURE.png`.

It needs rerun-sdk, selenium and Chromium. The viewer is served on this machine alone, and a browser
without a screen shows it, drawn by the processor: it is there when two pictures in a row are alike.
"""

import os
import signal
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path
from socket import create_server
from urllib.parse import quote

import numpy as np
from PIL import Image

from docs.chromium import headless

SIZE = (1600, 900)
PATIENCE, _BETWEEN = 400.0, 10.0
"""s: in all, and between two pictures."""
_FEW = 200
"""Colours of a page on which nothing is drawn yet."""
_ARGUMENTS = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    f"--window-size={SIZE[0]},{SIZE[1]}",
)


def take(bag: Path, picture: Path) -> None:
    """Write a picture of what Rerun shows of a bag when it is opened."""
    ports = [_free_port(), _free_port()]
    rerun = [str(Path(sys.executable).with_name("rerun")), "--serve-web", "--bind", "127.0.0.1"]
    rerun += ["--web-viewer-port", str(ports[0]), "--port", str(ports[1]), str(bag)]
    with subprocess.Popen(
        rerun, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as viewer:
        try:
            source = quote(f"rerun+http://127.0.0.1:{ports[1]}/proxy", safe="")
            picture.write_bytes(_settled(f"http://127.0.0.1:{ports[0]}/?url={source}"))
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)  # the command starts a process that serves


def _settled(address: str) -> bytes:
    """Return the picture of a page once it no longer changes.

    One that is still being drawn when patience is at its end is no picture of what it shows.
    """
    with headless(*_ARGUMENTS) as browser:
        browser.get(address)
        before, began = b"", time.monotonic()
        while time.monotonic() - began < PATIENCE:
            time.sleep(_BETWEEN)  # a page says nothing of when it is drawn
            shown = browser.get_screenshot_as_png()
            if shown == before and _colours(shown) > _FEW:
                return shown
            before = shown
    raise SystemExit(f"{address}: still changes after {PATIENCE:g} s; draw on a quieter machine")


def _colours(png: bytes) -> int:
    pixels = np.asarray(Image.open(BytesIO(png)).convert("RGB")).reshape(-1, 3)
    return len(np.unique(pixels, axis=0))


def _free_port() -> int:
    with create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


if __name__ == "__main__":
    take(Path(sys.argv[1]), Path(sys.argv[2]))
