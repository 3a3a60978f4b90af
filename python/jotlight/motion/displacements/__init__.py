"""Displacements of the parts of a scene, estimated from counts.

In reading order:

- ``velocity``, ``velocity_scores``, ``segments``, ``rotation``: the velocities of the parts of a
  scene, from correlations.
- ``scoring``, ``regularize``: displacements of blocks and tiles, from a template.
- ``affine``, ``affine_curve``, ``smoothing``, ``shrinkage``: the affine motion of a segment, and
  its curve in time.
- ``deformation``, ``deformation_prior``, ``tile_updates``: the motion of each tile.
- ``track``: the displacements of all blocks, while they are estimated.
- ``disagreement``: how much counts along a motion disagree with a template. ``flicker``: light that
  changes.
"""
