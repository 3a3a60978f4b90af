"""A growing ONNX graph, with the operations of networks that ONNX lacks (extra `onnx`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from onnx import ModelProto, TensorProto, checker, helper, numpy_helper

from jotlight._engine import __version__

OPSET = 17
"""Version of the operators. Newer runtimes run it, too."""

IR_VERSION = 8
"""Version of the file format that belongs to these operators."""


class GraphBuilder:
    """A growing graph: each method adds nodes and returns the name of their output."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: dict[str, Any] = {}

    def add(self, operator: str, *inputs: str | float, **attributes: Any) -> str:
        """Return the output of an operator. Numbers among its inputs become float32 constants."""
        names = [each if isinstance(each, str) else self.number(each) for each in inputs]
        output = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, names, [output], output, **attributes))
        return output

    def constant(self, name: str, array: npt.NDArray[Any]) -> str:
        """Return the name of a constant. Constants of the same name are stored once."""
        if name not in self.constants:
            self.constants[name] = numpy_helper.from_array(np.ascontiguousarray(array), name)
        return name

    def number(self, value: float) -> str:
        """Return the name of a float32 number."""
        return self.constant(f"number_{value!r}", np.array(value, np.float32))

    def integers(self, *values: int) -> str:
        """Return the name of a vector of int64."""
        return self.constant("_".join(map(str, ("integers", *values))), np.array(values, np.int64))

    def size(self, planes: str, axis: int) -> str:
        """Return the size of an axis as a scalar."""
        return self.add("Gather", self.add("Shape", planes), self._scalar(axis))

    def mirror_pad(self, planes: str, margins: Sequence[tuple[int, int]]) -> str:
        """Return planes (N, C, H, W) with mirrored margins, as `numpy.pad(mode="symmetric")`.

        Parameters
        ----------
        planes : str
            Name of the planes.
        margins : ((int, int), (int, int))
            Numbers of rows above and below, and of columns left and right. They may exceed the
            size of the planes.
        """
        (top, bottom), (left, right) = margins
        if max(top, bottom, left, right) == 0:
            return planes
        if max(top, bottom, left, right) == 1:
            pads = self.integers(0, 0, top, left, 0, 0, bottom, right)
            return self.add("Pad", planes, pads, mode="edge")
        for axis, (before, after) in ((2, margins[0]), (3, margins[1])):
            size = self.size(planes, axis)
            stop = self.add("Add", size, self._scalar(after))
            planes = self._mirror(planes, axis, size, self._scalar(-before), stop)
        return planes

    def pad_to_multiple(self, planes: str, divisor: int) -> str:
        """Return planes whose mirrored rows and columns make H and W multiples of a divisor."""
        if divisor == 1:
            return planes
        for axis in (2, 3):
            size = self.size(planes, axis)
            missing = self.add("Mod", self.add("Neg", size), self._scalar(divisor))
            stop = self.add("Add", size, missing)
            planes = self._mirror(planes, axis, size, self._scalar(0), stop)
        return planes

    def crop(self, planes: str, like: str, step: int = 1) -> str:
        """Return the first rows and columns of planes: as many as others have, divided by step."""
        shape = self.add("Slice", self.add("Shape", like), self.integers(2), self.integers(4))
        shape = self.add("Div", shape, self.integers(step))
        return self.add("Slice", planes, self.integers(0, 0), shape, self.integers(2, 3))

    def piecewise_cubics(
        self,
        name: str,
        z: str,
        cubics: npt.NDArray[np.floating],
        start: float,
        spacing: float,
    ) -> str:
        """Return piecewise cubics of z, one function per channel, constant outside their range.

        Parameters
        ----------
        name : str
            Name of the constants.
        z : str
            Name of the values (N, C, H, W).
        cubics : ndarray, shape (C, I, 4)
            Coefficients of 1, t, t², and t³ in each of I intervals, where t in [0, 1] is the
            distance from the lower end in units of the spacing.
        start, spacing : float
            Start of the first interval, and length of the intervals.
        """
        channels, intervals, _ = cubics.shape
        position = self.add("Mul", self.add("Sub", z, start), 1 / spacing)
        position = self.add("Clip", position, 0.0, float(intervals))
        knot = self.add("Min", self.add("Floor", position), float(intervals - 1))
        t = self.add("Sub", position, knot)
        offset = np.arange(channels, dtype=np.int32)[:, None, None] * np.int32(intervals)
        index = self.add("Cast", knot, to=TensorProto.INT32)
        index = self.add("Add", index, self.constant(f"{name}.offset", offset))
        value: str | None = None
        for power in (3, 2, 1, 0):
            table = cubics[..., power].astype(np.float32).ravel()
            term = self.add("Gather", self.constant(f"{name}.{power}", table), index)
            value = term if value is None else self.add("Add", self.add("Mul", value, t), term)
        assert value is not None
        return value

    def model(
        self,
        data: tuple[str, Sequence[int | str]],
        output: tuple[str, Sequence[int | str]],
        description: str,
        metadata: dict[str, str],
    ) -> ModelProto:
        """Return the checked model. Its last node computes the output.

        Parameters
        ----------
        data, output : (str, sequence of int or str)
            Name and shape of the input and of the output; names in a shape stand for any size.
        description : str
            A text for people.
        metadata : dict of str
            Texts for programs.
        """
        self.nodes[-1].output[0] = output[0]
        graph = helper.make_graph(
            self.nodes,
            "jotlight",
            [helper.make_tensor_value_info(data[0], TensorProto.FLOAT, data[1])],
            [helper.make_tensor_value_info(output[0], TensorProto.FLOAT, output[1])],
            list(self.constants.values()),
            doc_string=description,
        )
        opsets = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(
            graph,
            opset_imports=opsets,
            ir_version=IR_VERSION,
            producer_name="jotlight",
            producer_version=__version__,
        )
        helper.set_model_props(model, metadata)
        checker.check_model(model, full_check=True)
        return model

    def _scalar(self, value: int) -> str:
        return self.constant(f"integer_{value}", np.array(value, np.int64))

    def _mirror(self, planes: str, axis: int, size: str, start: str, stop: str) -> str:
        """Return the rows or columns start to stop of planes that are mirrored without end."""
        period = self.add("Mul", size, self._scalar(2))
        index = self.add("Mod", self.add("Range", start, stop, self._scalar(1)), period)
        mirrored = self.add("Sub", self.add("Sub", period, self._scalar(1)), index)
        return self.add("Gather", planes, self.add("Min", index, mirrored), axis=axis)
