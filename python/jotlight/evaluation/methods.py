"""All reconstruction methods by name.

The command line, the viewer, the experiments, and the contract tests take the methods from
:data:`METHODS`. A new method is a function of :mod:`jotlight.estimators`, and one entry there.
"""

import dataclasses
import inspect
from collections.abc import Callable, Iterable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.admm import admm_tv
from jotlight.estimators.mle import mle
from jotlight.estimators.mle_iterative import mle_iterative
from jotlight.estimators.noniterative import noniterative
from jotlight.evaluation.held_out import held_out, smooth_kernel_reason
from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS
from jotlight.networks.architectures import QUALITIES
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained
from jotlight.parameter_names import did_you_mean
from jotlight.sensing.data.pixel_counts import Data, gray_images, prepare_data
from jotlight.sensing.sensor import Sensor

Run = Callable[..., npt.NDArray[np.float32]]


def initial_network(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
    **options: Any,
) -> npt.NDArray[np.float32]:
    """Return the estimate of a network at its initial parameters.

    `options` are those of :meth:`jotlight.Network.initial`.
    """
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    network = Network.initial(sensor, **options)
    return network.reconstruct(gray_images(data), sensor, out=out, threads=threads)


def trained_network(
    data: Data,
    sensor: Sensor | None = None,
    *,
    quality: str = "medium",
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Return the estimate of the pretrained network for this sensor."""
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    network = pretrained(sensor, quality)
    return network.reconstruct(gray_images(data), sensor, out=out, threads=threads)


def _deconvolution_reason(sensor: Sensor) -> str | None:
    """Return why the readings of a sensor cannot be deconvolved, or None if they can."""
    if sensor.kernel == "box" or sensor.has_plain_bits:
        return None
    return (
        f"expected the box kernel for readings other than plain bits, got {sensor.kernel}: "
        "deconvolution needs plain bits"
    )


@dataclasses.dataclass(frozen=True)
class Method:
    """A reconstruction method."""

    title: str
    run: Run
    """``run(data, sensor, *, out, threads)`` returns the estimate."""
    quality: str | None = None
    """Size of the pretrained network, or None for other methods."""
    required_package: str | None = None
    """Package that must be installed in addition to jotlight's own dependencies."""
    unsupported_reason: Callable[[Sensor], str | None] = lambda _: None
    """Function that returns why the method cannot serve a sensor, or None if it can."""
    is_distinct: Callable[[Sensor], bool] = lambda _: True
    """Function that returns whether the estimate for a sensor differs from a faster method's."""
    warms_up: bool = True
    """Whether a comparison first runs it on a small image, so that its time excludes imports."""

    @property
    def available(self) -> bool:
        """Whether the required package is installed."""
        return self.required_package is None or find_spec(self.required_package) is not None

    @property
    def iterative(self) -> bool:
        """Whether `run` takes `tol`, `max_iter`, `callback`, and `return_history`."""
        return "return_history" in inspect.signature(self.run).parameters

    @property
    def keywords(self) -> tuple[str, ...] | None:
        """Names of the options that `run` accepts in Python; None where it accepts any name."""
        parameters = inspect.signature(self.run).parameters.values()
        if any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters):
            return None
        fixed = self.run.keywords if isinstance(self.run, partial) else {}
        names = (each.name for each in parameters if each.kind is inspect.Parameter.KEYWORD_ONLY)
        return tuple(name for name in names if name not in _COMMON and name not in fixed)

    @property
    def options(self) -> frozenset[str]:
        """Names in :data:`OPTION_DEFAULTS` that this method accepts."""
        return frozenset(OPTION_DEFAULTS).intersection(self.keywords or ())


_COMMON = frozenset({"trials", "out", "threads", "channel_axis", "return_history"})
"""Parameters of methods that :func:`jotlight.reconstruct` sets."""


def _noniterative(title: str, denoiser: str, required_package: str | None = None) -> Method:
    run = partial(noniterative, denoiser=denoiser)
    return Method(f"non-iterative, {title}", run, required_package=required_package)


def _pretrained_network(size: str) -> Method:
    return Method(f"network, {size}", partial(trained_network, quality=size), quality=size)


METHODS: dict[str, Method] = {
    "mle": Method("maximum likelihood", mle),
    "mle-iterative": Method(
        "maximum likelihood, iterative",
        mle_iterative,
        unsupported_reason=_deconvolution_reason,
        is_distinct=lambda sensor: sensor.kernel != "box",
    ),
    "noniterative-gaussian": _noniterative("Gaussian", "gaussian"),
    "noniterative-tv": _noniterative("total variation", "tv"),
    "noniterative-nlm": _noniterative("non-local means", "nlm"),
    "noniterative-bm3d": _noniterative("BM3D", "bm3d", required_package="bm3d"),
    "admm-tv": Method(
        "ADMM, total variation",
        admm_tv,
        unsupported_reason=_deconvolution_reason,
    ),
    "network-initial": Method("network, initial", initial_network),
    **{f"network-{size}": _pretrained_network(size) for size in QUALITIES},
    "held-out": Method(
        "best blend on held-out bits",
        held_out,
        unsupported_reason=smooth_kernel_reason,
        is_distinct=lambda sensor: sensor.trials > MAX_NETWORK_TRIALS,
    ),
}
"""All methods for gray images, in the order in which tables list them."""

