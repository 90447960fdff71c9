"""Fakes for the link tests, as fixtures: a test directory is not a package."""

import importlib.util
import sys
from pathlib import Path

import pytest

FAKE_PATH = Path(__file__).with_name("fake_autopilot.py")


@pytest.fixture(scope="session")
def fake():
    """The module `fake_autopilot`."""
    spec = importlib.util.spec_from_file_location("fake_autopilot", FAKE_PATH)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
