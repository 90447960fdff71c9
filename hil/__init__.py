"""The bench controller, in floors that import downwards only: cli, apps, run, config."""

import sys

from hil.moved import MovedModules

sys.meta_path.append(MovedModules())
