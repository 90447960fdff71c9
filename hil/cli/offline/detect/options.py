"""The data sets argument of `hil detect train` and `evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DataSets = Annotated[list[Path], typer.Argument(help="Folders written by `hil dataset`.", metavar="DATASET...")]
