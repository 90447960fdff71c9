"""Hook of mkdocs: adds to the book the pages whose text stands elsewhere in the repository."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
# Page of the book, and the file that holds it.
PAGES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "model-card.md": "rigs/jetson/hil_companion/detect/MODEL_CARD.md",
}
_LINK = re.compile(r"(?<=\]\()(?!https?:|#)[^)#\s]+")


def on_files(files: Any, config: Any) -> Any:
    for page, source in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links to repository files into links to their pages."""
    folder = posixpath.dirname(PAGES.get(page.file.src_uri, "docs/" + page.file.src_uri))
    page_of = {source: name for name, source in PAGES.items()}

    def moved(link: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(folder, link[0]))
        return page_of.get(path, path.removeprefix("docs/"))

    return _LINK.sub(moved, markdown)
