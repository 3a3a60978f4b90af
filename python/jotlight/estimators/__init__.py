"""Estimators of the intensity from bits or counts: sections 2.2.1 and 2.2.2 of the paper.

In reading order:

* closed form: ``mle``, ``inverse_response`` (equation 5), ``inpaint`` (dead pixels),
  ``alike_jots`` (jots that differ), ``brightness``;
* variance stabilization: ``vst`` (equations 6 and 7), ``denoise``, ``trial_levels`` (pixels with
  different numbers of trials), ``noniterative``;
* iterative methods: ``mle_iterative``, ``tv``, and ``admm``, with the folder ``iterative``;
* readings that differ, or of several bits: ``merge_readings`` (equivalent counts), with the folder
  ``readings``;
* smooth kernels and mosaics: ``deconvolution``, ``demosaicing``;
* the error of an estimate: ``uncertainty`` with ``light_inversion``;
* plans of captures: the folder ``planning``;
* other sensors: ``dead_time`` (free-running pixels) and ``gates`` (lifetimes), with the folder
  ``photon_counters``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["denoise", "gates", "tv", "vst"])
