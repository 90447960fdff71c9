"""COCO object detection: one JSON file of images, annotations and categories.

Masks are uncompressed run lengths, column by column, with `iscrowd` 0. Image ids count from 1 in the order of the
frames; an annotation's id is 65536 * image + instance, so workers need no common counter.

A file is joined from one piece per picture, made by the workers, in the order of the frames.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from hil.apps.dataset.formats.labels import Catalogue, PictureLabels
from signals.errors import RecordingError

_IDS_PER_IMAGE = 65536
_COMPACT = (",", ":")


class CocoPicture(NamedTuple):
    """Entries of one picture as JSON text: its image, and its annotations."""

    image_id: int
    image: str
    annotations: tuple[str, ...]


def coco_picture(frame: int, file_name: str, labels: PictureLabels, masks: Sequence[str], *, t_ns: int) -> CocoPicture:
    """Return the COCO entries of frame number `frame` (from 0).

    `masks` are the run lengths of `labels.objects` from `mask_texts`. Raises RecordingError if they do not match, or if
    an instance occurs twice.
    """
    if len(masks) != len(labels.objects):
        raise RecordingError(f"COCO: frame {frame} has {len(labels.objects)} objects, but {len(masks)} masks")
    image_id = frame + 1
    image = {
        "id": image_id,
        "file_name": file_name,
        "width": labels.width,
        "height": labels.height,
        "timestamp_ns": t_ns,
    }
    size = f"[{labels.height},{labels.width}]"
    annotations = []
    seen: set[int] = set()
    for o, counts in zip(labels.objects, masks, strict=True):
        if o.instance in seen:
            raise RecordingError(f"COCO: frame {frame} has two objects of instance {o.instance}")
        seen.add(o.instance)
        # Formatted by hand, because json.dumps takes four times as long and all values are numbers.
        annotations.append(
            f'{{"id":{_IDS_PER_IMAGE * image_id + o.instance},"image_id":{image_id},"category_id":{o.class_id},'
            f'"bbox":[{o.x_min},{o.y_min},{o.x_max - o.x_min + 1},{o.y_max - o.y_min + 1}],"area":{o.area_px},'
            f'"segmentation":{{"counts":[{counts}],"size":{size}}},"iscrowd":0,'
            f'"instance_id":{o.instance},"truncated":{o.truncated:d},"occluded":{o.occluded:d},'
            f'"hidden_rim":{o.hidden:.4f}}}'
        )
    return CocoPicture(image_id, json.dumps(image, separators=_COMPACT), tuple(annotations))


def coco_parts(
    pictures: Iterable[CocoPicture], catalogue: Catalogue, *, description: str, licence: str
) -> Iterator[str]:
    """Yield a COCO file piece by piece. Images follow the annotations: they are few bytes, and wait in memory.

    Raises RecordingError if a picture is not in the order of the frames, or occurs twice.
    """
    names = catalogue.classes.names
    categories = [
        {"id": i, "name": names[i], "supercategory": "object"}
        for i in sorted(catalogue.object_classes)
        if i < len(names)
    ]
    info = {"description": description, "version": "1.0"}
    licences = [{"id": 1, "name": licence, "url": ""}]
    yield f'{{"info":{json.dumps(info)},\n"licenses":{json.dumps(licences)},\n"categories":{json.dumps(categories)},\n'
    yield '"annotations":[\n'
    images: list[str] = []
    previous_id, first = 0, True
    for picture in pictures:
        if picture.image_id <= previous_id:
            raise RecordingError("COCO: pictures must come in the order of their frames, each once")
        previous_id = picture.image_id
        images.append(picture.image)
        if picture.annotations:
            text = ",\n".join(picture.annotations)
            yield text if first else f",\n{text}"
            first = False
    yield '\n],\n"images":[\n'
    yield ",\n".join(images)
    yield "\n]}\n"
