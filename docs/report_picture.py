"""Take a picture of a report: `python -m docs.report_picture PAGE.html PICTURE.png SCHEME [ID]`.

It is the top of the page as a desk shows it, `light` or `dark`, or the part with an id. It needs
selenium and Chromium.
"""

import sys
from pathlib import Path

from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from docs.chromium import headless

WIDTH, HEIGHT = 1280, 1500
PATIENCE = 120.0
"""s"""


def take(page: Path, picture: Path, scheme: str, part: str = "") -> None:
    """Write a picture of a page in a colour scheme."""
    with headless() as browser:
        feature = {"name": "prefers-color-scheme", "value": scheme}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
        size = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.get(page.resolve().as_uri())
        ready = "return document.documentElement.dataset.ready === 'yes'"
        WebDriverWait(browser, PATIENCE).until(lambda _: browser.execute_script(ready))
        png: bytes = (
            browser.find_element(By.ID, part).screenshot_as_png
            if part
            else browser.get_screenshot_as_png()
        )
    picture.write_bytes(png)


if __name__ == "__main__":
    take(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
