"""Names of files and folders in a data set: `hil dataset` writes them, training reads them.

The folders with capitals are those of Pascal VOC 2012.
"""

from __future__ import annotations

from pathlib import Path
from pkgutil import iter_modules

MANIFEST = "dataset.json"
ANNOTATIONS = "Annotations"
IMAGES = "JPEGImages"
IMAGE_SETS = "ImageSets/Main"
CLASS_MASKS = "SegmentationClass"  # indexed PNG
DIFFICULT_BELOW_PX = 64  # visible pixels of an object; VOC's `difficult` marks those that a detector need not find

_FORMS = Path(__file__).resolve().parent / "apps" / "dataset" / "label_forms"  # each file is a form of 3-D labels
LABEL_FORMATS = ("boxes", *sorted(module.name for module in iter_modules([str(_FORMS)])))  # of `dataset.formats`
