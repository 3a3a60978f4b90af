"""Motion: alignment and merging of the bits of moving scenes.

In reading order:

- ``motion``: the result of an alignment, displacements over time; ``figure`` draws it.
  ``posterior``: the errors of displacements. ``reference_time``: the same motion as seen from
  another time. ``tiles``, ``labels``: displacements of tiles, and the motion that a pixel follows.
- ``align``: the alignment. ``path_search``: the search for the motion that explains the bits best.
  ``fast_motion``: motion within blocks.
- ``merge``: the counts of all bits along a motion.
- ``cost``: the time and memory of an alignment.

Its folders, each of which imports only those before it:

- ``counts``: frames, blocks of frames, and counts along a motion.
- ``displacements``: how the parts of a scene move.
- ``agreement``: which bits agree with a motion, and which pixels not to trust.
- ``outlines``: which pixels follow which motion.
- ``merging``: pixels of several jots, jots of several kinds, and finer grids.
- ``films``: an image of each window of frames. It imports the modules above, too.

``docs/decisions/0019-motion.md`` describes the method.
"""
