"""Which methods changed after a measurement, so that its page says which rows are older."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Change:
    """A change that moves the figures of some methods."""

    day: str
    text: str
    methods: tuple[str, ...]
    """Names of the methods whose figures at K = 16 moved."""
    moves_time: bool = False
    """Whether their time changed, too, and not only their quality."""


CHANGES = (
    Change(
        "2026-11-27",
        "small for any K, medium, and large were trained further",
        ("network-medium", "network-large", "network-extra-large"),
    ),
    Change(
        "2026-11-27",
        "large for any K replaced large for K = 16 alone, with as many operations",
        ("network-large",),
    ),
    Change(
        "2026-11-28",
        "noniterative-tv makes all of its 200 iterations, and takes more than ten times as long as "
        "medium",
        ("noniterative-tv",),
        moves_time=True,
    ),
)
"""All changes, in the order of their dates."""


def changes_since(date: str) -> str:
    """Return what changed after a date such as 2026-11-25 as a sentence, or "" if nothing did.

    >>> changes_since("2026-11-27").split(",")[0]
    'Changes after the measurement: noniterative-tv makes all of its 200 iterations'
    >>> changes_since("2026-12-31")
    ''
    """
    found = [change.text for change in CHANGES if change.day > date]
    return f"Changes after the measurement: {'; '.join(found)}." if found else ""


def row_title(title: str, method: str, date: str, *, only_time: bool = False) -> str:
    """Return the title of a method's row, which says whether the method changed after a date.

    >>> row_title("network, medium", "network-medium", "2026-11-25")
    'network, medium (changed since)'
    >>> row_title("network, medium", "network-medium", "2026-11-25", only_time=True)
    'network, medium'
    """
    has_changed = any(
        method in change.methods and change.day > date and change.moves_time >= only_time
        for change in CHANGES
    )
    return f"{title} (changed since)" if has_changed else title
