"""The classes of the pixels of a photograph: flat, edge, and texture.

They come from the structure tensor of the square root of the image, averaged with σ = 1.5 pixels:
flat where the gradient is at most 0.01 per pixel (root mean square), edge where its coherence is
above 0.7, and texture elsewhere.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, sobel

CLASSES = "flat", "edge", "texture"
"""Names of the classes, in the order of their numbers."""

FLAT, COHERENT, SIGMA = 0.01, 0.7, 1.5


def classify(image: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """Return the class of each pixel of an image (H, W): 0 for flat, 1 for edge, 2 for texture."""
    shade = np.sqrt(image)
    slopes = sobel(shade, 0) / 8, sobel(shade, 1) / 8
    first, mixed, second = (
        gaussian_filter(slopes[i] * slopes[j], SIGMA) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    energy = first + second
    coherence = np.sqrt((first - second) ** 2 + 4 * mixed**2) / np.maximum(energy, 1e-12)
    return np.where(energy <= FLAT**2, 0, np.where(coherence > COHERENT, 1, 2))
