"""The page's own files: readable in light and dark, and nothing from anywhere else."""

from __future__ import annotations

import re

import pytest

from hil.dashboard.app import PAGE_FOLDER

STYLE = (PAGE_FOLDER / "style.css").read_text()


def colours(block: str) -> dict[str, str]:
    return dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", block))


LIGHT, DARK = (colours(block) for block in re.findall(r"^:root[^{]*\{([^}]*)\}", STYLE, re.MULTILINE))


def luminance(colour: str) -> float:
    """WCAG 2's relative luminance."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(a: str, b: str) -> float:
    light, dark = sorted((luminance(a), luminance(b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_the_contrast_of_black_on_white() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize(
    ("ink", "ground", "least"),
    [
        ("ink", "card", 7.0),
        ("ink", "soft", 7.0),
        ("quiet", "card", 4.5),
        ("quiet", "ground", 4.5),
        ("main-ink", "main", 4.5),
        ("good", "card", 4.5),
        ("warn", "card", 4.5),
        ("bad", "card", 4.5),
        ("bad", "soft", 4.5),
        ("trail", "card", 3.0),
        ("plan", "card", 3.0),
        ("other", "card", 3.0),
    ],
)
def test_text_and_lines_stand_out(theme: dict[str, str], ink: str, ground: str, least: float) -> None:
    assert contrast(theme[ink], theme[ground]) >= least


def test_both_themes_have_every_colour() -> None:
    assert LIGHT.keys() == DARK.keys()
    used = set(re.findall(r"var\(--([a-z-]+)\)", STYLE))
    used |= {n for f in PAGE_FOLDER.glob("*.js") for n in re.findall(r"\"--([a-z-]+)\"", f.read_text())}
    assert used <= LIGHT.keys()


def test_the_page_names_no_other_place() -> None:
    for file in PAGE_FOLDER.iterdir():
        text = file.read_text()
        assert not re.findall(r"(?:https?:)?//[a-z0-9-]+\.[a-z]{2,}", text), file.name
        assert not re.findall(r"@import|url\(", text), file.name
        for module in re.findall(r"from \"([^\"]+)\"", text):
            assert (PAGE_FOLDER / module.removeprefix("/page/")).is_file(), (file.name, module)
