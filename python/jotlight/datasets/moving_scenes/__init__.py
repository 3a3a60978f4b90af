"""Moving scenes: bits of photographs that move, with the exact image, motion, and occlusion.

- `textures`: photographs as functions of continuous coordinates.
- `paths`: where a plane is at each time.
- `planes`: textures with an outline that move along paths.
- `kinds`: the named scenes. `tables`: their poses in text files.
- `drawn_frames`: frames that are drawn when they are read.
- `scene`: what a sensor records of the planes.
"""

from jotlight.datasets.moving_scenes.kinds import MOTIONS
from jotlight.datasets.moving_scenes.scene import MovingScene, moving

__all__ = ["MOTIONS", "MovingScene", "moving"]
