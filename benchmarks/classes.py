"""What a pixel of a head may show. A clear lens lies over another class; the others sum to 1."""

from __future__ import annotations

CLASSES = (
    *("background", "skin", "lips", "eyes", "eyebrows", "mouth", "hair", "beard"),
    *("frame", "clear lens", "tinted lens", "cloth", "hand"),
)
LENS = CLASSES.index("clear lens")
OTHERS = [k for k in range(len(CLASSES)) if k != LENS]
