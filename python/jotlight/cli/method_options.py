"""Options that choose and adjust a reconstruction method."""

import dataclasses
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight.cli.common_options import METHOD_PANEL, Model
from jotlight.estimators.tv import NORMS
from jotlight.estimators.vst import INVERSES
from jotlight.evaluation.methods import (
    DEFAULT_METHOD,
    FALLBACK_METHOD,
    LARGE_METHOD,
    LARGE_TRIALS,
    METHODS,
    SMOOTH_KERNEL_METHOD,
    requested_method,
)


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Method and its settings; None where an option is not set."""

    method: Annotated[
        str | None,
        Parameter(
            alias="-m",
            help=f"One of {', '.join(METHODS)}. Default: {DEFAULT_METHOD} where it serves the "
            f"sensor ({LARGE_METHOD} above {LARGE_TRIALS} trials per pixel), else "
            f"{FALLBACK_METHOD}, or {SMOOTH_KERNEL_METHOD} for a smooth kernel.",
        ),
    ] = None
    model: Model = None
    inverse: Annotated[
        str | None,
        Parameter(help=f"Inverse of the non-iterative methods: {' or '.join(INVERSES)}."),
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

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of the method that the user set."""
        names = ("inverse", "weight", "norm", "tol", "max_iter")
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def request(self, *, needs_uncertainty: bool) -> str | None:
        """Return the method that the user requests, by name or by an option.

        Raises
        ------
        ValueError
            For an unknown method, or options that do not belong together.
        """
        options = [*(["uncertainty"] if needs_uncertainty else []), *self.settings()]
        if self.model is None:
            return requested_method(self.method, options)
        if self.method is not None:
            raise ValueError(f"model: replaces the method; leave out --method {self.method}")
        if options:
            raise ValueError(f"{options[0]}: is not an option of a network; leave out --model")
        return None
