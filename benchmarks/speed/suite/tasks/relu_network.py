"""A plain convolutional ReLU network of a given cost, at half the resolution of the image."""

import itertools
from collections.abc import Sequence
from typing import Any

WIDTHS = 32, 16
"""Numbers of channels with which PyTorch is fastest in bfloat16. The second is for small costs."""
MIN_FILTER_BANKS = 2
"""Minimum number of filter banks from the first width to itself."""


def hidden_channels(multiply_adds: float) -> list[int]:
    """Return the channels of each hidden layer, for multiply-adds per pixel of the image.

    The last layer has as many channels as the cost leaves, so that the cost is nearly exact.
    """
    fits = cost([WIDTHS[0]] * (MIN_FILTER_BANKS + 1)) <= multiply_adds
    width = WIDTHS[0] if fits else WIDTHS[1]
    channels = [width]
    while cost([*channels, width]) <= multiply_adds:
        channels.append(width)
    last = min(range(width), key=lambda last: abs(cost([*channels, last]) - multiply_adds))
    return [*channels, last] if last else channels


def cost(channels: Sequence[int]) -> float:
    """Return the multiply-adds per pixel of the image, for the channels of each hidden layer.

    A pixel of the hidden layers is four pixels of the image. The filters to and from them have
    4 × 4 taps, the others 3 × 3.
    """
    pairs = itertools.pairwise(channels)
    last = next((number for number in reversed(channels) if number), 0)
    return (16 * (channels[0] + last) + 9 * sum(before * after for before, after in pairs)) / 4


def build(torch: Any, multiply_adds: float) -> Any:
    """Return the module, untrained and in bfloat16. It maps counts (N, 1, H, W) to an image."""
    channels = hidden_channels(multiply_adds)
    # An odd height or width is rounded up.
    layers = [torch.nn.ZeroPad2d((1, 2, 1, 2)), torch.nn.Conv2d(1, channels[0], 4, 2)]
    for before, after in itertools.pairwise(channels):
        layers += [torch.nn.ReLU(), torch.nn.Conv2d(before, after, 3, padding=1)]
    layers += [torch.nn.ReLU(), torch.nn.ConvTranspose2d(channels[-1], 1, 4, 2, 1)]
    module = torch.nn.Sequential(*layers).eval()
    return module.to(dtype=torch.bfloat16, memory_format=torch.channels_last)
