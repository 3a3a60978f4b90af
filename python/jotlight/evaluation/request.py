"""What a caller requests of a reconstruction: the method, and its settings."""

import dataclasses
from typing import Any

from jotlight.evaluation.own_method import OwnMethod
from jotlight.networks.color_network import AnyNetwork

AnyMethod = str | AnyNetwork | OwnMethod
"""The name of a method, a network, or a function."""


@dataclasses.dataclass(frozen=True)
class Request:
    """A method and its settings, as :func:`jotlight.reconstruct` takes them."""

    method: AnyMethod | None = None
    quality: str | None = None
    demosaicing: str | None = None
    precision: str | None = None
    fallback: bool = False
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Options of the method."""
    threads: int | None = None

    @property
    def is_default(self) -> bool:
        """Whether nothing selects a method."""
        return (
            self.method is None and self.quality is None and not self.fallback and not self.options
        )

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of :func:`jotlight.reconstruct`.

        Examples
        --------
        >>> Request("admm-tv", options={"weight": 2.0}).arguments()["weight"]
        2.0
        """
        names = [field.name for field in dataclasses.fields(self) if field.name != "options"]
        return {**{name: getattr(self, name) for name in names}, **self.options}
