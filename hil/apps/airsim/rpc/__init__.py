"""MessagePack-RPC over TCP, as AirSim's server (rpclib) and its clients speak it."""
