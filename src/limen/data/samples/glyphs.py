"""A small alphabet of 5 x 7 dots for the labels of the sample image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CONSONANTS", "DOTS", "VOWELS", "codes"]

ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 "

_DRAWN = """
0E11111F111111 1E11111E11111E 0E11101010110E 1E11111111111E 1F10101E10101F 1F10101E101010 0E11101711110F
1111111F111111 0E04040404040E 0702020202120C 11121418141211 1010101010101F 111B1515111111 11191513111111
0E11111111110E 1E11111E101010 0E11111115120D 1E11111E141211 0F10100E01011E 1F040404040404 1111111111110E
11111111110A04 1111111515151B 11110A040A1111 11110A04040404 1F01020408101F
0E11131519110E 040C040404040E 0E11010608101F 1F02040201110E 02060A121F0202 1F101E0101110E 0608101E11110E
1F010204080808 0E11110E11110E 0E11110F01020C 00000000000000
"""

DOTS: NDArray[np.uint8] = np.array(
    [
        [[int(rows[2 * r : 2 * r + 2], 16) >> (4 - c) & 1 for c in range(5)] for r in range(7)]
        for rows in _DRAWN.split()
    ],
    dtype=np.uint8,
)
"""(37, 7, 5) of 0 and 1: rows and columns of every letter."""


def codes(text: str) -> NDArray[np.uint8]:
    """Numbers of a text's letters in :data:`DOTS`.

    >>> codes("AB 0").tolist()
    [0, 1, 36, 26]
    """
    return np.array([ALPHABET.index(letter) for letter in text], dtype=np.uint8)


VOWELS = codes("AEIOUAEO")
CONSONANTS = codes("LMNRSTKVDBLMNRTH")
