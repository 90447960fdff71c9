"""Flight to a goal through unmapped places: mapping, path planning, steering. Needs OpenCV and numpy."""
