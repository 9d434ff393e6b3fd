"""Code generation, compilation, the cache of compiled code on disk, and banded algebra. Independent of worms."""
