"""Named random streams: a generator is found by what it is for, never by the order in which it was made.

One worker or eight, one environment or a thousand: whoever asks for ``stream(seed, "episode", 17)`` gets the
same numbers, whatever was drawn elsewhere before. No global generator is read or written.
"""

from __future__ import annotations

import hashlib
import operator
from functools import lru_cache

import numpy as np

from randomization.errors import SeedError

# Seeds stay in the positive range of int64, so they pass through arrays, JSON and YAML unharmed.
SEED_BITS = 63


def stream(seed: int, *path: str | int) -> np.random.Generator:
    """The generator named by ``path`` below ``seed``.

    Args:
        seed: any non-negative integer.
        path: what the stream is for, outermost first, for example ``"episode", 3, "joint_offset"``. Text and
            numbers are told apart: ``"3"`` and ``3`` name different streams.

    Returns:
        A fresh PCG64 generator at the start of its stream; other seeds or paths give independent ones.

    Raises:
        SeedError: ``seed`` is negative or no integer, or a path item is neither text nor an integer.
    """
    return np.random.Generator(np.random.PCG64(_sequence(seed, path)))


def derive(seed: int, *path: str | int) -> int:
    """The child seed named by ``path`` below ``seed``: an integer in [0, 2^63).

    Use it to hand a whole subtree of randomness to another part, for example ``derive(seed, "evaluation",
    episode)``. Raises ``SeedError`` as ``stream`` does.
    """
    low, high = _sequence(seed, path).generate_state(2, np.uint32).tolist()
    return ((high << 32) | low) & ((1 << SEED_BITS) - 1)


def _sequence(seed: int, path: tuple[str | int, ...]) -> np.random.SeedSequence:
    try:
        number = operator.index(seed)
    except TypeError:
        raise SeedError(f"seed = {seed!r}: allowed are integers >= 0") from None
    if number < 0 or isinstance(seed, (bool, np.bool_)):
        raise SeedError(f"seed = {seed!r}: allowed are integers >= 0")
    try:
        # The types come along because 1, 1.0 and True are equal as keys of the cache.
        key = _spawn_key(path, tuple(map(type, path)))
    except TypeError:  # unhashable, so neither text nor a number
        raise SeedError(f"stream path {path!r}: allowed are text and integers") from None
    if number >> 64:
        return np.random.SeedSequence(number, spawn_key=tuple(key.tolist()))
    # what NumPy makes of the same two, in a ninth of the time: the number's words in a pool of four, then the key's
    words = np.zeros(4 + len(key), np.uint32)
    words[0], words[1], words[4:] = number & 0xFFFFFFFF, number >> 32, key
    return np.random.SeedSequence(words)  # type: ignore[arg-type]


@lru_cache(maxsize=4096)
def _spawn_key(path: tuple[str | int, ...], _types: tuple[type, ...]) -> np.ndarray:
    """Eight 32-bit words. Items carry their kind and length, so no two paths spell the same bytes."""
    digest = hashlib.blake2s()
    for item in path:
        if isinstance(item, str):
            kind, data = b"s", item.encode()
        elif isinstance(item, (int, np.integer)) and not isinstance(item, bool):
            kind, data = b"i", str(int(item)).encode()
        else:
            raise SeedError(f"stream path item {item!r}: allowed are text and integers")
        digest.update(kind + len(data).to_bytes(4, "little") + data)
    return np.frombuffer(digest.digest(), dtype="<u4").astype(np.uint32)
