"""The titles of methods in tables and figures, including methods that only experiments have."""

from jotlight.evaluation.methods import METHODS

ALGEBRAIC = "noniterative-bm3d-algebraic"
"""BM3D with the algebraic inverse of equation (7), which the paper uses."""

UNTIED = "network-untied"
"""The paper's own network, with a weight for each jot in h1."""

_TITLES = {
    ALGEBRAIC: "non-iterative, BM3D, algebraic inverse",
    UNTIED: "network, a weight for each jot",
}


def method_title(method: str) -> str:
    """Return the title of a method. For a function of the caller it is its name.

    Examples
    --------
    >>> method_title("mle"), method_title(UNTIED)
    ('maximum likelihood', 'network, a weight for each jot')
    """
    if method in METHODS:
        return METHODS[method].title
    return _TITLES.get(method, method)
