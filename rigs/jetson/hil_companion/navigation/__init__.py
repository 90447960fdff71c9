"""Strapdown navigation that several CUTs share: rotations, a local plane for GPS and barometer, the inertial filter."""
