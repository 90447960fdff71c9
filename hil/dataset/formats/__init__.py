"""How a data set looks on disk: sample in, bytes out, with no knowledge of how samples are made.

Everything here is a pure function, or an object that one worker owns; the same input gives the same bytes on every
machine and in any order of work. Files that hold many samples (CSV, COCO) are put together from pieces that workers
make, by whoever writes them in order.
"""
