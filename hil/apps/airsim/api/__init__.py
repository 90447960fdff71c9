"""RPC methods of AirSim's API, one file per group; `catalog` lists the groups."""
