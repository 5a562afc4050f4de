"""Find the landmarks on the MakeHuman head, as shipped.

python tools/learn_landmarks.py    writes src/unlit/head/sources/makehuman_landmarks.npz
"""

from __future__ import annotations

import numpy as np

from unlit.head.embedding import embed_landmarks
from unlit.head.sources.makehuman import ASSET, build
from unlit.head.sources.makehuman_learnt import LANDMARKS_FILE
from unlit.machine.assets import asset


def main() -> None:
    """Make the embedding that is shipped."""
    model = build(asset(ASSET), bare=True)
    found = embed_landmarks(model.neutral, model.triangles, model.vertex_region, symmetric=True)
    np.savez_compressed(LANDMARKS_FILE, triangle=found.triangle, barycentric=found.barycentric)


if __name__ == "__main__":
    main()
