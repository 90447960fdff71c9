"""The fenced blocks of the book's pages: their language, and the commands of a console."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob("docs/*.md")), *ROOT.glob("*.md"), *sorted(ROOT.glob("rigs/jetson/**/*.md"))]
_BLOCK = re.compile(r"(?ms)^```([^\n`]*)\n(.*?)^```")
_ASSIGNMENT = re.compile(r"[A-Z_0-9]+=\S*")


@dataclass(frozen=True)
class Block:
    """One fenced block: `line` is where its text begins in the page, counted from 1."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def lines(self) -> list[str]:
        """Return the commands of a console."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [part for line in lines for part in line.split(" && ") if shlex.split(part, comments=True)]

    def commands(self) -> list[list[str]]:
        """Return the words of each of `lines`, without comments and assignments to variables."""
        words = [shlex.split(line, comments=True) for line in self.lines()]
        return [found[next(i for i, w in enumerate(found) if not _ASSIGNMENT.fullmatch(w)) :] for found in words]


def blocks(page: Path, *languages: str) -> list[Block]:
    """Return the blocks of a page in these languages; of every language if none is named."""
    text = page.read_text()
    found = [Block(page, text.count("\n", 0, match.start()) + 2, match[1], match[2]) for match in _BLOCK.finditer(text)]
    return [block for block in found if not languages or block.language in languages]
