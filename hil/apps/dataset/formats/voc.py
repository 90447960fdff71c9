"""Pascal VOC 2012 annotations: Annotations/NAME.xml, JPEGImages/NAME.png, ImageSets/Main/*.txt and mask folders.

As in VOC, boxes count pixels from 1 and include the last pixel: xmin = x + 1 of the leftmost visible pixel. `pose` is
Unspecified. `difficult` marks objects that a detector need not find: fewer than `DIFFICULT_BELOW_PX` visible pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape

from hil.apps.dataset.formats.labels import PictureLabels
from hil.apps.dataset.formats.split import Split
from hil.data_set_files import DIFFICULT_BELOW_PX, IMAGES
from signals.classes import Classes
from signals.errors import RecordingError

_VOC_SETS = {"train": "train", "validation": "val", "test": "test"}


def annotation_xml(file_name: str, labels: PictureLabels, classes: Classes) -> bytes:
    """Return the XML of one picture. Raises RecordingError if `file_name` contains folders."""
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
    """Return the files in `IMAGE_SETS`: names of pictures without suffix, one per line. trainval is train and val.

    Raises RecordingError if `names` and `split` differ in length.
    """
    if len(names) != len(split.set_by_frame):
        raise RecordingError(f"VOC: {len(names)} pictures, but the split is of {len(split.set_by_frame)} frames")
    files = {voc_name: [names[i] for i in split.frames(set_name)] for set_name, voc_name in _VOC_SETS.items()}
    both = ("train", "validation")
    files["trainval"] = [name for name, set_name in zip(names, split.set_by_frame, strict=True) if set_name in both]
    return {f"{file}.txt": "".join(f"{name}\n" for name in pictures) for file, pictures in sorted(files.items())}
