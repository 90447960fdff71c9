"""Methods about the session: versions, api control, arming, reset, pause, and the vehicles that exist."""

from __future__ import annotations

from dataclasses import replace

from hil.apps.airsim.flight.simple_flight import SimpleFlight
from hil.apps.airsim.rpc.arguments import BOOL, COUNT, FLOAT, INT, POSE, TEXT, Pose
from hil.apps.airsim.rpc.methods import Method, Parameter, Pending, RpcError, method, optional
from hil.apps.airsim.rpc.packing import Double
from hil.apps.airsim.simulation import FRAME_TICKS, Simulation
from hil.apps.airsim.world.drone import Drone
from signals._kernel import roll_pitch_yaw
from signals.time import NS_PER_S
from signals.units import DEG_PER_RAD

SERVER_VERSION = 4  # Cosys-AirSim's client asks for 4 at least, AirSim's for 1
MIN_CLIENT_VERSION = 1
_LONGEST_S = 1.0e6
_TYPES = {"simpleflight": "SimpleFlight", "computervision": "ComputerVision"}
VEHICLE = optional("vehicle_name", TEXT, "")


def geo_point(simulation: Simulation, p_W: tuple[float, float, float]) -> dict[str, float]:
    """Return AirSim's GeoPoint of a point of W."""
    latitude, longitude, altitude = simulation.earth.geodetic(p_W)
    return {"latitude": Double(latitude), "longitude": Double(longitude), "altitude": float(altitude)}


def flight_of(drone: Drone, name: str) -> SimpleFlight:
    """Return the flight controller of a vehicle. Raises RpcError in ComputerVision and with ExternalPhysicsEngine."""
    if drone.flight is None:
        raise RpcError(
            f"{name} needs a vehicle that flies, and {drone.name} only stands where simSetVehiclePose puts it; set "
            "SimMode to Multirotor and PhysicsEngineName to FastPhysicsEngine in settings.json"
        )
    return drone.flight


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def enable_api_control(enabled: bool, vehicle: str) -> None:
        flight = sim.drone(vehicle).flight
        if flight is not None:
            flight.enable_api_control(enabled)

    def is_api_control_enabled(vehicle: str) -> bool:
        flight = sim.drone(vehicle).flight
        return flight is not None and flight.api_control

    def arm(armed: bool, vehicle: str) -> bool:
        drone = sim.drone(vehicle)
        flight = flight_of(drone, "armDisarm")
        done = flight.arm(armed)
        if not flight.api_control:
            sim.log(f"armDisarm of {drone.name} was refused: call enableApiControl(True) first")
        return done

    def continue_for_time(seconds: float) -> Pending:
        if not 0.0 <= seconds <= _LONGEST_S:
            raise RpcError(f"simContinueForTime takes 0 to {_LONGEST_S:g} seconds, not {seconds:g}")
        return sim.continue_for(round(seconds * NS_PER_S / sim.world.tick_ns))

    def continue_for_frames(frames: int) -> Pending:
        return sim.continue_for(frames * FRAME_TICKS)

    def add_vehicle(name: str, kind: str, pose: Pose, pawn_path: str) -> bool:  # noqa: ARG001
        wanted = _TYPES.get(kind.lower())
        own = "SimpleFlight" if sim.flies else "ComputerVision"
        if wanted != own:
            sim.log(f"simAddVehicle cannot add a vehicle of type '{kind[:60]}' now; use '{own.lower()}'")
            return False
        if not name:
            raise RpcError("simAddVehicle needs a name for the vehicle")
        roll, pitch, yaw = roll_pitch_yaw(pose.orientation)
        angles = (roll * DEG_PER_RAD, pitch * DEG_PER_RAD, yaw * DEG_PER_RAD)
        settings = sim.settings.added_vehicle(name)
        sim.add(
            replace(
                settings,
                position_m=(pose.position.x_val, pose.position.y_val, pose.position.z_val),
                rotation_deg=angles,
            )
        )
        return True

    def print_message(message: str, parameter: str, severity: int) -> None:
        level = {1: "warning: ", 2: "error: "}.get(severity, "")
        sim.log(f"{level}{message}{parameter}")

    def run_console_command(command: str) -> bool:
        sim.log(f"simRunConsoleCommand: there is no Unreal console here; '{command[:80]}' did nothing")
        return False

    return [
        method("ping", lambda: True),
        method("getServerVersion", lambda: SERVER_VERSION),
        method("getMinRequiredClientVersion", lambda: MIN_CLIENT_VERSION),
        method("enableApiControl", enable_api_control, Parameter("is_enabled", BOOL), VEHICLE),
        method("isApiControlEnabled", is_api_control_enabled, VEHICLE),
        method("armDisarm", arm, Parameter("arm", BOOL), VEHICLE),
        method("reset", sim.reset),
        method("simPause", sim.pause, Parameter("is_paused", BOOL)),
        method("simIsPaused", lambda: not sim.runs),
        method("simContinueForTime", continue_for_time, Parameter("seconds", FLOAT)),
        method("simContinueForFrames", continue_for_frames, Parameter("frames", COUNT)),
        method("listVehicles", lambda: list(sim.drones)),
        method(
            "simAddVehicle",
            add_vehicle,
            Parameter("vehicle_name", TEXT),
            Parameter("vehicle_type", TEXT),
            Parameter("pose", POSE),
            optional("pawn_path", TEXT, ""),
        ),
        method("getSettingsString", lambda: sim.settings.text),
        method("getHomeGeoPoint", lambda name: geo_point(sim, sim.drone(name).origin.origin_W), VEHICLE),
        method(
            "simPrintLogMessage",
            print_message,
            Parameter("message", TEXT),
            optional("message_param", TEXT, ""),
            optional("severity", INT, 0),
        ),
        method("simRunConsoleCommand", run_console_command, Parameter("command", TEXT)),
        # Clients before June 2018:
        method("isSimulationMode", lambda: True),
        method("timestampNow", lambda: sim.now_ns),
        method("getServerDebugInfo", lambda: ""),
    ]
