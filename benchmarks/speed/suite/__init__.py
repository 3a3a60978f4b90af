"""Measure jotlight's hot paths beside their rivals: `python benchmarks/speed/run.py`."""
