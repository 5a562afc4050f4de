"""What people wear or hold at their head, as meshes: glasses, hats, scarves, hands, garments."""

from .glasses import glasses
from .hands import hand
from .hats import hat
from .neckwear import garment, scarf
from .pieces import Piece

__all__ = ["Piece", "garment", "glasses", "hand", "hat", "scarf"]
