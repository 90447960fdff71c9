"""Estimator of `hil identify`: see docs/identify-model.md."""

from hil.apps.identify.fit.estimate import estimate

__all__ = ["estimate"]
