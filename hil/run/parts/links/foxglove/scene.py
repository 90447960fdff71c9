"""Contents of Foxglove's 3-D and map panels, beside the recording's topics.

/scene           foxglove.SceneUpdate: triangles of the scene, people and vehicles in it, the drones, the planned paths
/scene/frames    foxglove.FrameTransforms: places of the scene's people and vehicles
/scene/boxes     foxglove.SceneUpdate: boxes of the scene's people and vehicles (boxes.py)
/map/plan        foxglove.GeoJSON: the planned paths
/map/position    foxglove.LocationFix: true position; of one vehicle among several under its name

The scene is made when the first client subscribes to it, and sent once to each.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.run.live.messages import Names
from hil.run.parts.links.foxglove.boxes import BOXES, BoxView
from hil.run.parts.links.foxglove.glb import glb
from hil.run.parts.links.foxglove.server import LiveServer
from hil.run.recorder.mcap.topics import BODY, WORLD
from signals.geodesy import LocalFrame
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.frame.scene_mesh import Actors, SceneMesh, scene_mesh
from sim.scene.scene import Scene

SCENE, FRAMES, PLAN, POSITION = "/scene", "/scene/frames", "/map/plan", "/map/position"
_ROTOR_HEIGHT_M = 0.01
_BODY_M = (0.16, 0.10, 0.06)
_COLOURS = ((1.0, 0.75, 0.0), (0.2, 0.7, 1.0), (0.4, 0.9, 0.4), (1.0, 0.4, 0.6), (0.8, 0.6, 1.0))


class Drone(NamedTuple):
    """One vehicle as the panels show it."""

    name: str  # empty in a run of one
    rotors_m: Sequence[tuple[Vec3, float]]  # centre in the vehicle's frame, radius
    path_W: Sequence[Vec3]  # corners of the planned path

    def topic(self, path: str) -> str:
        return Names(self.name).topic(path)

    @property
    def frame_id(self) -> str:
        return Names(self.name).frame(BODY)


class SceneView:
    """Scene, drones and plan of one run."""

    def __init__(self, server: LiveServer, scene: Scene, world: Any, drones: Sequence[Drone]) -> None:
        """`world`: sim.scene.world.World without the drones."""
        self._server, self._world, self._drones = server, world, drones
        self._local = LocalFrame(scene.site)
        self._actors = Actors(world)
        self._boxes = BoxView(server, world)
        self._made = False
        server.declare_typed(SCENE, "SceneUpdate")
        server.declare_typed(PLAN, "GeoJson")
        if world.map.actors:
            server.declare_typed(FRAMES, "FrameTransforms")
        for drone in drones:
            server.declare_typed(drone.topic(POSITION), "LocationFix")
        if any(drone.path_W for drone in drones):
            server.log(PLAN, server.sdk.messages.GeoJson(geojson=self._plan()), 0, latch="plan")

    def update(self, truths: Mapping[str, TruthState], wanted: frozenset[str], t_ns: int) -> None:
        """Send what is wanted at the newest states of the vehicles."""
        if SCENE in wanted and not self._made:
            self._made = True
            self._server.log(SCENE, self._scene(), t_ns, latch="scene")
        if FRAMES in wanted:
            self._server.log(FRAMES, self._frames(t_ns), t_ns)
        if BOXES in wanted:
            self._boxes.update(t_ns)
        for drone in self._drones:
            topic, truth = drone.topic(POSITION), truths.get(drone.name)
            if topic in wanted and truth is not None:
                self._server.log(topic, self._fix(drone, truth), t_ns)

    def _fix(self, drone: Drone, truth: TruthState) -> Any:
        latitude, longitude, altitude = self._local.geodetic_from_enu(truth.p_WB)
        return self._server.sdk.messages.LocationFix(
            timestamp=self._timestamp(truth.t_ns),
            frame_id=drone.frame_id,
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
        )

    def _timestamp(self, t_ns: int) -> Any:
        seconds, nanoseconds = divmod(t_ns, NS_PER_S)
        return self._server.sdk.messages.Timestamp(seconds, nanoseconds)

    def _frames(self, t_ns: int) -> Any:
        m = self._server.sdk.messages
        transforms = []
        for i, (x, y, z, yaw) in enumerate(self._actors.places(t_ns)):
            transforms.append(
                m.FrameTransform(
                    timestamp=self._timestamp(t_ns),
                    parent_frame_id=WORLD,
                    child_frame_id=f"actor_{i}",
                    translation=m.Vector3(x=x, y=y, z=z),
                    rotation=self._yaw(yaw),
                )
            )
        return m.FrameTransforms(transforms=transforms)

    def _yaw(self, yaw_rad: float) -> Any:
        return self._server.sdk.messages.Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw_rad), w=math.cos(0.5 * yaw_rad))

    def _scene(self) -> Any:
        m = self._server.sdk.messages
        mesh: SceneMesh = scene_mesh(self._world)
        entities = []
        if mesh.still:
            entities.append(self._model("scene", WORLD, glb(mesh.still)))
        entities += [
            self._model(f"actor_{i}", f"actor_{i}", glb(pieces)) for i, (_, pieces) in enumerate(mesh.moving) if pieces
        ]
        for number, drone in enumerate(self._drones):
            entities += self._drone(drone, _COLOURS[number % len(_COLOURS)])
        return m.SceneUpdate(entities=entities)

    def _model(self, name: str, frame_id: str, data: bytes) -> Any:
        m = self._server.sdk.messages
        model = m.ModelPrimitive(
            pose=self._pose((0.0, 0.0, 0.0)),
            scale=m.Vector3(x=1.0, y=1.0, z=1.0),
            media_type="model/gltf-binary",
            data=data,
        )
        return m.SceneEntity(frame_id=frame_id, id=name, frame_locked=True, models=[model])

    def _pose(self, p: Vec3) -> Any:
        m = self._server.sdk.messages
        return m.Pose(position=m.Vector3(x=p[0], y=p[1], z=p[2]), orientation=m.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))

    def _drone(self, drone: Drone, rgb: tuple[float, float, float]) -> list[Any]:
        """Return a body with its rotors, and the planned path as a line."""
        m = self._server.sdk.messages
        colour = m.Color(r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)
        dark = m.Color(r=0.15, g=0.15, b=0.15, a=0.8)
        rotors = [
            m.CylinderPrimitive(
                pose=self._pose(centre),
                size=m.Vector3(x=2 * radius, y=2 * radius, z=_ROTOR_HEIGHT_M),
                bottom_scale=1.0,
                top_scale=1.0,
                color=dark,
            )
            for centre, radius in drone.rotors_m
        ]
        arms = [
            m.LinePrimitive(
                type=m.LinePrimitiveLineType.LineList,
                pose=self._pose((0.0, 0.0, 0.0)),
                thickness=0.02,
                points=[self._point(p) for centre, _ in drone.rotors_m for p in ((0.0, 0.0, 0.0), centre)],
                color=dark,
            )
        ]
        size = m.Vector3(x=_BODY_M[0], y=_BODY_M[1], z=_BODY_M[2])
        body = m.CubePrimitive(pose=self._pose((0.0, 0.0, 0.0)), size=size, color=colour)
        entities = [
            m.SceneEntity(
                frame_id=drone.frame_id,
                id=f"drone {drone.name}".strip(),
                frame_locked=True,
                cubes=[body],
                cylinders=rotors,
                lines=arms,
            )
        ]
        if drone.path_W:
            line = m.LinePrimitive(
                type=m.LinePrimitiveLineType.LineStrip,
                pose=self._pose((0.0, 0.0, 0.0)),
                thickness=2.0,
                scale_invariant=True,
                points=[self._point(p) for p in drone.path_W],
                color=colour,
            )
            entities.append(m.SceneEntity(frame_id=WORLD, id=f"plan {drone.name}".strip(), lines=[line]))
        return entities

    def _point(self, p: Vec3) -> Any:
        return self._server.sdk.messages.Point3(x=p[0], y=p[1], z=p[2])

    def _plan(self) -> str:
        features = []
        for drone in self._drones:
            if not drone.path_W:
                continue
            places = [self._local.geodetic_from_enu(p) for p in drone.path_W]
            line = [[longitude, latitude, altitude] for latitude, longitude, altitude in places]
            features.append(
                {
                    "type": "Feature",
                    "properties": {"name": f"plan {drone.name}".strip()},
                    "geometry": {"type": "LineString", "coordinates": line},
                }
            )
        return json.dumps({"type": "FeatureCollection", "features": features})
