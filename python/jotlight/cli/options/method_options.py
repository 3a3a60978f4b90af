"""Options that choose and adjust a reconstruction method."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight.cli.options.common_options import METHOD_PANEL, NAMES, Model, Precision, Quality
from jotlight.estimators.demosaicing import TITLES
from jotlight.estimators.tv import NORMS
from jotlight.estimators.vst import INVERSES
from jotlight.evaluation.color.color_data import check_demosaicing
from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS
from jotlight.evaluation.methods import (
    BLEND_METHOD,
    DEFAULT_METHOD,
)
from jotlight.evaluation.request import Request
from jotlight.evaluation.requested_method import network_name, requested_method
from jotlight.networks.loading import load_image_network


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Method and its settings; None where an option is not set."""

    method: Annotated[
        str | None,
        Parameter(
            alias="-m",
            help=f"One of {NAMES}. Default: {DEFAULT_METHOD}, the color network for a mosaic and "
            f"for three channels, or {BLEND_METHOD} above {MAX_NETWORK_TRIALS} trials per pixel.",
        ),
    ] = None
    quality: Quality = None
    model: Model = None
    precision: Precision = None
    fallback: Annotated[
        bool,
        Parameter(
            negative=(),
            help="Blend a network with total variation and maximum likelihood, with the weights "
            f"that make held-out bits most likely. Without a method, it selects {BLEND_METHOD}. It "
            "takes 10 to 30 times as long.",
        ),
    ] = False
    inverse: Annotated[
        str | None,
        Parameter(
            help=f"Inverse of the non-iterative methods: {' or '.join(INVERSES)}. Default: "
            f"{INVERSES[0]}."
        ),
    ] = None
    weight: Annotated[
        float | None,
        Parameter(
            group=METHOD_PANEL,
            help="Weight of total variation in admm-tv, in nats per unit of intensity. Default: "
            "chosen from the data.",
        ),
    ] = None
    norm: Annotated[
        str | None,
        Parameter(
            group=METHOD_PANEL,
            help=f"Norm of total variation in admm-tv: {' or '.join(NORMS)}. Default: {NORMS[0]}.",
        ),
    ] = None
    tol: Annotated[
        float | None,
        Parameter(
            group=METHOD_PANEL,
            help="Residual at which the method stops. Default: 1e-3 for admm-tv, 1e-6 for "
            "mle-iterative.",
        ),
    ] = None
    max_iter: Annotated[
        int | None,
        Parameter(group=METHOD_PANEL, help="Maximum number of iterations. Default: 500."),
    ] = None

    demosaicing: Annotated[
        str | None,
        Parameter(
            help=f"How the colors of a mosaic become an image: network, {', '.join(TITLES)}. "
            "Default: network if no method is requested, else menon for a Bayer mosaic, and "
            "differences for others.",
        ),
    ] = None

    def _options(self) -> dict[str, Any]:
        """Return the options of the method that the user set."""
        names = ("inverse", "weight", "norm", "tol", "max_iter")
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def to_request(self) -> Request:
        """Return what the user requests: a method, by name or by an option, or a loaded network.

        Raises
        ------
        OSError
            When the file of the network cannot be read.
        ValueError
            For an unknown method, or options that do not belong together.
        """
        if ":" in (self.method or ""):
            raise ValueError(
                "method: functions of your own are for compare, evaluate, and reproduce; in "
                "Python, jotlight.reconstruct takes them, too"
            )
        check_demosaicing(self.demosaicing)
        method = one_method(self.method, self.quality, self.model)
        options = self._options()
        if self.model is not None and options:
            raise ValueError(
                f"{next(iter(options))}: is not an option of a network; leave out --model"
            )
        network = None if self.model is None else load_image_network(self.model)
        return Request(
            requested_method(method, options) if network is None else network,
            demosaicing=self.demosaicing,
            precision=self.precision,
            fallback=self.fallback,
            options=options,
        )


def one_method(method: str | None, quality: str | None, model: Path | None) -> str | None:
    """Return the name of the method that one of three options selects, or None.

    Raises
    ------
    ValueError
        When two of them are set, or for an unknown size.
    """
    options = {"--method": method, "--quality": quality, "--model": model}
    chosen = [f"{option} {value}" for option, value in options.items() if value is not None]
    if len(chosen) > 1:
        raise ValueError(
            f"expected one of --method, --quality, --model, got {' and '.join(chosen)}"
        )
    return network_name(quality) if quality is not None else method


def split_names(values: Iterable[str] | None) -> list[str]:
    """Return the names in the values of a repeated option, which commas may separate.

    Examples
    --------
    >>> split_names(["mle,admm-tv", "mine:denoise"])
    ['mle', 'admm-tv', 'mine:denoise']
    """
    return [name.strip() for value in values or () for name in value.split(",")]
