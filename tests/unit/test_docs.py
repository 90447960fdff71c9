"""Every file, module, command, option, config key and message that the docs name exists."""

import importlib
import re
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
import typer

import signals.errors
from hil.apps.bench_suite.cases import benchmarks
from hil.cli.app import app
from hil.config.schema import BenchConfig
from signals.channels import CHANNELS
from tests.worlds.docs_blocks import PAGES, ROOT, blocks

FILE = r"(?<![\w/.-])(?!\S*NAME|hil/\w+-v\d)(?:hil|lab|sim|signals|firmware_bridge|rigs|tests|docs|tools)/[\w./-]*\w"
PACKAGE = r"(?:hil|sim|signals|firmware_bridge|hil_companion)"
NAME = rf"(?<![\w/.-]){PACKAGE}\.(?!yaml|conf|service)[\w.]*\w(?![\w/])"
NO_KEY = r"\w+\.(?:log|jsonl|png|clients\.NAME|clients\.explore|link|realtime)\b"  # files, and parts of run.json
SECTION = "|".join(BenchConfig.model_fields)
KEY = rf"(?m)(?:--set '?|^(?!{NO_KEY})(?=autopilot\.|companion\.|record\.))((?:{SECTION})\b[\w.*]*)(?:=|$)"
sys.path.append(str(ROOT / "rigs/jetson"))


def code_of(page: Path) -> str:
    """Code spans and code blocks of a page; continued lines are one."""
    blocks = re.split(r"```\w*\n", page.read_text().replace("\\\n", " "))
    return "\n".join([*re.findall(r"`([^`\n]+)`", "\n".join(blocks[::2])), *blocks[1::2]])


def is_name(dotted: str) -> bool:
    """Return True if a dotted name is a module, or an attribute of one."""
    module, dot, attribute = dotted.rpartition(".")
    with suppress(ImportError):
        return bool(importlib.import_module(dotted))
    return dot == "." and is_name(module) and hasattr(sys.modules.get(module), attribute)


def is_key(model: Any, path: list[str]) -> bool:
    """Return True if `path` leads to a key of a settings model; mappings of free names hold any key."""
    if not path or path[0] == "*" or str(model).startswith("dict["):
        return True
    fields = getattr(model, "model_fields", {})
    parts = [fields[path[0]].annotation] if path[0] in fields else []
    return any(is_key(part, path[1:]) for part in parts) or any(is_key(part, path) for part in get_args(model))


@cache
def commands() -> Any:
    return typer.main.get_command(app)


def unknown_in_command(line: str) -> list[str]:
    """Return the options of a command line of `hil` that do not exist. AttributeError for an unknown command."""
    command, words = commands(), line.partition("#")[0].split()
    while words and hasattr(command, "commands"):
        default = "run" if command.name == "campaign" else ""  # `hil campaign FILE`
        command = command.commands.get(words.pop(0)) or command.commands.get(default)
    options = {option for parameter in command.params for option in parameter.opts} | {"--help"}
    return [f"hil {line}: {word}" for word in words if word.startswith("--") and word not in options]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_in_a_page_exist(page: Path) -> None:
    code = code_of(page)
    imports = re.findall(rf"from ({PACKAGE}[\w.]*) import ([\w, ]+)", code)
    names = re.findall(NAME, code) + [f"{module}.{name}" for module, found in imports for name in found.split(", ")]
    wrong = [name for name in names if not is_name(name)]
    wrong += [
        p for p in re.findall(FILE, code) if not (ROOT / p).exists() and not re.search(rf"(#|//) {p}\n", code)
    ]  # not shown here
    wrong += [key for key in re.findall(KEY, code) if not is_key(BenchConfig, key.split("."))]
    wrong += [option for line in re.findall(r"(?m)(?:^|/)hil ([a-z].*)$", code) for option in unknown_in_command(line)]
    assert not wrong


def test_quoted_messages_exist_and_every_error_is_explained() -> None:
    page = (ROOT / "docs/troubleshooting.md").read_text()
    code = re.sub(
        r"""(["'])\s*\n\s*f?["']""",
        "",
        "\n".join(f.read_text() for f in [*ROOT.glob("[fhrst][io]*/**/*.py"), *ROOT.glob("lab/**/*.py")]),
    )
    cells = "\n".join(re.findall(r"(?m)^\| (.*?) \| .* \| ", page))  # what one sees
    quotes = [q for q in re.findall(r"`([^`\n]+)`", page) if "…" in q or (" " in q and f"`{q}`" in cells)]
    assert not [p for q in quotes for p in map(str.strip, q.split("…")) if len(p) > 5 and p.strip(",;:() ") not in code]
    errors = {e for e in vars(signals.errors) if e.endswith(("Error", "Found", "Busy", "Closed", "Lost"))}
    assert errors - set(re.findall(r"`(\w+)`", page)) == {"HilError"}  # the base


@pytest.mark.parametrize("page", ["command-line", "accuracy"])
def test_every_benchmark_is_listed(page: str) -> None:
    text = (ROOT / f"docs/{page}.md").read_text()
    listed = text.split("`hil bench NAME`")[1].splitlines()[0] if page == "command-line" else text
    assert [name for name in benchmarks() if f"`{name}`" not in listed] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_in_a_page_compiles(page: Path) -> None:
    for block in blocks(page, "python"):
        compile(block.text, block.place, "exec")


def test_every_channel_of_a_camera_is_explained() -> None:
    table = (ROOT / "docs/cameras.md").read_text()
    named = {word for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE) for word in re.findall(r"`(\w+)`", row)}
    assert set(CHANNELS) <= named
