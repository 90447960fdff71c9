"""Settings of the CUT `detect`. The bench reads them, too: which objects a flight may be judged by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

from hil_companion.cuts.settings import is_list, number
from hil_companion.errors import OptionError

LOCALISERS = ("own", "truth", "none")
TRUTH = "truth"
_MAX_PIECES = 8  # along each side


@dataclass(frozen=True)
class DetectSettings:
    """Settings of `detect`. Raises OptionError."""

    camera: str = "front/rgb"  # topic of the pictures
    depth: str | None = None  # topic of depth pictures; None: ranges come from level ground
    radar: str | None = None  # topic of radar points; None: no speeds
    model: str | None = None  # .onnx file; None: the shipped one
    backend: str = "opencv"
    threads: int | None = None
    threshold: float | None = None  # lowest score of a reported box; None: the model's own
    tiles: Sequence[int] = (1, 1)  # pieces across and down into which a picture is cut for detection
    localiser: str = "own"
    start: Sequence[float] = (0.0, 0.0, 0.23, 0.0)  # x, y, z [m] and yaw [rad] before take-off
    ground_z_m: float = 0.0  # height of the ground where there is no depth
    objects: Sequence[str] | None = ("person",)  # labels tracked through the world; None: all
    out: str | None = None  # folder for pictures and the journal; None: the folder that the bench assigns
    picture_every_s: float = 1.0

    def __post_init__(self) -> None:
        if self.localiser not in LOCALISERS:
            raise OptionError(f"detect: localiser {self.localiser!r}: one of {', '.join(LOCALISERS)} is needed")
        if not is_list(self.tiles, int, 2) or not all(1 <= n <= _MAX_PIECES for n in self.tiles):
            raise OptionError(f"detect: tiles {self.tiles!r}: two whole numbers from 1 to {_MAX_PIECES} are needed")
        if self.objects is not None and not is_list(self.objects, str):
            raise OptionError(f"detect: objects {self.objects!r}: a list of labels is needed")
        if not is_list(self.start, (int, float), 4):
            raise OptionError(f"detect: start {self.start!r}: x, y, z and yaw are needed")
        for name, topic in (("camera", self.camera), ("depth", self.depth), ("radar", self.radar)):
            if topic is not None and (not isinstance(topic, str) or "/" not in topic):
                raise OptionError(f"detect: {name} {topic!r}: a topic such as front/rgb is needed")
        for name in ("ground_z_m", "picture_every_s"):
            number("detect", name, getattr(self, name))
        if self.threshold is not None:
            number("detect", "threshold", self.threshold)
