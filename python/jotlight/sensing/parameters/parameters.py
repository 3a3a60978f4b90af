"""The parameters of a sensor as a whole: their parts in files, their comparison, and their text."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.sensing.parameters.description import html_of, repr_of, sensor_of_parts
from jotlight.sensing.parameters.maps import MAPS


class Parameters:
    """The base class of the sensor. Its fields are numbers, text, None, and arrays.

    An array with two axes is a map over the jots. An array with one axis has a value for each
    frame.
    """

    oversampling: int
    mosaic: Any

    def check_map_shapes(self, height: int, width: int) -> None:
        """Raise ValueError unless maps and mosaic fit `height` rows and `width` columns of jots."""
        for name, map_ in self.maps().items():
            if map_.shape != (expected := (height, width)):
                raise ValueError(
                    f"{name}: expected one value per jot, shape {expected}, got shape {map_.shape}"
                )
        if self.mosaic is not None:
            self.mosaic.check_size(height // self.oversampling, width // self.oversampling)

    def maps(self) -> dict[str, npt.NDArray[Any]]:
        """Return the parameters that are maps over the jots, by name."""
        # PyTorch's compiler does not know numpy.ndim.
        arrays = {
            name: value for name in MAPS if isinstance(value := getattr(self, name), np.ndarray)
        }
        return {name: value for name, value in arrays.items() if value.ndim == 2}

    def without_maps(self) -> Self:
        """Return the sensor without a mask, and with the means of the other maps."""
        means = {
            name: float(np.mean(value)) for name, value in self.maps().items() if name != "mask"
        }
        if "threshold" in means:
            means["threshold"] = round(means["threshold"])
        return self.replace(mask=None, **means)  # type: ignore[attr-defined,no-any-return]

    def scalars(self) -> dict[str, Any]:
        """Return the parameters that are neither maps nor None, by name, as values of JSON.

        A value for each frame becomes a list, and a mosaic a dictionary.
        """
        maps = self.maps()
        values = {name: getattr(self, name) for name in self._names() if name not in maps}
        if self.mosaic is not None:
            values["mosaic"] = self.mosaic.to_json()
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in values.items()
            if value is not None
        }

    @classmethod
    def from_parts(cls, scalars: Any, maps: dict[str, npt.NDArray[Any]] | None = None) -> Self:
        """Return the sensor with these :meth:`scalars` and :meth:`maps`.

        Raises
        ------
        ValueError
            When the parts do not describe a sensor.
        """
        return sensor_of_parts(cls, cls._names(), scalars, maps or {})  # type: ignore[type-var]

    @classmethod
    def _names(cls) -> list[str]:
        return [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        mine, theirs = self.maps(), other.maps()
        return (
            self.mosaic == other.mosaic
            and self.scalars() == other.scalars()
            and mine.keys() == theirs.keys()
            and all(np.array_equal(mine[name], theirs[name]) for name in mine)
        )

    def __hash__(self) -> int:
        maps = ((name, map_.shape, float(map_.sum())) for name, map_ in self.maps().items())
        scalars = (
            (name, tuple(value) if isinstance(value, list) else value)
            for name, value in self.scalars().items()
            if name != "mosaic"
        )
        return hash((*scalars, self.mosaic, *maps))

    def _repr_html_(self) -> str:
        return html_of(self)  # type: ignore[arg-type]

    def __repr__(self) -> str:
        # A subclass may have parameters of its own, and need not take those of the sensor.
        defaults: dict[str, object] = {}
        for each in reversed(type(self).__mro__):
            if initialize := vars(each).get("__init__"):
                parameters = inspect.signature(initialize).parameters
                defaults |= {name: one.default for name, one in parameters.items()}
        names = {name: defaults.get(name, dataclasses.MISSING) for name in self._names()}
        return repr_of(self, names)  # type: ignore[arg-type]
