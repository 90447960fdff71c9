"""The mocked flight controller."""
