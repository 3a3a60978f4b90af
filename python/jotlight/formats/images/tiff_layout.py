"""What the pages and the samples of a TIFF file mean, and whether they are counts."""

import re
from pathlib import Path
from typing import Any

from jotlight.errors import counted
from jotlight.formats.images.tiff_directories import shape_of
from jotlight.layout import MAX_CHANNELS

ALPHA = 1, 2
"""Values of the tag ExtraSamples that mark transparency."""

_NO_COUNTS = {0: "inverted gray levels", 5: "inks", 6: "YCbCr colors", 8: "CIELAB colors"}
"""Values of the tag PhotometricInterpretation whose numbers are no counts, and their names."""

_IMAGES = "TZQI"
"""Letters of tifffile for axes of images: time, depth, unknown, and a sequence."""


def no_counts_error(tiff: Any, path: Path) -> ValueError | None:
    """Return an error if the pages or the samples of a TIFF file do not hold counts of images.

    Other programs may store channels as pages, which look like frames, and transparency as samples,
    which look like colors.

    Parameters
    ----------
    tiff : tifffile.TiffFile
        The open file.
    path : Path
        Its name for messages.
    """
    series, page = tiff.series[0], tiff.pages[0]
    channels = channels_in_pages(tiff)
    if channels > 1 and unlikely_channels(tiff) is None:
        return ValueError(
            f"{path}: expected pages that are frames, but the file says that they are {channels} "
            f"channels (shape {series.shape}); if they are frames, state it "
            "(tifffile.imwrite(..., metadata={'axes': 'TYX'}), or ImageJ: Image > Hyperstacks > "
            "Re-order Hyperstack); if they are channels, write each to a file of its own "
            "(ImageJ: Image > Color > Split Channels), or as samples, (T, H, W, C)"
        )
    kind = _NO_COUNTS.get(int(page.photometric))
    if kind is not None:
        return ValueError(
            f"{path}: expected counts as gray levels or RGB, got {kind}; save the counts as gray "
            "levels in which 0 is black (tifffile.imwrite(..., photometric='minisblack'))"
        )
    if set(ALPHA) & set(map(int, page.extrasamples)):
        frames = "; if they are frames, write them with tifffile.imwrite(..., photometric="
        frames = f"{frames}'minisblack')" if series.axes == "SYX" else ""
        return ValueError(
            f"{path}: expected counts, got {counted(page.samplesperpixel - 1, 'channel')} and "
            f"transparency, of shape {shape_of(series)}; save the file without its alpha channel"
            f"{frames}"
        )
    images = [axis for axis in series.axes if axis in _IMAGES]
    if len(images) > 1:
        return ValueError(
            f"{path}: expected one axis of images, (T, H, W), got {series.axes} of shape "
            f"{series.shape}; write one stack of images to each file"
        )
    return None


def note_about_axes(tiff: Any) -> str | None:
    """Return what is assumed about the pages or the samples of a file, or None if it is clear.

    tifffile stores a stack of three frames as colors, each of which lies apart, unless the program
    that writes it states that they are gray.
    """
    series = tiff.series[0]
    if series.axes == "SYX":
        return (
            f"its {series.shape[0]} planes are read as channels; if they are frames, write them "
            "with tifffile.imwrite(..., photometric='minisblack')"
        )
    return unlikely_channels(tiff)


def unlikely_channels(tiff: Any) -> str | None:
    """Return a note if the pages of a file are frames, although the file calls them channels.

    tifffile calls the pages of any stack channels in files for ImageJ and in OME-TIFF, unless the
    program that writes it states the axes. No capture has more than four channels.
    """
    channels, series = channels_in_pages(tiff), tiff.series[0]
    if channels <= MAX_CHANNELS or len(series.shape) != 3 or series.shape[0] != channels:
        return None
    return f"its {channels} pages are read as frames, although the file calls them channels"


def channels_in_pages(tiff: Any) -> int:
    """Return the number of channels that the pages of a file hold, as ImageJ or OME-TIFF state."""
    series, page = tiff.series[0], tiff.pages[0]
    if "C" in series.axes:
        return int(series.shape[series.axes.index("C")])
    text = page.description
    if not text.lstrip().startswith(("<?xml", "<OME")):
        return 1
    stated = re.search(r'\bSizeC="(\d{1,6})"', text)
    return 1 if stated is None else int(stated[1]) // max(1, page.samplesperpixel)
