"""Chromium without a screen, which takes the documents' pictures; it needs selenium."""

import shutil

from selenium import webdriver

_ARGUMENTS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-proxy-server")


def headless(*more: str) -> webdriver.Chrome:
    """Return a browser that has no screen, a context manager that ends it."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for argument in (*_ARGUMENTS, *more):
        options.add_argument(argument)
    return webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
