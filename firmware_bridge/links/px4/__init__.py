"""Links to PX4, simulated or on a board, and to the mock Pixhawk, which behaves as PX4 does."""
