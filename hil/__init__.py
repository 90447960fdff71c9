"""The bench controller, in layers of which each imports only the following ones: cli, apps, run, config.

`gym`, the Gymnasium environments, is beside apps.
"""
