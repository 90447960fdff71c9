"""File formats of a data set: functions from samples to bytes, independent of how samples are made.

Each is a pure function or an object that one worker owns. The same input gives the same bytes on every machine (PNG
files: the same pixels) and in any order of work. Files of many samples (CSV, COCO) are joined by the main process from
pieces that workers make.
"""
