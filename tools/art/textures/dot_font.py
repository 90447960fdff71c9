"""Characters of 5 x 7 dots, for signs and number plates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_DOTS = {  # rows from the top
    "0": "01110 10001 10011 10101 11001 10001 01110", "1": "00100 01100 00100 00100 00100 00100 01110",
    "2": "01110 10001 00001 00110 01000 10000 11111", "3": "11110 00001 00001 01110 00001 00001 11110",
    "4": "00010 00110 01010 10010 11111 00010 00010", "5": "11111 10000 11110 00001 00001 10001 01110",
    "7": "11111 00001 00010 00100 01000 01000 01000", "8": "01110 10001 10001 01110 10001 10001 01110",
    "A": "01110 10001 10001 11111 10001 10001 10001", "B": "11110 10001 11110 10001 10001 10001 11110",
    "C": "01110 10001 10000 10000 10000 10001 01110", "E": "11111 10000 10000 11110 10000 10000 11111",
    "H": "10001 10001 10001 11111 10001 10001 10001", "K": "10001 10010 11100 10100 10010 10010 10001",
    "L": "10000 10000 10000 10000 10000 10000 11111", "M": "10001 11011 10101 10101 10001 10001 10001",
    "N": "10001 11001 10101 10011 10001 10001 10001",
    "O": "01110 10001 10001 10001 10001 10001 01110", "P": "11110 10001 10001 11110 10000 10000 10000",
    "R": "11110 10001 10001 11110 10100 10010 10001", "S": "01111 10000 10000 01110 00001 00001 11110",
    "T": "11111 00100 00100 00100 00100 00100 00100", "Y": "10001 10001 01010 00100 00100 00100 00100",
    "Z": "11111 00001 00010 00100 01000 10000 11111",
}  # fmt: skip


def write(
    image: NDArray[np.uint8],
    text: str,
    at: tuple[int, int],
    dot: tuple[int, int],
    advance: int,
    colour: tuple[int, int, int],
) -> None:
    """Write on an image (H, W, 3) from `at`, the row and column of the upper left corner.

    `dot`: rows and columns of a dot. `advance`: columns from one character to the next; a space takes half of them.
    """
    row, column = at
    for character in text:
        if character == " ":
            column += (advance + 1) // 2
            continue
        dots = np.array([[bit == "1" for bit in line] for line in _DOTS[character].split()])
        big = dots.repeat(dot[0], 0).repeat(dot[1], 1)
        image[row : row + big.shape[0], column : column + big.shape[1]][big] = colour
        column += advance
