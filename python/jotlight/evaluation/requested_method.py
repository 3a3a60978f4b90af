"""The name of the method that a caller requests."""

from collections.abc import Collection
from typing import Any

from jotlight.evaluation.methods import (
    METHODS,
    OPTION_DEFAULTS,
    check_options,
    option_advice,
    option_names,
    unknown_option,
)
from jotlight.networks.loading import wrong_network
from jotlight.networks.pretrained import check_quality


def requested_method(method: str | None, options: Collection[str] = ()) -> str | None:
    """Return the requested method: the named one, or the one that an option selects.

    Parameters
    ----------
    method : str or None
        Name of a method.
    options : collection of str
        Names in :data:`OPTION_DEFAULTS` that the user set.

    Returns
    -------
    str or None
        A key of :data:`METHODS`, `COLOR_NETWORK`, or None if neither a name nor an option is set.

    Raises
    ------
    ValueError
        For an unknown name, or an option that the method does not accept.

    Examples
    --------
    >>> requested_method(None, ["weight"])
    'admm-tv'
    >>> requested_method("mle", ["weight"])
    Traceback (most recent call last):
      ...
    ValueError: weight: is an option of admm-tv, not of mle
    """
    if method is None:
        method = next((name for key, name in OPTION_DEFAULTS.items() if key in options), None)
    if method is None:
        return None
    accepted = option_names(method) or ()
    for option in options:
        if option not in accepted:
            owners = [name for name, other in METHODS.items() if option in other.options]
            raise ValueError(f"{option}: is an option of {', '.join(owners)}, not of {method}")
    return method


def named_method(method: object, quality: str | None, options: dict[str, Any]) -> str | None:
    """Return the name of the requested method, or None if the caller requests none.

    Examples
    --------
    >>> named_method(None, "small", {})
    'network-small'
    """
    wrong = wrong_network(method)
    if wrong is not None or not isinstance(method, str | None):
        raise TypeError(
            "method: expected the name of a method, a network, or a function, got "
            f"{wrong or repr(method)}"
        )
    if quality is None:
        known = list(OPTION_DEFAULTS)
        if method is None and (unknown := set(options) - set(known)):
            expected = f"without a method, expected one of the options {', '.join(known)}"
            raise unknown_option(min(unknown), known, expected)
        name = requested_method(method, [option for option in options if option in known])
        if name is not None:
            check_options(name, options)
        return name
    if method is not None:
        raise ValueError(
            f"quality: selects a pretrained network, but method is {method!r}; leave out one"
        )
    name = network_name(quality)
    check_options(name, options)
    return name


def check_extras(quality: str | None, options: dict[str, Any], *, fallback: bool) -> None:
    """Raise ValueError for arguments that do not go with a network of the caller.

    Examples
    --------
    >>> check_extras(None, {}, fallback=False)
    """
    extras = [*["quality"] * (quality is not None), *options, *["fallback"] * fallback]
    if extras:
        name = extras[0]
        raise ValueError(f"{name}: is not an option of a network; {option_advice(name)}")


def network_name(quality: str) -> str:
    """Return the name of the method that runs the pretrained network of a size.

    Examples
    --------
    >>> network_name("small")
    'network-small'
    """
    check_quality(quality)
    return f"network-{quality}"
