"""Reader of 3-D labels: the tight boxes of the objects that a picture or a sweep shows.

An object belongs to a picture if at least one pixel shows it, to a sweep if at least one point lies on it. Its box is
that at the time of the capture. What a box is: sim/frame/object_box.py; occlusion and truncation:
sim/frame/lone_objects.py. Nothing of this is made for a data set without 3-D labels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.boxes import SeenObject, SweptObject
from hil.apps.dataset.formats.labels import Catalogue, PictureLabels
from signals.rotation import matrix_of
from signals.samples import PointCloudSample, TruthState
from sim.frame.geometry import FrameGeometry
from sim.frame.lone_objects import LoneGeometry, LoneObjects
from sim.frame.object_box import UP_W, BoxedPoints, ObjectBox, tight_boxes
from sim.frame.object_shapes import ObjectShapes
from sim.sensors.camera import Camera


class ObjectReader:
    """Boxes of objects in the pictures of one camera, if there is one, and in sweeps."""

    def __init__(
        self, geometry: FrameGeometry, catalogue: Catalogue, camera: Camera | None, *, across: bool = False
    ) -> None:
        """`across`: also make boxes that are upright in the camera."""
        self._shapes = ObjectShapes(geometry.world)
        self._catalogue, self._camera, self._across = catalogue, camera, across
        self._still: dict[int, ObjectBox | None] = {}  # upright boxes of what does not move
        self._lone = None
        if camera is not None:
            self._lone = LoneObjects(LoneGeometry(geometry), camera.model, camera.planes_m)

    def of_picture(self, truth: TruthState, labels: PictureLabels) -> tuple[SeenObject, ...]:
        """Return the objects of the camera's picture at `truth`, in the order of its labels."""
        camera, lone = self._camera, self._lone
        if camera is None or lone is None:
            raise ValueError("boxes: there is no labelled camera whose pictures could be read")
        pose = camera.mount.pose(truth)
        boxes = self.boxes([label.instance for label in labels.objects], truth.t_ns)
        shown = [label for label in labels.objects if boxes[label.instance] is not None]
        posed = [self._shapes.posed(label.instance, truth.t_ns) for label in shown]
        upright = [box for label in shown if (box := boxes[label.instance]) is not None]
        measured = lone.measure(
            posed,
            upright,
            pose,
            lambda renderer, out, rows: camera.draw_by(renderer, truth, out, rows),
            one_pose=camera.one_pose,
        )
        across: Sequence[ObjectBox | None] = [None] * len(shown)
        if self._across:
            across = tight_boxes(self._shapes, posed, -np.array(pose.R_WC).reshape(3, 3)[:, 1])  # up: against y of C
        return tuple(
            SeenObject(label, box, other, alone_px, truncation)
            for label, box, other, (alone_px, truncation) in zip(shown, upright, across, measured, strict=True)
        )

    def of_sweep(self, truth: TruthState, points: BoxedPoints, instance: NDArray[np.uint16]) -> tuple[SweptObject, ...]:
        """Return the objects of a sweep, by rising instance.

        `points`: of the sweep, with the motion of the vehicle taken out; `instance`: of each point of the sweep.
        """
        returns = np.bincount(instance)
        of = self._catalogue.class_of_instance
        numbers = [n for n in np.flatnonzero(returns).tolist() if of.get(n) in self._catalogue.object_classes]
        boxes = self.boxes(numbers, truth.t_ns)
        return tuple(
            SweptObject(n, of[n], box, int(returns[n]), points.count(box))
            for n in numbers
            if (box := boxes[n]) is not None
        )

    def boxes(self, instances: Sequence[int], t_ns: int) -> dict[int, ObjectBox | None]:
        """Return the upright box of each instance; None for one that has no finite extent."""
        new = [n for n in instances if n not in self._still]
        found = tight_boxes(self._shapes, [self._shapes.posed(n, t_ns) for n in new], UP_W)
        made = dict(zip(new, found, strict=True))
        boxes = {n: made[n] if n in made else self._still[n] for n in instances}
        self._still |= {n: box for n, box in made.items() if not self._shapes.moves(n)}
        return boxes

    @staticmethod
    def boxed(sample: PointCloudSample) -> BoxedPoints:
        """Return the points of a sweep for `of_sweep`; the motion of the vehicle must be taken out."""
        R_WL = np.array(matrix_of(sample.q_WL)).reshape(3, 3)
        return BoxedPoints(sample.points_L.astype(np.float64) @ R_WL.T + np.array(sample.p_WL))
