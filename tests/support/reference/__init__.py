"""Slow and obvious twins of the engine, from the definitions, with nothing taken from it."""
