"""Finite elements of a soft segment: rubber wall with fibres between two end plates, under pressure or a cable.

The room knows no worm. It needs the optional part `fem` (pip install 'worm3d[fem]') for meshes; densities and
descriptions work without the optional part.
"""
