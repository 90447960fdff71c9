"""Print a digest of the states, samples and pictures of a flight."""

import hashlib
import sys

from session import airsim, ready

client = ready("Lead", "Wing")
digest = hashlib.sha256()


def keep(*values):
    for value in values:
        digest.update(repr(getattr(value, "to_msgpack", lambda value=value: value)()).encode())


def look():
    keep(client.getMultirotorState("Lead"), client.simGetGroundTruthKinematics("Wing"))
    keep(client.getImuData(vehicle_name="Lead"), client.getLidarData("Scan", "Lead"))
    if "--images" in sys.argv:
        kinds = airsim.ImageType
        for answer in client.simGetImages(
            [
                airsim.ImageRequest("0", kinds.Scene, False, False),
                airsim.ImageRequest("1", kinds.DepthPlanar, True, False),
                airsim.ImageRequest("2", kinds.Segmentation),
            ],
            "Lead",
        ):
            keep(bytes(answer.image_data_uint8), list(answer.image_data_float), answer.time_stamp)


client.takeoffAsync(vehicle_name="Lead").join()
look()
client.moveToPositionAsync(8, 3, -6, 4, vehicle_name="Lead").join()
look()
client.takeoffAsync(vehicle_name="Wing").join()
client.moveByRollPitchYawZAsync(0.05, -0.1, 0.3, -5, 2, vehicle_name="Lead").join()
look()
client.simPause(True)
move = client.moveByVelocityAsync(1, -1, 0, 5, vehicle_name="Wing")
for _ in range(5):
    client.simContinueForTime(0.2)
    look()
client.simPause(False)
move.join()  # before the next call, which would else find Wing on its way
client.landAsync(vehicle_name="Lead").join()
look()
print(digest.hexdigest())
