"""Chromium for the tests of pages, driven by Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.worlds.patience import PATIENCE_S

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine (Debian: apt install chromium)"
)

_FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-watchdog",  # it ends a renderer that has no processor for some seconds
]


@contextmanager
def chromium() -> Iterator[Any]:
    """Run a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, headless=True, args=_FLAGS, timeout=1000.0 * PATIENCE_S
        )
        yield browser
        browser.close()


def patient(context: Any) -> Any:
    """Give a context, and all of its pages, PATIENCE_S for whatever is waited for; return it."""
    context.set_default_timeout(1000.0 * PATIENCE_S)
    return context


def open_dashboard(page: Any, address: str) -> None:
    """Open the dashboard and wait until it can be used."""
    page.goto(address)
    page.wait_for_selector("html[data-ready=yes]", state="attached")
