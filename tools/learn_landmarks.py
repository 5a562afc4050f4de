"""Find the landmarks on the MakeHuman head, as shipped.

python tools/learn_landmarks.py    writes src/unlit/head/sources/makehuman_landmarks.npz
"""

from __future__ import annotations

import numpy as np

from unlit.head.embedding import embed_landmarks
from unlit.head.model import LANDMARKS
from unlit.head.sources.makehuman import ASSET, build
from unlit.head.sources.makehuman_learnt import (
    LANDMARKS_FILE,
    shipped_displacement,
    shipped_prior,
)
from unlit.machine.assets import asset
from unlit.scene.surface_points import SurfacePoints


def main() -> None:
    """Make the embedding that is shipped."""
    none = SurfacePoints.empty(LANDMARKS)
    model = build(asset(ASSET), none, shipped_prior(), shipped_displacement())[0]
    found = embed_landmarks(model.neutral, model.triangles, model.vertex_region, symmetric=True)
    np.savez_compressed(LANDMARKS_FILE, triangle=found.triangle, barycentric=found.barycentric)


if __name__ == "__main__":
    main()
