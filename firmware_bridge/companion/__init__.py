"""The companion link, bench side: frames out to the clients under test, their desired states back, over ZeroMQ."""
