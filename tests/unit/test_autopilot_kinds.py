"""Facts about autopilots are in their profiles: nothing else compares a kind's name or the class of a link."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_bridge.autopilots.catalog import PROFILES

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("signals", "sim", "firmware_bridge", "hil", "rigs")
AUTOPILOTS = ROOT / "firmware_bridge" / "autopilots"
FAMILIES = {folder.name for folder in AUTOPILOTS.iterdir() if folder.is_dir() and any(folder.glob("*.py"))}
NAMES = FAMILIES | set(PROFILES)
# The folders of the kinds; and a benchmark that flies two named rigs, whose results have their names.
OWN = (*(ROOT / f"firmware_bridge/{room}/{f}" for room in ("autopilots", "links") for f in FAMILIES),)
OWN += (ROOT / "hil/apps/bench_suite/link/link.py",)


def compared(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions with which a node compares something, or by which it chooses: collections are for that."""
    match node:
        case ast.Compare(left, _, right):
            yield from (left, *right)
        case ast.Call(ast.Attribute(_, "startswith" | "endswith" | "removeprefix" | "get"), arguments):
            yield from arguments
        case ast.MatchValue(value):
            yield value
        case ast.Dict(keys):
            yield from (key for key in keys if key is not None)
        case ast.Tuple(items) | ast.List(items) | ast.Set(items):
            yield from items
        case ast.Subscript(_, key):
            yield key


def offences(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of each comparison with a kind's or family's name, and of each test of a link's class."""
    for node in ast.walk(tree):
        for expression in compared(node):
            match expression:
                case ast.Constant(str(text)) if text.rstrip("_") in NAMES:
                    yield expression.lineno, text
        match node:
            case ast.Call(ast.Name("isinstance" | "issubclass"), [_, classes]):
                for name in ast.walk(classes):
                    if isinstance(name, ast.Name | ast.Attribute) and ast.unparse(name).endswith("Link"):
                        yield node.lineno, ast.unparse(node)


def may_offend(text: str) -> bool:
    """Return False for a source that holds no name of a kind and asks for no class of a link: parsing takes longer."""
    return any(name in text for name in NAMES) or ("Link" in text and ("isinstance(" in text or "issubclass(" in text))


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_asks_for_an_autopilot_by_name(package: str) -> None:
    found = []
    for path in sorted((ROOT / package).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if may_offend(source) and not any(own in (path, *path.parents) for own in OWN):
            found += [f"{path.relative_to(ROOT)}:{line}: {text}" for line, text in offences(ast.parse(source))]
    assert not found, "ask the profile (firmware_bridge/autopilots/profile.py) instead:\n" + "\n".join(found)


@pytest.mark.parametrize(
    "source",
    [
        "kind == 'mock'",
        "kind not in ('px4_sitl', 'mock_hitl')",
        "kind in frozenset({'px4_hitl'})",
        "kind.startswith('ardupilot_')",
        "{'px4_sitl': 1}[kind]",
        "limits['px4_hitl']",
        "rig, key = ('px4_hitl', 'port')",
        "match kind:\n    case 'mock':\n        pass",
        "isinstance(link, RealtimeLink)",
        "isinstance(link, (int, links.LockstepLink))",
    ],
)
def test_such_questions_are_found(source: str) -> None:
    assert may_offend(source)
    assert list(offences(ast.parse(source)))


def test_other_texts_are_not() -> None:
    assert not list(offences(ast.parse("kind == 'camera'\nrig = 'mock'\nisinstance(fault, LinkFault)\nf('px4')")))
