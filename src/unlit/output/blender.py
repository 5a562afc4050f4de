"""What the Blender script (blender_script.py) reads."""

from __future__ import annotations

import json

import numpy as np

from ..face.reconstruction import Reconstruction
from ..scene.brdf import IOR
from .atlas import Atlas

#: Blender's environment maps have the middle column along -x (of z up), ours along the camera's
#: -y: a quarter turn, degrees.
_LIGHT_TURN = 90.0


def settings(reconstruction: Reconstruction, atlas: Atlas) -> bytes:
    """blender.json: the camera, and how often the specular lobe is doubled."""
    camera = reconstruction.face.camera
    largest = max(camera.width, camera.height)
    doublings = max(0, int(np.ceil(np.log2(max(float(atlas.specular_albedo.max()), 1)))))
    values = {
        "size": [camera.width, camera.height],
        "fov_x": float(2 * np.arctan(0.5 * camera.width / camera.focal)),
        "shift": [
            (camera.width / 2 - camera.cx) / largest,
            (camera.cy - camera.height / 2) / largest,
        ],
        "ior": IOR,
        "specular_doublings": doublings,
        "light_turn": _LIGHT_TURN,
    }
    return (json.dumps(values, indent=1) + "\n").encode()
