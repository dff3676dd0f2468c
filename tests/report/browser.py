"""Looking at a page through a browser, and asking it what it shows."""

from selenium.webdriver.support.ui import WebDriverWait


class Look:
    """A page in a headless browser."""

    def __init__(self, browser, address, width=1280, dark=False):
        self.browser = browser
        browser.get("about:blank")
        browser.get_log("browser")
        self.size(width)
        self.prefer(dark)
        browser.get(address)

    def size(self, width):
        result = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", result)

    def prefer(self, dark):
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def ask(self, script, *arguments):
        return self.browser.execute_script(f"return {script}", *arguments)

    def until(self, script, seconds=90):
        """Wait until an expression is true."""
        WebDriverWait(self.browser, seconds, 0.1).until(lambda _: self.ask(script))

    def ready(self):
        self.until("document.documentElement.dataset.ready === 'yes'")
        return self

    def complaints(self):
        return self.browser.get_log("browser")

    def drawn(self):
        """Return of each panel its label, how many points it has, and how many lines are seen."""
        return self.ask(
            "[...document.querySelectorAll('.panel')].map(box => ["
            "box.querySelector('h3').innerText,"
            " box.querySelector('.plot').data.reduce((n, trace) => n + trace.x.length, 0),"
            " [...box.querySelectorAll('.scatterlayer .trace')]"
            ".filter(line => line.getBoundingClientRect().width > 20).length])"
        )

    def picture(self, name="workspace"):
        return self.ask(f"document.querySelector('#{name} canvas').toDataURL()")

    def now(self):
        return float(self.ask("document.querySelector('#slider').value"))
