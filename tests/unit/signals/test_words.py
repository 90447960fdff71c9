"""Numbers of things in sentences."""

from __future__ import annotations

import pytest

from signals.words import counted


@pytest.mark.parametrize(("number", "text"), [(0, "0 cases"), (1, "1 case"), (2, "2 cases"), (12_000, "12,000 cases")])
def test_one_thing_is_singular(number: int, text: str) -> None:
    assert counted(number, "case") == text
