"""Make the files of sim/scene/assets: all, or those whose paths contain one of the arguments.

python -m tools.art [TEXT ...]
"""

from __future__ import annotations

import sys

from sim.scene.maps.asset_files import ASSETS
from tools.art.catalog import FILES


def main(texts: list[str]) -> None:
    total = 0
    for name, make in FILES.items():
        if texts and not any(text in name for text in texts):
            continue
        data = make()
        total += len(data)
        path = ASSETS / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != data:
            path.write_bytes(data)
            sys.stdout.write(f"{name}: {len(data):,} bytes\n")
    sys.stdout.write(f"{total / 1e6:.1f} MB\n")


if __name__ == "__main__":
    main(sys.argv[1:])