COLOR_NETWORK = "network-color"
"""Name of the color network, which estimates the colors of a mosaic, or three channels, together.

It estimates no gray image, and so it is not in :data:`METHODS`."""

METHOD_NAMES = (*METHODS, COLOR_NETWORK)
"""Names of all methods that a caller may request."""

DEFAULT_METHOD = f"network-{DEFAULT_SIZE}"
"""Method for every sensor, unless another one is requested."""

BLEND_METHOD = "held-out"
"""Method instead of the default for many trials, with the box kernel."""

OPTION_DEFAULTS = {
    "inverse": "noniterative-tv",
    "weight": "admm-tv",
    "norm": "admm-tv",
    "tol": "admm-tv",
    "max_iter": "admm-tv",
}
"""Options that not all methods accept, each with the method that it selects.

If several are set, the first one in this order selects.
"""

_ARGUMENTS = (
    *("data", "sensor", "method", "quality", "trials", "channel_axis", "units", "demosaicing"),
    *("precision", "out", "threads", "fallback", "return_info"),
)
"""Arguments of :func:`jotlight.reconstruct`, which a misspelled option may mean."""


def needs_bits(method: str, sensor: Sensor) -> bool:
    """Return whether a method needs to know where in its pixel each one is. Counts do not say it.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=2, kernel="linear")
    >>> needs_bits("admm-tv", sensor), needs_bits("mle", sensor)
    (True, False)
    """
    is_spread = sensor.kernel != "box" and sensor.oversampling > 1
    return is_spread and is_iterative(method)


def find_method(name: str) -> Method:
    """Return a method for gray images by its name.

    Raises
    ------
    ValueError
        For an unknown name, and for that of the color network.

    Examples
    --------
    >>> find_method("mle").title
    'maximum likelihood'
    >>> find_method("network-mediun")
    Traceback (most recent call last):
      ...
    ValueError: method: there is no 'network-mediun'; did you mean network-medium?
    >>> find_method("tv")
    Traceback (most recent call last):
      ...
    ValueError: method: there is no 'tv'; did you mean noniterative-tv or admm-tv?
    """
    if name in METHODS:
        return METHODS[name]
    if name == COLOR_NETWORK:
        raise ValueError(
            f"method: {name} estimates the colors of a mosaic, or three channels, together; name "
            f"another method for gray images, such as {DEFAULT_METHOD}"
        )
    advice = did_you_mean(name, METHOD_NAMES)
    if ":" in name:
        advice = (
            "; the commands compare, evaluate, and reproduce run MODULE:FUNCTION, and in Python "
            "pass the function itself"
        )
    elif not advice:
        advice = (
            f"; expected one of {', '.join(METHOD_NAMES)}; for a function of your own, pass the "
            "function itself in Python, and MODULE:FUNCTION to the commands compare, evaluate, and "
            "reproduce"
        )
    raise ValueError(f"method: there is no {name!r}{advice}")


def option_names(method: str) -> tuple[str, ...] | None:
    """Return the names of the options of a method in Python; None where it accepts any name.

    Examples
    --------
    >>> option_names("noniterative-tv"), option_names("network-color")
    (('inverse',), ())
    """
    return () if method == COLOR_NETWORK else find_method(method).keywords


def is_iterative(method: object) -> bool:
    """Return whether a method is the name of one that takes `tol`, `max_iter`, and `callback`.

    Examples
    --------
    >>> is_iterative("admm-tv"), is_iterative("network-color"), is_iterative(None)
    (True, False, False)
    """
    return isinstance(method, str) and method in METHODS and METHODS[method].iterative


def check_options(method: str, options: Iterable[str]) -> None:
    """Raise TypeError for an option in Python that a method does not accept.

    Examples
    --------
    >>> check_options("admm-tv", ["wieght"])
    Traceback (most recent call last):
      ...
    TypeError: wieght: admm-tv has the options weight, norm, ...; did you mean weight?
    """
    known = option_names(method)
    if known is None:
        return
    for option in options:
        if option not in known:
            text = f"has the options {', '.join(known)}" if known else "has no options"
            raise unknown_option(option, known, f"{method} {text}")


def unknown_option(option: str, known: Iterable[str], expected: str) -> TypeError:
    """Return the error for an option that is none of the known ones.

    Examples
    --------
    >>> unknown_option("motion", [], "mle has no options")
    TypeError('motion: mle has no options; for a moving scene, pass jotlight.merge(bits)')
    """
    if option == "motion":
        return TypeError(f"motion: {expected}; for a moving scene, pass jotlight.merge(bits)")
    return TypeError(f"{option}: {expected}; {option_advice(option, known)}")


def option_advice(option: str, known: Iterable[str] = ()) -> str:
    """Return the nearest known option or argument of :func:`jotlight.reconstruct`, as a question.

    Examples
    --------
    >>> option_advice("qualty"), option_advice("wieght", ["weight"]), option_advice("color")
    ('did you mean quality?', 'did you mean weight?', 'leave it out')
    >>> option_advice("model")
    'for a network of your own, pass method=net'
    """
    if option in ("model", "network") and option not in known:
        return "for a network of your own, pass method=net"
    # Other functions with options do not have all of the arguments.
    names = [] if option in _ARGUMENTS else [*known, *_ARGUMENTS]
    return did_you_mean(option, names).removeprefix("; ") or "leave it out"
