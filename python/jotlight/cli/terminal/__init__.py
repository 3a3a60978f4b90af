"""The terminal.

``console`` writes results, warnings, errors, and progress, ``signals`` raises termination signals
as exceptions, and ``examples`` ends the help page of each command.
"""
