"""AirSim's flight controller: moves, arming, remote control."""
