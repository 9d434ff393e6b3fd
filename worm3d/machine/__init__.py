"""Code generation, compilation, the cache of compiled code on disc and banded algebra; independent of worms."""
