"""A browser without a window, and a server for it."""

import shutil
import signal
import subprocess
import sys

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")


@pytest.fixture(scope="module")
def browser():
    pytest.importorskip("selenium", reason="drives the browser")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    if not CHROMIUM or not DRIVER:
        pytest.skip("apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"):
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    made = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield made
    made.quit()


@pytest.fixture
def serve(tmp_path):
    """Start a server for a model, and return the address that it prints."""
    running = []

    def start(content):
        (tmp_path / "model.xml").write_bytes(content)
        command = [sys.executable, "-m", "halpipe", "serve", "model.xml"]
        server = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        running.append(server)
        return server.stdout.readline().strip()

    yield start
    for server in running:
        server.send_signal(signal.SIGINT)
        assert server.wait(300) in (0, 130)
        server.stdout.close()
