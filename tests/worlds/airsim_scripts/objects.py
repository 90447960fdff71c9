"""List, find, move, add and remove objects of the scene, and look for a line of sight."""

import math

from session import airsim, near, quaternion, ready

client = ready("Lead")
names = client.simListSceneObjects("Cone.*")
assert names
assert all(name.startswith("Cone") for name in names)
ball = client.simGetObjectPose("OrangeBall")
place = (ball.position.x_val, ball.position.y_val, ball.position.z_val)
assert all(math.isfinite(value) for value in place)
assert math.isnan(client.simGetObjectPose("NoSuchThing").position.x_val)
ball.position.z_val -= 2
assert client.simSetObjectPose("OrangeBall", ball, True)
moved = client.simGetObjectPose("OrangeBall").position
near((moved.x_val, moved.y_val, moved.z_val), (place[0], place[1], place[2] - 2), 1e-3)
pose = airsim.Pose(airsim.Vector3r(10, 0, -3), quaternion(0, 0, 0))
assets = client.simListAssets()
assert assets
added = client.simSpawnObject("wall", "Cube" if "Cube" in assets else assets[0], pose, airsim.Vector3r(1, 1, 1), False)
assert added in client.simListSceneObjects(".*")
assert client.simDestroyObject(added)
assert added not in client.simListSceneObjects(".*")
assert client.simSetSegmentationObjectID("OrangeBall", 77, False)
assert client.simGetSegmentationObjectID("OrangeBall") == 77
home = client.getHomeGeoPoint("Lead")
home.altitude += 30
assert client.simTestLineOfSightToPoint(home, "Lead") is True
home.altitude -= 60
assert client.simTestLineOfSightToPoint(home, "Lead") is False
