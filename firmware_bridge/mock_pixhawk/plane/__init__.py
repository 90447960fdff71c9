"""The mock autopilot flies a plane: laws, modes, missions. Nothing here runs for a multirotor."""
