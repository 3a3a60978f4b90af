"""Plans of captures: errors before there are any bits.

In reading order:

- ``planning``: the plan. ``planned_pixel``: what it needs to know about a pixel.
  ``planned_bits``, ``planned_readings``: the errors of bits, and of readings.
- ``bracketing``, ``bracket_choice``: brackets for a range of light.
- ``planned_estimates``: the errors of readings that differ. ``saddle_point``: those of little light
  with read noise. ``planned_motion``: moving scenes.
- ``figure``: drawings of plans.
"""
