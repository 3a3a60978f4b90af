"""Motion: alignment and merging of the bits of moving scenes.

In reading order:

- ``motion``: the result of an alignment, displacements over time; ``figure`` draws it.
  ``posterior``: the errors of displacements. ``reference_time``: the same motion as seen from
  another time.
- ``align``: the alignment. ``path_search``: the search for the motion that explains the bits best.
  ``sensor_blocks``, ``dark_frames``: which jots and which frames are counted.
  ``fast_motion``: motion within blocks.
- ``burst``, ``block_edges``, ``frame_times``, ``blocks``, ``sums``: frames, their division into
  blocks, their places between blocks, the counting along a motion, and the counts.
- ``velocity``, ``segments``, ``rotation``, ``objects``: the search for the velocities of the parts
  of a scene. ``velocity_scores``: the correlations behind it.
- ``scoring``, ``affine``, ``tiles``, ``regularize``, ``tile_updates``, ``deformation``:
  displacements of blocks, from a template. ``smoothing``, ``affine_curve``, ``shrinkage``,
  ``deformation_prior``: their curves in time. ``track``: what is known while they are estimated.
  ``kept_sums``: the sums of blocks meanwhile.
- ``outlines``, ``segment_outlines``, ``short_outlines``, ``depth``: which pixels follow which
  motion, and what is in front. ``labels``: the values of pixels by the motion that they follow.
  ``added_tiles``: tiles that move by themselves. ``likelihood_gain``: how much better a motion is
  than none.
- ``merge``: the counts of all bits along a motion; ``merged_pixels`` adds up their jots.
  ``consistency``, ``stricter_test``, ``disagreement``, ``flags``, ``still_window``: which bits
  agree, and how much; which pixels not to trust; and when a window without motion is better.
  ``held_out``: how merged counts predict other frames. ``expected_errors``: where errors are
  expected although single pixels do not show them.
- ``film``, ``live_film``, ``film_image``: an image of each window of frames. ``film_settings``,
  ``film_frames``: how it is made, and of which frames. ``film_state``: what a film carries from
  image to image. ``film_candidates``: an image along each of several motions. ``film_schedule``:
  when its motion is estimated again. ``film_merging``, ``carrying``, ``memory``: the steps of an
  image. ``film_estimates``: the images by the film network.
- ``jots``, ``equivalent``, ``flicker``, ``lights``: jots that differ, and light that changes.
  ``reading_counts``, ``reading_response``: readings of several bits, and brackets, as counts.
- ``jot_kinds``, ``squares``, ``mosaic_colors``, ``threshold_maps``, ``film_kinds``: jots behind
  color filters, or with different thresholds. ``finer``: a grid of half pixels.
- ``detection``: whether a scene moves at all. ``cost``: the time and memory of an alignment.

``docs/decisions/0019-motion.md`` describes the method.
"""
