"""Parts of the methods for free-running pixels and for gates.

In reading order: ``renewal`` (counts with a dead time), ``merge_detections`` (equivalent counts),
and ``decays`` (lifetimes).
"""
