"""Strict readers of files written by people: every value has its line, all problems are reported at once."""
