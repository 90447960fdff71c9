"""Leaf package: sample types, time, frames, noise streams, errors, documents.

It imports only the standard library, numpy and its own kernel. `signals.documents`, the strict reader of settings
files, also imports PyYAML and pydantic.
"""
