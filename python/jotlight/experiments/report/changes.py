"""Which methods changed after a measurement, so that its page says which rows are older."""

CHANGES = (
    ("2026-11-27", "small for any K, medium, and large were trained further"),
    ("2026-11-27", "a network for any K with 63 kFLOP per pixel replaced large for K = 16 alone"),
    (
        "2026-11-28",
        "non-iterative total variation makes all of its 200 iterations, and takes more than ten "
        "times as long as medium",
    ),
)
"""Dates of changes that move the figures of a method, and what changed."""


def changes_since(date: str) -> str:
    """Return what changed after a date such as 2026-11-25 as a sentence, or "" if nothing did.

    >>> changes_since("2026-11-27").split(",")[0]
    'Changes after the measurement: non-iterative total variation makes all of its 200 iterations'
    >>> changes_since("2026-12-31")
    ''
    """
    found = [text for day, text in CHANGES if day > date]
    return f"Changes after the measurement: {'; '.join(found)}." if found else ""
