"""The precisions in which networks multiply."""

from typing import Final

from jotlight.parameter_names import check_choice

F32: Final = "f32"
"""Numbers of 32 bits, the default."""

BF16: Final = "bf16"
"""bfloat16: numbers of 16 bits with 8 bits of precision."""

PRECISIONS = F32, BF16
"""The names of all precisions."""

DEEP = 'leave it out, or take a deep network, such as quality="medium" (--quality medium)'
"""What to do where there is no bfloat16."""


def check_precision(precision: str) -> None:
    """Raise ValueError for an unknown precision.

    Examples
    --------
    >>> check_precision("double")
    Traceback (most recent call last):
      ...
    ValueError: precision: expected one of f32, bf16, got 'double'
    """
    check_choice("precision", precision, PRECISIONS)
