"""Randomness by name: the same key gives the same nature, whatever was asked before."""

from __future__ import annotations

import hashlib

import numpy as np
from scipy.special import ndtri

from rigctl.core.arrays import FloatArray, Int64Array


def generator(*key: int | str) -> np.random.Generator:
    """A random generator that depends on `key` alone."""
    # A digest of the whole key, so that neighbouring keys have nothing in common.
    digest = hashlib.blake2b(repr(key).encode(), digest_size=16).digest()
    return np.random.default_rng(int.from_bytes(digest, "little"))


def uniform_of_integers(salt: int, integers: Int64Array) -> FloatArray:
    """One number in [-1, 1) for each integer, a fixed function of it and of `salt` (splitmix64)."""
    # splitmix64 (Steele, Lea and Flood 2014): a generator object per integer would be a thousand times slower.
    mixed = integers.astype(np.uint64) + np.uint64(salt)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed = mixed ^ (mixed >> np.uint64(31))
    # The upper 53 bits: a double has no more.
    return (mixed >> np.uint64(11)).astype(np.float64) * 2.0**-52 - 1.0


def normal_at_times(times_s: FloatArray, *key: int | str) -> FloatArray:
    """One standard normal number for each time, a fixed function of its microsecond and of `key`."""
    salt = int(generator(*key).integers(2**63))
    uniform = uniform_of_integers(salt, np.rint(1e6 * times_s).astype(np.int64))
    # From [-1, 1) into (0, 1): half a step of the doubles away from both ends.
    return np.asarray(ndtri(0.5 * (uniform + 1.0) + 2.0**-54), dtype=np.float64)
