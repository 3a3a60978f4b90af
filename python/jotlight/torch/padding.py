"""Mirrored padding, which PyTorch has only without the border pixel or for narrow margins."""

import torch
from torch import Tensor
from torch.nn import functional


def mirror_pad(planes: Tensor, rows: tuple[int, int], columns: tuple[int, int]) -> Tensor:
    """Return planes with mirrored margins, as `numpy.pad` with mode "symmetric" makes them.

    Parameters
    ----------
    planes : Tensor, shape (N, C, H, W)
    rows, columns : (int, int)
        Number of rows to add above and below, and of columns to add left and right. They may
        exceed the size of the planes.

    Examples
    --------
    >>> planes = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    >>> mirror_pad(planes, (0, 0), (2, 1)).flatten().tolist()
    [2.0, 1.0, 1.0, 2.0, 3.0, 3.0]
    """
    if not any((*rows, *columns)):
        return planes
    # Inductor takes the gradient of this padding to be contiguous, which it is not if a convolution
    # interleaved the channels: a compiled network could not be trained.
    if max(*rows, *columns) == 1 and not torch.compiler.is_compiling():
        return functional.pad(planes, (*columns, *rows), mode="replicate")
    for dimension, (before, after) in ((2, rows), (3, columns)):
        size = planes.shape[dimension]
        indices = torch.arange(-before, size + after, device=planes.device) % (2 * size)
        planes = planes.index_select(dimension, indices.minimum(2 * size - 1 - indices))
    return planes
