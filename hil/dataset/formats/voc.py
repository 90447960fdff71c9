"""Pascal VOC (2012): Annotations/NAME.xml, JPEGImages/NAME.jpg or .png, ImageSets/Main/*.txt and the masks' folders.

Boxes count pixels from 1 and include the last, as VOC's do: xmin = x + 1 of the leftmost visible pixel. `pose` is
Unspecified. `difficult` marks what a detector need not find: fewer than `DIFFICULT_BELOW_PX` visible pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape

from hil.dataset.formats.labels import PictureLabels
from hil.dataset.formats.split import Split
from hil.signals.classes import Classes
from hil.signals.errors import RecordingError

ANNOTATIONS = "Annotations"
IMAGES = "JPEGImages"
IMAGE_SETS = "ImageSets/Main"
CLASS_MASKS = "SegmentationClass"  # indexed PNG
DIFFICULT_BELOW_PX = 64
_OF_SPLIT = {"train": "train", "validation": "val", "test": "test"}  # VOC's names


def annotation_xml(file_name: str, labels: PictureLabels, classes: Classes) -> bytes:
    """The annotation of one picture. `file_name`: of the picture, without folders."""
    if not file_name or "/" in file_name:
        raise RecordingError(f"VOC: a picture's name has no folders: {file_name!r}")
    lines = [
        "<annotation>",
        f"\t<folder>{IMAGES}</folder>",
        f"\t<filename>{escape(file_name)}</filename>",
        "\t<source><database>hil dataset</database></source>",
        f"\t<size><width>{labels.width}</width><height>{labels.height}</height><depth>3</depth></size>",
        "\t<segmented>1</segmented>",
    ]
    names: dict[int, str] = {}
    for o in labels.objects:
        name = names.get(o.class_id) or names.setdefault(o.class_id, escape(classes.name(o.class_id)))
        lines.append(
            f"\t<object><name>{name}</name><pose>Unspecified</pose>"
            f"<truncated>{o.truncated:d}</truncated><occluded>{o.occluded:d}</occluded>"
            f"<difficult>{o.area_px < DIFFICULT_BELOW_PX:d}</difficult>"
            f"<bndbox><xmin>{o.x_min + 1}</xmin><ymin>{o.y_min + 1}</ymin>"
            f"<xmax>{o.x_max + 1}</xmax><ymax>{o.y_max + 1}</ymax></bndbox></object>"
        )
    lines += ["</annotation>", ""]
    return "\n".join(lines).encode()


def image_sets(names: Sequence[str], split: Split) -> Mapping[str, str]:
    """File in `IMAGE_SETS` to its text: names without ending, one a line. trainval holds train and val."""
    if len(names) != len(split.of_frame):
        raise RecordingError(f"VOC: {len(names)} pictures, but the split is of {len(split.of_frame)} frames")
    sets = {voc: [names[i] for i in split.frames(ours)] for ours, voc in _OF_SPLIT.items()}
    sets["trainval"] = [name for name, of in zip(names, split.of_frame, strict=True) if of in ("train", "validation")]
    return {f"{name}.txt": "".join(f"{stem}\n" for stem in stems) for name, stems in sorted(sets.items())}
