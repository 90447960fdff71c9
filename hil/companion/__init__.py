"""The companion link's side of the tick: frames for the clients under test, and what becomes of their answers."""
