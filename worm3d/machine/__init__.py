"""Code generation, compilation, its cache on disc and banded algebra; nothing here knows of worms."""
