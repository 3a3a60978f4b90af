"""What goes wrong, said in the user's words.

Bad values raise :class:`ValueError`, bad types :class:`TypeError`, files :class:`OSError` or
:class:`ValueError`; only what has no built-in name is named here.
"""


class JotlightWarning(UserWarning):
    """Something was done that the user should know of, such as a dead pixel filled in."""


class MissingExtraError(ImportError):
    """An optional package is needed and not installed."""
