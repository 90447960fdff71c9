"""The bench controller, in layers of which each imports only the following ones: cli, apps, run, config."""

import sys

from hil.moved import MovedModules

sys.meta_path.append(MovedModules())
