"""The companion link in the tick: sends frames to the clients under test and applies their answers."""
