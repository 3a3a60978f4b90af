"""Seeds for the engine's random generator, from the values that NumPy accepts as `rng`."""

import hashlib

import numpy as np

SeedLike = int | np.random.Generator | np.random.SeedSequence | None


def seed_bytes(rng: SeedLike) -> bytes:
    """Return a seed of 256 bits.

    A number, a `SeedSequence`, or None (fresh entropy) yields the state of NumPy's `SeedSequence`.
    A generator yields its next 32 bytes.

    Raises
    ------
    TypeError
        For any other type.
    ValueError
        For a negative number.

    Examples
    --------
    >>> seed_bytes(7) == seed_bytes(7), seed_bytes(7) == seed_bytes(8)
    (True, False)
    """
    if isinstance(rng, np.random.Generator):
        return rng.bytes(32)
    _check_seed(rng)
    if isinstance(rng, np.random.SeedSequence):
        sequence = rng
    else:
        sequence = np.random.SeedSequence(rng if rng is None else int(rng))
    return sequence.generate_state(8, np.uint32).astype("<u4").tobytes()


def seed_of_image(seed: bytes, index: int) -> bytes:
    """Return the seed of an image of a stack. That of the first image is the seed itself.

    Examples
    --------
    >>> seed = seed_bytes(7)
    >>> seed_of_image(seed, 0) == seed, seed_of_image(seed, 1) == seed_of_image(seed, 2)
    (True, False)
    """
    if index == 0:
        return seed
    return hashlib.blake2b(index.to_bytes(8, "little"), key=seed, digest_size=32).digest()


def random_generator(rng: SeedLike) -> np.random.Generator:
    """Return the generator of a seed, or the generator itself.

    Raises
    ------
    TypeError, ValueError
        As :func:`seed_bytes`.

    Examples
    --------
    >>> random_generator(7).integers(100) == np.random.default_rng(7).integers(100)
    np.True_
    """
    if not isinstance(rng, np.random.Generator):
        _check_seed(rng)
    return np.random.default_rng(rng)


def _check_seed(rng: object) -> None:
    """Raise TypeError or ValueError unless this is a seed, or None."""
    if isinstance(rng, bool) or not isinstance(
        rng, int | np.integer | np.random.SeedSequence | None
    ):
        raise TypeError(
            "rng: expected a whole number, a numpy.random.Generator, a SeedSequence or None, "
            f"got {rng!r}"
        )
    if isinstance(rng, int | np.integer) and rng < 0:
        raise ValueError(f"rng: expected a seed of 0 or more, got {rng}")
