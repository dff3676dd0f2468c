"""Recordings to report on, and a browser to look at reports with."""

import shutil

import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import PAPER, PAPER_FILE, SCENARIOS, example


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="session")
def paper(folder):
    """Return the recording of the paper's example, whole."""
    return run(read_scenario(PAPER_FILE), folder / "paper.mcap").path


@pytest.fixture(scope="session")
def lossy(folder):
    """Return a recording on a network with faults."""
    return run(read_scenario(SCENARIOS / "paper_lossy_links.toml"), folder / "lossy.mcap").path


@pytest.fixture(scope="session")
def recorded(folder):
    """Return a function that records the paper's example with other values."""

    def record(name, *changes):
        file = example(PAPER, *changes, name=name)
        return run(file, folder / f"{name.replace('/', '')}.mcap").path

    return record


@pytest.fixture(scope="session")
def empty(paper, folder):
    """Return a recording of which nothing but the head is there."""
    with Reader(paper) as reader:
        first = min(span.offset for span in reader._chunks)
    path = folder / "empty.mcap"
    path.write_bytes(paper.read_bytes()[:first])
    return path


def story(path):
    with Reader(path) as reader:
        return story_of(reader)


@pytest.fixture(scope="session")
def chromium():
    """Return a headless browser."""
    webdriver = pytest.importorskip("selenium.webdriver")
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not browser or not driver:
        pytest.skip("the system packages chromium and chromium-driver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--no-proxy-server",
        "--window-size=1280,900",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield opened
    opened.quit()
