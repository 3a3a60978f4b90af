"""What bits need of a sensor, whose module imports theirs."""

from typing import Any, Protocol, Self

import numpy.typing as npt


class SensorLike(Protocol):
    """The part of :class:`jotlight.Sensor` that bits and their files use."""

    @property
    def oversampling(self) -> int: ...  # noqa: D102
    @property
    def frames(self) -> int: ...  # noqa: D102
    @property
    def trials(self) -> int: ...  # noqa: D102
    @property
    def max_intensity(self) -> float: ...  # noqa: D102
    @property
    def bit_depth(self) -> int: ...  # noqa: D102
    @property
    def kernel(self) -> str: ...  # noqa: D102
    @property
    def mosaic(self) -> Any: ...  # noqa: D102

    def replace(self, **changes: Any) -> Self: ...  # noqa: D102
    def select_frames(self, frames: slice) -> Self: ...  # noqa: D102
    def check_map_shapes(self, height: int, width: int) -> None: ...  # noqa: D102
    def maps(self) -> dict[str, npt.NDArray[Any]]: ...  # noqa: D102
    def scalars(self) -> dict[str, Any]: ...  # noqa: D102
