"""Every block of the docs: consoles have commands that the real parser takes, YAML passes the real checks."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from firmware_bridge.companion.keys import make_keys
from hil.apps.campaign.command import check_campaign
from hil.apps.fly.check import check_bench
from hil.apps.fly.choice import BenchChoice
from sim.scene.scene import Scene
from tests.worlds.docs_blocks import PAGES, ROOT, Block, blocks
from tests.worlds.docs_commands import NOT_RUN, check_command, make_folder, why_not_run

LANGUAGES = {"sh", "yaml", "python", "cpp", "json", "text"}  # text: output, drawings, lines for other programs' files
# Blocks of YAML that are another program's, or that another test runs, and why: by page and first key.
ELSEWHERE = {
    "ci.md: name": "a workflow of GitHub",
    "identify.md: time": "tests/unit/hil/apps/identify reads its map of columns",
    "planes.md": "tests/unit/hil/config/test_config_wings.py flies and breaks its vehicles",
    "CONTRIBUTING.md": "tests/e2e/test_contributing.py runs its examples",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The reader's folder, which is the working directory."""
    make_folder(tmp_path)
    make_keys(tmp_path / "bench-keys", ["jetson"])
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_names_its_language(page: Path) -> None:
    assert [block.place for block in blocks(page) if block.language not in LANGUAGES] == []


CONSOLES = [page for page in PAGES if blocks(page, "sh")]


@pytest.mark.parametrize("page", CONSOLES, ids=lambda page: page.name)
def test_commands_of_a_page_parse_and_name_benches_that_pass_the_check(page: Path, folder: Path) -> None:
    for block in blocks(page, "sh"):
        for words in block.commands():
            if words[0] != "hil" or why_not_run(words).startswith("runs in"):
                continue
            try:
                check_command(words)
            except Exception as error:  # noqa: BLE001 - usage errors have no common public base
                pytest.fail(f"{block.place}: {' '.join(words)}: {type(error).__name__}: {error}")


def test_commands_are_of_hil_or_have_a_reason_not_to_run() -> None:
    commands = [words for page in CONSOLES for block in blocks(page, "sh") for words in block.commands()]
    reasons = {why_not_run(words) for words in commands}
    assert reasons - {""} == set(NOT_RUN.values())
    others = {words[0] for words in commands if not why_not_run(words)}
    assert others <= {"hil", "python", "echo"}


EXAMPLES = [block for page in PAGES for block in blocks(page, "yaml")]


def check(block: Block, folder: Path) -> None:
    keys = yaml.safe_load(block.text)
    file = folder / "example.yaml"
    file.write_text(block.text)
    if {"plan", "actions"} & set(keys):
        file = file.rename(folder / "missions" / "example.yaml")
        check_bench(BenchChoice(mission=str(file), settings=("duration_s=120",)))
    elif "axes" in keys:
        check_campaign(file)
    elif set(keys) <= set(Scene.model_fields):
        scene = yaml.safe_load((ROOT / "rigs/scenes/airfield.yaml").read_text()) | keys  # a page may print a part
        file.write_text(yaml.safe_dump(scene))
        check_bench(BenchChoice(scene=str(file)))
    else:
        check_bench(BenchChoice(file))


@pytest.mark.parametrize("block", EXAMPLES, ids=lambda block: block.place)
def test_an_example_in_yaml_passes_the_check(block: Block, folder: Path) -> None:
    first = f"{block.page.name}: {next(iter(yaml.safe_load(block.text)))}"
    if any(first.startswith(place) for place in ELSEWHERE):
        return
    check(block, folder)


def test_what_is_checked_elsewhere_exists() -> None:
    places = {f"{block.page.name}: {next(iter(yaml.safe_load(block.text)))}" for block in EXAMPLES}
    assert [place for place in ELSEWHERE if not any(each.startswith(place) for each in places)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\((?!https?:|#)([^)#\s]+)(?:#[\w-]+)?\)", page.read_text())
    assert [link for link in links if not (page.parent / link).exists()] == []
