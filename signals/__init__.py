"""Leaf package: sample types, time, frames, noise streams, errors, documents.

It imports the standard library, numpy and its own kernel. `signals.documents`, the one strict reader of settings files,
also imports PyYAML and pydantic.
"""
