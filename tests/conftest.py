"""Settings of hypothesis for every test: no example fails because the machine is busy."""

from hypothesis import settings

settings.register_profile("bench", deadline=None)
settings.load_profile("bench")
