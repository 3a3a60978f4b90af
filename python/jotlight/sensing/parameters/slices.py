"""Slices of frames, rows, and columns: their text, and what they select."""

from jotlight.checks import shown


def require_slice(name: str, value: object) -> None:
    """Raise TypeError unless a value is a slice.

    Examples
    --------
    >>> require_slice("frames", 3)
    Traceback (most recent call last):
      ...
    TypeError: frames: expected a slice, such as slice(0, 16), got 3
    """
    if not isinstance(value, slice):
        raise TypeError(f"{name}: expected a slice, such as slice(0, 16), got {shown(value)}")


def format_frame_range(frames: slice) -> str:
    """Return a slice of frames in the notation of `--frame-range`.

    Examples
    --------
    >>> format_frame_range(slice(100, 200)), format_frame_range(slice(None, 16, 2))
    ('100:200', ':16:2')
    """
    ends = [frames.start, frames.stop, *([] if frames.step is None else [frames.step])]
    return ":".join("" if end is None else str(end) for end in ends)


def frames_text(frames: range) -> str:
    """Return some consecutive frames in words.

    Examples
    --------
    >>> frames_text(range(4)), frames_text(range(1))
    ('frames 0 to 3', 'frame 0')
    """
    first, last = frames[0], frames[-1]
    return f"frame {first}" if first == last else f"frames {first} to {last}"


def chosen_range(name: str, title: str, part: slice, number: int) -> range:
    """Return the frames, rows, or columns of a slice. Messages call them `title`.

    Raises
    ------
    TypeError
        When an end or the step is not a whole number.
    ValueError
        When the step is 0.

    Examples
    --------
    >>> chosen_range("bits", "rows", slice(-4, None), 9)
    range(5, 9)
    """
    try:
        return range(number)[part]
    except TypeError:
        ends = (part.start, part.stop, *([] if part.step is None else [part.step]))
        text = ":".join("" if end is None else shown(end) for end in ends)
        raise TypeError(
            f"{name}: expected whole numbers in the slice of {title}, such as 10:40, got {text}"
        ) from None
    except ValueError:
        raise ValueError(
            f"{name}: expected a slice of {title} with a step other than 0, got "
            f"{format_frame_range(part)}"
        ) from None


def refuse_no_frames(name: str, frames: slice, number: int) -> None:
    """Raise ValueError when a slice selects none of a number of frames, or is no valid slice.

    Examples
    --------
    >>> refuse_no_frames("bits", slice(2, 4), 8)
    """
    if len(chosen_range(name, "frames", frames, number)) == 0:
        raise ValueError(f"{name}: no frames in {format_frame_range(frames)} of {number}")
