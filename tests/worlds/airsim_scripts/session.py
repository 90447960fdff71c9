"""Parts that the scripts beside this file share: `python SCRIPT PACKAGE PORT`, PACKAGE `airsim` or `cosysairsim`."""

import importlib
import math
import sys

airsim = importlib.import_module(sys.argv[1])


def connect(kind="MultirotorClient"):
    """Return a client of the server."""
    client = getattr(airsim, kind)(port=int(sys.argv[2]))
    client.confirmConnection()
    return client


def ready(*vehicles, client=None):
    """Return a client of a world as at its start, whose vehicles are armed and under API control."""
    client = client or connect()
    client.reset()
    client.simPause(False)
    client.simSetWind(airsim.Vector3r(0, 0, 0))
    for vehicle in vehicles:
        client.enableApiControl(True, vehicle)
        assert client.isApiControlEnabled(vehicle)
        assert client.armDisarm(True, vehicle)
    return client


def position(client, vehicle=""):
    """Return x, y, z of the estimated state."""
    p = client.getMultirotorState(vehicle).kinematics_estimated.position
    return p.x_val, p.y_val, p.z_val


def near(value, wanted, tolerance):
    """Raise AssertionError if two points are further apart than the tolerance."""
    assert math.dist(value, wanted) <= tolerance, f"{value} is not within {tolerance} m of {wanted}"


def quaternion(roll, pitch, yaw):
    """Return a quaternion of angles in radians: the packages have two names and two orders for it."""
    if hasattr(airsim, "euler_to_quaternion"):
        return airsim.euler_to_quaternion(roll, pitch, yaw)
    return airsim.to_quaternion(pitch, roll, yaw)
