"""How methods are called in tables and curves, those included that only experiments have."""

from jotlight.evaluation.methods import METHODS

ALGEBRAIC = "noniterative-bm3d-algebraic"
"""The paper's own: BM3D with the inverse of its equation (7)."""

UNTIED = "network-untied"
"""The paper's own network: with a weight for each jot in h1."""

_TITLES = {
    ALGEBRAIC: "non-iterative, BM3D, algebraic inverse",
    UNTIED: "network, a weight for each jot",
}


def title(method: str) -> str:
    """How a method is called.

    Examples
    --------
    >>> title("mle"), title(UNTIED)
    ('maximum likelihood', 'network, a weight for each jot')
    """
    return _TITLES.get(method) or METHODS[method].title
