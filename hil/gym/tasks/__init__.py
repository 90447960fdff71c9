"""Tasks: start, observation, reward and end of an episode, for one vehicle or a batch of them."""
