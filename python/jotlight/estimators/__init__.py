"""Estimators of the intensity from bits or counts: sections 2.2.1 and 2.2.2 of the paper.

In reading order:

* closed form: ``mle``, ``inverse_response`` (equation 5), ``inpaint`` (dead pixels),
  ``alike_jots`` (jots that differ);
* readings that differ, or of several bits: ``joint_mle``, ``merge_readings`` (equivalent counts at
  the maximum) and ``merge_near`` (near an estimate) with ``neighbors`` (averages) and
  ``whole_counts``, ``reference_sensors`` and ``typical_trials`` (the sensor of these counts, and
  how many trials they have), ``generalized_anscombe``;
* variance stabilization: ``vst`` (equations 6 and 7), ``denoise``, ``trial_levels`` (pixels with
  different numbers of trials), ``noniterative``;
* iterative methods: ``problem_building`` (equation 4), ``image_solver`` (its solution for each
  image), ``convergence``, ``mle_iterative`` with ``descent``, and ``tv``
  with ``local_information``, ``admm`` with
  ``admm_splitting``, ``admm_terms``, and ``linear_solver``;
* smooth kernels and mosaics: ``deconvolution``, ``demosaicing``;
* quality of an estimate: ``uncertainty`` with ``light_inversion``, ``joint_uncertainty`` with
  ``pixel_kinds``, ``brightness``;
* plans of captures: ``planning`` with ``planned_bits``, ``planned_readings``, ``planned_estimates``
  (the errors of readings that differ), ``planned_motion``, and ``figure``, ``bracketing`` with
  ``bracket_choice``;
* other sensors: ``dead_time`` with ``renewal`` and ``merge_detections`` (free-running pixels),
  ``gates`` with ``decays`` (lifetimes).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["denoise", "gates", "tv", "vst"])
